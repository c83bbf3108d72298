#include "explicit/springs.hpp"

#include <algorithm>
#include <array>

namespace fastsim {

template <typename Real>
void PatchSprings<Real>::set(const PointRecords &records, std::span<const Index> facets,
                             std::span<const double> stiffnesses, std::span<const Index> histories,
                             Push<Real> &push) {
    reset();
    _corners.clear();
    for (const Index i : facets)
        _corners.push_back(records.first_entry(i));
    _stiffnesses.assign(stiffnesses.begin(), stiffnesses.end());
    _histories.assign(histories.begin(), histories.end());
    push.act_on(_corners, records.size());
}

template <typename Real>
double PatchSprings<Real>::energy(std::span<const double> factors,
                                  const Motion<Real> &motion) const {
    double energy = 0.0;
    for (std::size_t t = 0; t < _histories.size(); ++t) {
        const double *const anchor = factors.data() + _histories[t];
        for (std::size_t j = 0; j < 3; ++j) {
            std::array<double, 3> apart{};
            for (std::size_t k = 0; k < 3; ++k)
                apart[k] = anchor[1 + j] -
                           static_cast<double>(motion.displacement[_corners[3 * t + k] + j]);
            for (std::size_t k = 0; k < 9; ++k)
                energy += 0.5 * anchor[0] * static_cast<double>(_stiffnesses[9 * t + k]) *
                          apart[k / 3] * apart[k % 3];
        }
    }
    return energy;
}

template <typename Real>
double PatchSprings<Real>::add(std::span<const double> factors, Motion<Real> &motion,
                               Push<Real> &push) {
    double given = 0.0;
    if (_last_factors.empty())
        given = energy(factors, motion);
    else if (!std::ranges::equal(factors, _last_factors))
        given = energy(factors, motion) - energy(_last_factors, motion);
    _last_factors.assign(factors.begin(), factors.end());
    static_cast<void>(push.clear(0, motion));
    const Real *const u = motion.displacement.data();
    for (std::size_t t = 0; t < _histories.size(); ++t) {
        const double *const anchor = factors.data() + _histories[t];
        const Real factor = static_cast<Real>(anchor[0]);
        for (std::size_t j = 0; j < 3; ++j) {
            const Real d = static_cast<Real>(anchor[1 + j]);
            for (std::size_t k = 0; k < 3; ++k) {
                Real sum(0);
                for (std::size_t l = 0; l < 3; ++l)
                    sum += _stiffnesses[9 * t + 3 * k + l] * (d - u[_corners[3 * t + l] + j]);
                push.force[_corners[3 * t + k] + j] += factor * sum;
            }
        }
    }
    for (const std::size_t first : push.touched[0])
        for (std::size_t i = first; i < first + 3; ++i)
            motion.force[i] -= push.force[i];
    return given;
}

template class PatchSprings<float>;
template class PatchSprings<double>;

} // namespace fastsim
