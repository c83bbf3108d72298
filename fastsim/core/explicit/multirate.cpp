#include "explicit/multirate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fastsim {

namespace {

constexpr double nu = 1.0 + 1.5 * 1.5 / 8.0;
constexpr double chebyshev = 2.0 * nu * nu - 1.0; // T_2
constexpr double theta = chebyshev / (8.0 * nu * nu);
constexpr double squared_ratio = 0.3;

} // namespace

double ratio_of_classes() { return std::sqrt(squared_ratio); }

template <typename Real>
Multirate<Real>::Multirate(const ElasticBody &body, const PointRecords &records,
                           const KernelChoice<Real> &kernel, std::span<const Index> class_of,
                           Index last, const Motion<Real> &motion)
    : _per_mass(records.padded_size(), Real(0)), _frozen(records.padded_size(), Real(0)),
      _mean(records.padded_size(), Real(0)), _is_smoothed(body.patches.has_value()),
      _part(Real(1) / static_cast<Real>(Index{1} << last)) {
    const std::vector<Index> finest = finest_at_points(body, class_of);
    for (Index k = 1; k <= last; ++k) {
        const auto count = std::ranges::count_if(finest, [&](Index of) { return of >= k; });
        Level level{InternalForce<Real>::make_of_class(body, records, kernel, class_of, k),
                    4 * static_cast<std::size_t>(count)};
        for (auto *array : {&level.place, &level.force, &level.net, &level.first})
            array->assign(records.padded_size(), Real(0));
        _levels.push_back(std::move(level));
    }
    for (std::size_t i = 0; i < motion.is_free.size(); ++i)
        if (motion.is_free[i] != 0)
            _per_mass[i] = static_cast<Real>(1.0 / motion.mass[i / 4]);
    for (auto *array : {&_touching.displacement, &_touching.increment, &_touching.force})
        array->assign(records.padded_size(), Real(0));
    _touching.is_free = motion.is_free;
    _push.force.assign(records.padded_size(), Real(0));
    _push.touched.resize(1);
}

template <typename Real> Real Multirate<Real>::add_forces(Motion<Real> &motion) {
    Real least(1);
    for (Level &level : _levels) {
        std::fill_n(level.force.data(), level.num_entries, Real(0));
        const Real found = level.cells->add(0, motion.displacement.data(), {}, level.force.data());
        least = found > least ? least : found; // NaN is handed on
        for (std::size_t i = 0; i < level.num_entries; ++i)
            motion.force[i] += level.force[i];
    }
    return least;
}

template <typename Real>
Real Multirate<Real>::average(Motion<Real> &motion, RigidTools<Real> &tools,
                              std::span<const ToolStep> now, Push<Real> &facets) {
    _least = Real(1);
    _tools = tools.has_facets() ? &tools : nullptr;
    _now = now;
    _facets = &facets;
    take_points_near(tools, now, motion);
    if (_is_smoothed) // cells of other classes are strained here and there
        for (Level &level : _levels)
            level.place = motion.displacement;
    _levels[0].for_each_entry([&](std::size_t i) {
        _frozen[i] = motion.external[i] - motion.force[i];
        for (const Level &level : _levels)
            _frozen[i] += level.force[i];
    });
    for (const std::size_t first : _near)
        for (std::size_t i = first; i < first + 3; ++i) {
            _push.force[i] = std::exchange(facets.force[i], Real(0)); // of the first look
            _frozen[i] -= _push.force[i];
        }
    const double step = motion.scheme.time_step;
    find_mean(0, {motion.displacement.data(), _frozen.data(), static_cast<Real>(step * step), true},
              _mean.data());
    _levels[0].for_each_entry([&](std::size_t i) {
        if (motion.is_free[i] != 0)
            motion.force[i] = motion.external[i] - _mean[i];
    });
    if (_tools != nullptr)
        facets.touched[0] = _near;
    return _least;
}

/// Points of facets near the tools move with all classes: a tool may touch cells of any.
template <typename Real>
void Multirate<Real>::take_points_near(RigidTools<Real> &tools, std::span<const ToolStep> now,
                                       const Motion<Real> &motion) {
    for (Level &level : _levels)
        level.near.clear();
    _near.clear();
    if (_tools == nullptr)
        return;
    tools.sort_by_distance(now, motion, static_cast<double>(_part), _near);
    for (Level &level : _levels)
        for (const std::size_t first : _near)
            if (first >= level.num_entries)
                level.near.push_back(first);
    _touching.increment = motion.increment;
}

template <typename Real>
void Multirate<Real>::find_mean(std::size_t number, const Task &task, Real *mean) {
    Level &level = _levels[number];
    find_inner(number, task.place, task, level.first.data());
    const Real way = static_cast<Real>(theta) * task.squared_step;
    level.for_each_entry(
        [&, place = level.place.data(), first = level.first.data()](std::size_t i) {
            place[i] = task.place[i] + way * _per_mass[i] * first[i];
        });
    find_inner(number, level.place.data(),
               {level.place.data(), task.frozen, task.squared_step, false}, mean);
    level.for_each_entry([mean, first = level.first.data()](std::size_t i) {
        mean[i] = Real(0.5) * (first[i] + mean[i]);
    });
}

/// G of the finer classes, at a place.
template <typename Real>
void Multirate<Real>::find_inner(std::size_t number, const Real *place, const Task &task,
                                 Real *mean) {
    Level &level = _levels[number];
    if (!task.is_first) {
        std::fill_n(level.force.data(), level.num_entries, Real(0));
        const Real found = level.cells->add(0, place, {}, level.force.data());
        _least = found > _least ? _least : found;
    }
    level.for_each_entry(
        [mean, frozen = task.frozen, net = level.net.data(),
         force = level.force.data()](std::size_t i) { mean[i] = net[i] = frozen[i] - force[i]; });
    if (number + 1 < _levels.size()) {
        find_mean(number + 1,
                  {place, level.net.data(), static_cast<Real>(squared_ratio) * task.squared_step,
                   task.is_first},
                  mean);
        return;
    }
    if (_tools == nullptr)
        return;
    if (!task.is_first)
        touch(place);
    for (const std::size_t first : _near)
        for (std::size_t i = first; i < first + 3; ++i) {
            mean[i] += _push.force[i];
            _facets->force[i] += _part * _push.force[i];
            _push.force[i] = Real(0);
        }
}

template <typename Real> void Multirate<Real>::touch(const Real *place) {
    for (const std::size_t first : _near)
        std::copy_n(place + first, 3, &_touching.displacement[first]);
    _push.touched[0].clear();
    _tools->touch_again(_now, static_cast<double>(_part), _touching, _push);
    for (const std::size_t first : _push.touched[0])
        std::fill_n(&_touching.force[first], 3, Real(0));
}

template class Multirate<float>;
template class Multirate<double>;

} // namespace fastsim
