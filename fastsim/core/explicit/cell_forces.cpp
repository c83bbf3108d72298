#include "explicit/cell_forces.hpp"

#include <algorithm>
#include <utility>

namespace fastsim {

template <typename Real>
CellForces<Real>::CellForces(const ElasticBody &body, std::unique_ptr<InternalForce<Real>> internal,
                             const PointRecords &records, const KernelChoice<Real> &kernel,
                             const StrainDamping &damping)
    : _internal(std::move(internal)), _parts(portions().size()),
      _damps_strain(damping.stiffness_damping > 0.0),
      _damping_over_step(static_cast<Real>(damping.stiffness_damping / damping.time_step)) {
    for (std::size_t t = 1; t < _parts.size(); ++t)
        _parts[t].assign(records.padded_size(), Real(0));
    // Where stress is linear in strain one sum does, unless the balance wants them apart.
    if (_damps_strain && (damping.is_balanced || !body.elastic.is_linear_in_strain() ||
                          (body.patches && blends(body.elastic))))
        _viscous = InternalForce<Real>::make_viscous(body, records, kernel, _parts.size());
    if (_damps_strain && damping.is_balanced)
        _viscous_parts.assign(_parts.size(), AlignedVector<Real>(records.padded_size(), Real(0)));
}

template <typename Real> void CellForces<Real>::start(const Motion<Real> &motion) {
    if (_damps_strain)
        _increment_at_start = motion.increment;
}

template <typename Real> Real *CellForces<Real>::part_of(std::size_t thread, Motion<Real> &motion) {
    return thread == 0 ? motion.force.data() : _parts[thread].data();
}

/// The change of strain over the last increment, and a part of the strain itself.
template <typename Real>
StrainChange<Real> CellForces<Real>::change_of(const Motion<Real> &motion, bool is_first_step,
                                               Real own) const {
    // What moves supports from the first step on is not yet seen before it.
    const bool is_first = is_first_step && !motion.has_begun;
    const auto &increment = is_first ? _increment_at_start : motion.increment;
    return {increment.data(), own, _damping_over_step};
}

template <typename Real>
Real CellForces<Real>::add(std::size_t thread, Motion<Real> &motion, bool is_first_step) {
    const Real *const displacement = motion.displacement.data();
    Real *const force = part_of(thread, motion);
    if (_damps_strain && !_viscous)
        return _internal->add(thread, displacement, change_of(motion, is_first_step, Real(1)),
                              force);
    if (_viscous)
        _viscous->add(thread, displacement, change_of(motion, is_first_step, Real(0)),
                      _viscous_parts.empty() ? force : _viscous_parts[thread].data());
    return add_elastic(thread, motion);
}

template <typename Real>
Real CellForces<Real>::add_elastic(std::size_t thread, Motion<Real> &motion) {
    return _internal->add(thread, motion.displacement.data(), {}, part_of(thread, motion));
}

template <typename Real> void CellForces<Real>::sum(std::size_t thread, Motion<Real> &motion) {
    sum_elastic(thread, motion);
    if (keeps_viscous_apart())
        sum_viscous(portions()[thread], motion);
}

template <typename Real>
void CellForces<Real>::sum_elastic(std::size_t thread, Motion<Real> &motion) {
    const Portion &portion = portions()[thread];
    for (std::size_t t = 1; t < _parts.size(); ++t) {
        const Portion &other = portions()[t];
        Real *const part = _parts[t].data();
        const std::size_t last = 4 * std::min(portion.last_owned, other.last_touched);
        for (std::size_t i = 4 * std::max(portion.first_owned, other.first_touched); i < last;
             ++i) {
            motion.force[i] += part[i];
            part[i] = Real(0);
        }
    }
}

template <typename Real>
void CellForces<Real>::sum_viscous(const Portion &portion, Motion<Real> &motion) {
    const std::size_t first = 4 * portion.first_owned, last = 4 * portion.last_owned;
    for (std::size_t i = first; i < last; ++i) {
        motion.viscous[i] = Real(0);
        for (AlignedVector<Real> &part : _viscous_parts)
            motion.viscous[i] += std::exchange(part[i], Real(0));
        motion.force[i] += motion.viscous[i];
    }
}

template <typename Real> void CellForces<Real>::clear(Motion<Real> &motion) {
    std::ranges::fill(motion.force, Real(0));
    for (std::vector<AlignedVector<Real>> *parts : {&_parts, &_viscous_parts})
        for (AlignedVector<Real> &part : *parts)
            std::ranges::fill(part, Real(0));
}

template class CellForces<float>;
template class CellForces<double>;

} // namespace fastsim
