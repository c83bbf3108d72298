#include "explicit/loads.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace fastsim {

template <typename Real>
void DeadLoads<Real>::set(const PointRecords &records, std::size_t history,
                          std::span<const double> forces) {
    if (_forces.size() <= history)
        _forces.resize(history + 1, std::vector<double>(4 * records.size(), 0.0));
    records.pack(forces, _forces[history].data());
    _loaded.clear();
    for (std::size_t k = 0; k < _forces.size(); ++k)
        if (std::ranges::any_of(_forces[k], [](double f) { return f != 0.0; }))
            _loaded.push_back(k);
}

template <typename Real>
void DeadLoads<Real>::combine(const Portion &portion, std::span<const double> factors,
                              Motion<Real> &motion) const {
    const std::size_t begin = 4 * portion.first_owned, end = 4 * portion.last_owned;
    Real *const external = motion.external.data();
    if (_loaded.size() == 1) {
        const double factor = factors[_loaded[0]];
        const double *const force = _forces[_loaded[0]].data();
        for (std::size_t i = begin; i < end; ++i)
            external[i] = static_cast<Real>(factor * force[i]);
        return;
    }
    for (std::size_t i = begin; i < end; ++i) {
        double sum = 0.0;
        for (const std::size_t k : _loaded)
            sum += factors[k] * _forces[k][i];
        external[i] = static_cast<Real>(sum);
    }
}

template <typename Real>
typename DeadLoads<Real>::Change DeadLoads<Real>::change(std::span<const double> before,
                                                         std::span<const double> now) const {
    if (before.empty())
        return {true, true};
    Change change{false, false};
    for (const std::size_t k : _loaded) {
        change.is_new = change.is_new || before[k] != now[k];
        const double size = std::max(std::abs(before[k]), std::abs(now[k]));
        change.is_jump = change.is_jump || std::abs(now[k] - before[k]) > 0.05 * size;
    }
    return change;
}

template <typename Real>
void FollowerPressure<Real>::set(const PointRecords &records, std::span<const double> points,
                                 std::span<const Index> facets, std::span<const double> pressures,
                                 std::span<const Index> histories, Push<Real> &push) {
    _points.assign(4 * records.size(), Real(0));
    records.pack(points, _points.data());
    _corners.clear();
    for (const Index i : facets)
        _corners.push_back(records.first_entry(i));
    _pressures.assign(pressures.begin(), pressures.end());
    _histories.assign(histories.begin(), histories.end());
    push.act_on(_corners, records.size());
}

template <typename Real>
double FollowerPressure<Real>::add(std::span<const double> factors, Motion<Real> &motion,
                                   Push<Real> &push) const {
    const double work = push.clear(0, motion);
    const Real *const u = motion.displacement.data();
    for (std::size_t t = 0; t < _pressures.size(); ++t) {
        const std::size_t *corner = &_corners[3 * t];
        std::array<Real, 3> p{}, q{};
        for (std::size_t j = 0; j < 3; ++j) {
            // Rest edges and displacement differences apart: a small motion keeps its digits.
            p[j] = (_points[corner[1] + j] - _points[corner[0] + j]) +
                   (u[corner[1] + j] - u[corner[0] + j]);
            q[j] = (_points[corner[2] + j] - _points[corner[0] + j]) +
                   (u[corner[2] + j] - u[corner[0] + j]);
        }
        const double factor = factors[static_cast<std::size_t>(_histories[t])];
        // A third of half the area vector times the pressure, to each corner.
        const Real sixth = static_cast<Real>(factor * _pressures[t] / 6.0);
        const std::array<Real, 3> outward{p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2],
                                          p[0] * q[1] - p[1] * q[0]};
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t j = 0; j < 3; ++j)
                push.force[corner[k] + j] -= sixth * outward[j];
    }
    for (const std::size_t first : push.touched[0])
        for (std::size_t i = first; i < first + 3; ++i)
            motion.force[i] -= push.force[i];
    return work;
}

template <typename Real>
void MovingSupports<Real>::set(const PointRecords &records, const std::vector<Portion> &portions,
                               std::span<const double> values, std::span<const Index> histories,
                               const Motion<Real> &motion) {
    _supports.assign(portions.size(), {});
    _terms.clear();
    const std::size_t size = 3 * records.size();
    for (std::size_t thread = 0; thread < portions.size(); ++thread)
        for (std::size_t k = portions[thread].first_owned; k < portions[thread].last_owned; ++k)
            for (std::size_t j = 0; j < 3; ++j) {
                const std::size_t first = _terms.size();
                for (std::size_t from = 3 * records.point_of[k] + j; from < values.size();
                     from += size)
                    if (histories[from] >= 0)
                        _terms.push_back({static_cast<std::size_t>(histories[from]), values[from]});
                if (_terms.size() > first)
                    _supports[thread].push_back({4 * k + j, motion.mass[k], first, _terms.size()});
            }
}

template <typename Real>
double MovingSupports<Real>::place(const Support &support, std::span<const double> factors) const {
    double sum = 0.0;
    for (std::size_t t = support.first_term; t < support.last_term; ++t)
        sum += factors[_terms[t].history] * _terms[t].value;
    return sum;
}

template <typename Real>
double MovingSupports<Real>::pull(std::size_t thread, std::span<const double> now,
                                  std::span<const double> next, Motion<Real> &motion,
                                  const Pushes<Real> &pushes) {
    const double dt = motion.scheme.time_step, damping = motion.scheme.mass_damping;
    double work = 0.0;
    for (Support &support : _supports[thread]) {
        const std::size_t i = support.entry;
        support.next = 0.0;
        for (std::size_t t = support.first_term; t < support.last_term; ++t) {
            const Term &term = _terms[t];
            support.next += (next[term.history] - now[term.history]) * term.value;
        }
        // It moved before the start as it does after: no blow at the first step.
        if (!motion.has_begun)
            motion.increment[i] = static_cast<Real>(support.next);
        const double last = static_cast<double>(motion.increment[i]);
        const double inertia =
            (support.next - last) / (dt * dt) + damping * (support.next + last) / (2.0 * dt);
        // Dead loads on it pass straight through to the support.
        const double inner = static_cast<double>(motion.force[i]) + pushes.before_tools(i);
        support.pull = inner + support.mass * inertia;
        // What moves the support's own mass is not the free points'.
        work += 0.5 * inner * (support.next + last);
    }
    return work;
}

template <typename Real>
void MovingSupports<Real>::move(std::size_t thread, std::span<const double> next,
                                Motion<Real> &motion) const {
    for (const Support &support : _supports[thread]) {
        motion.displacement[support.entry] = static_cast<Real>(place(support, next));
        motion.increment[support.entry] = static_cast<Real>(support.next);
    }
}

template <typename Real>
void SlidingSupports<Real>::set(const PointRecords &records, const std::vector<Portion> &portions,
                                std::span<const Index> points, std::span<const double> directions,
                                std::span<const double> values, std::span<const Index> histories) {
    _slides.assign(portions.size(), {});
    for (std::size_t k = 0; k < points.size(); ++k) {
        const std::size_t entry = records.first_entry(points[k]);
        std::size_t thread = 0;
        while (4 * portions[thread].last_owned <= entry)
            ++thread;
        for (std::size_t d = 2 * k; d < 2 * k + 2; ++d)
            if (histories[d] >= 0)
                _slides[thread].push_back(
                    {entry,
                     static_cast<std::size_t>(histories[d]),
                     values[d],
                     {directions[3 * d], directions[3 * d + 1], directions[3 * d + 2]},
                     0.0,
                     0.0,
                     0.0});
    }
}

template <typename Real>
double SlidingSupports<Real>::hold(std::size_t thread, std::span<const double> now,
                                   std::span<const double> next, Motion<Real> &motion) {
    double work = 0.0;
    for (Slide &slide : _slides[thread]) {
        slide.next = (next[slide.history] - now[slide.history]) * slide.value;
        slide.last = 0.0;
        for (std::size_t j = 0; j < 3; ++j)
            slide.last +=
                slide.direction[j] * static_cast<double>(motion.increment[slide.entry + j]);
        // It moved before the start as it does after, like all supports.
        if (!motion.has_begun) {
            for (std::size_t j = 0; j < 3; ++j)
                motion.increment[slide.entry + j] +=
                    static_cast<Real>((slide.next - slide.last) * slide.direction[j]);
            slide.last = slide.next;
            // The speed it has then is its wall's, not gained from nothing.
            const double speed = slide.next / motion.scheme.time_step;
            work += 0.5 * motion.mass[slide.entry / 4] * speed * speed;
        }
        double ahead = 0.0;
        for (std::size_t j = 0; j < 3; ++j)
            ahead +=
                slide.direction[j] * static_cast<double>(motion.increment_ahead(slide.entry + j));
        const double mobility = static_cast<double>(motion.mobility[slide.entry]);
        slide.pull = (slide.next - ahead) / mobility;
        for (std::size_t j = 0; j < 3; ++j)
            motion.force[slide.entry + j] -= static_cast<Real>(slide.pull * slide.direction[j]);
        work += 0.5 * slide.pull * (slide.next + slide.last);
    }
    return work;
}

template <typename Real>
void SlidingSupports<Real>::settle(std::size_t thread, std::span<const double> next,
                                   Motion<Real> &motion) const {
    for (const Slide &slide : _slides[thread]) {
        double off = -next[slide.history] * slide.value;
        for (std::size_t j = 0; j < 3; ++j)
            off += slide.direction[j] * static_cast<double>(motion.displacement[slide.entry + j]);
        for (std::size_t j = 0; j < 3; ++j)
            motion.displacement[slide.entry + j] -= static_cast<Real>(off * slide.direction[j]);
    }
}

template class DeadLoads<float>;
template class DeadLoads<double>;
template class FollowerPressure<float>;
template class FollowerPressure<double>;
template class MovingSupports<float>;
template class MovingSupports<double>;
template class SlidingSupports<float>;
template class SlidingSupports<double>;

} // namespace fastsim
