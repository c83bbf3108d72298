// Contact in an explicit run: whom rigid tools touch, their own motion, and what they feel; and the
// body with itself.
#include "mechanics/explicit_run.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>

namespace fastsim {

template <typename Real>
void ExplicitRun<Real>::add_tool(const TouchSettings &settings, std::span<const double> points,
                                 std::span<const Index> vertices,
                                 std::span<const double> stiffnesses) {
    Tool tool{settings, {}};
    for (std::size_t k = 0; k < vertices.size(); ++k) {
        const auto point = static_cast<std::size_t>(vertices[k]);
        tool.vertices.push_back({4 * _record_of[point],
                                 {points[3 * point], points[3 * point + 1], points[3 * point + 2]},
                                 stiffnesses[k]});
    }
    std::ranges::sort(tool.vertices, {}, &TouchVertex::entry);
    _tools.push_back(std::move(tool));
    _contact_force.assign(4 * _num_points, Real(0));
    for (Share &share : _shares)
        share.reactions.resize(_tools.size());
}

template <typename Real> void ExplicitRun<Real>::rest_tools() {
    std::fill(_contact_force.begin(), _contact_force.end(), Real(0));
    std::fill(_body_force.begin(), _body_force.end(), Real(0));
    _body_entries.clear();
    for (Tool &tool : _tools) {
        tool.offset = tool.increment = 0.0;
        tool.impulse = {};
    }
    for (Share &share : _shares)
        share.touched.clear();
}

template <typename Real>
Pose ExplicitRun<Real>::pose_of(const Tool &tool, std::span<const double> row) const {
    Pose pose = Pose::from(row);
    pose.position = along(pose.position, tool.settings.direction, tool.offset);
    return pose;
}

/// Adds the tools' forces on the points of a thread. Returns whether no vertex is so deep in a
/// tool, or so fast, that it may come out on the other side.
template <typename Real> bool ExplicitRun<Real>::touch_tools(Share &share, const Step &step) {
    // As along every increment, half of the force's work behind it and half ahead.
    double behind = 0.0, ahead = 0.0;
    for (const std::size_t first : share.touched)
        for (std::size_t i = first; i < first + 3; ++i) {
            if (_is_free[i] != 0)
                behind +=
                    static_cast<double>(_contact_force[i]) * static_cast<double>(_increment[i]);
            _contact_force[i] = Real(0);
        }
    share.touched.clear();
    const TouchedBody<Real> body{_displacement.data(),
                                 _increment.data(),
                                 _external.data(),
                                 _mobility.data(),
                                 _shares[0].force.data(),
                                 _contact_force.data(),
                                 _keep};
    bool is_known = true;
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        const Tool &tool = _tools[t];
        const auto begin =
            std::ranges::lower_bound(tool.vertices, 4 * share.first_owned, {}, &TouchVertex::entry);
        const auto end = std::ranges::lower_bound(begin, tool.vertices.end(), 4 * share.last_owned,
                                                  {}, &TouchVertex::entry);
        share.reactions[t] =
            touch(tool.settings, {begin, end}, pose_of(tool, step.poses.subspan(pose_size * t)),
                  pose_of(tool, step.next_poses.subspan(pose_size * t)), body, share.touched);
        is_known = is_known && share.reactions[t].gap >= -tool.settings.deepest &&
                   share.reactions[t].fastest <= 0.5 * tool.settings.deepest;
    }
    for (const std::size_t first : share.touched)
        for (std::size_t i = first; i < first + 3; ++i)
            if (_is_free[i] != 0)
                ahead += static_cast<double>(_contact_force[i]) *
                         static_cast<double>(_keep * _increment[i] +
                                             _mobility[i] * (_external[i] - body.force[i]));
    share.given += 0.5 * (std::abs(behind) + std::abs(ahead));
    return is_known;
}

template <typename Real> void ExplicitRun<Real>::get_contact_force(std::span<double> force) const {
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            double sum = 0.0;
            for (const auto *pushed : {&_contact_force, &_body_force})
                if (!pushed->empty())
                    sum += static_cast<double>((*pushed)[4 * _record_of[i] + j]);
            force[3 * i + j] = sum;
        }
}

template <typename Real>
void ExplicitRun<Real>::set_body_touch(std::unique_ptr<BodyTouch> touch,
                                       std::span<const double> points) {
    _body_touch = std::move(touch);
    _body_force.assign(4 * _num_points, Real(0));
    _rest_places.resize(_num_points);
    for (std::size_t i = 0; i < _num_points; ++i)
        _rest_places[i] = {points[3 * i], points[3 * i + 1], points[3 * i + 2]};
    _places = _rest_places;
}

template <typename Real> std::pair<std::size_t, double> ExplicitRun<Real>::body_touches() const {
    if (!_body_touch)
        return {0, 0.0};
    return {_body_touch->num_touching(), _body_touch->deepest()};
}

/// Contact within the body; one thread does it while the others add the forces of their cells.
template <typename Real> void ExplicitRun<Real>::touch_body() {
    double work = 0.0;
    for (const std::size_t first : _body_entries)
        for (std::size_t i = first; i < first + 3; ++i) {
            if (_is_free[i] != 0)
                work += static_cast<double>(_body_force[i]) * static_cast<double>(_increment[i]);
            _body_force[i] = Real(0);
        }
    _body_entries.clear();
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            _places[i][j] =
                _rest_places[i][j] + static_cast<double>(_displacement[4 * _record_of[i] + j]);
    Real *const total = _shares[0].force.data();
    for (const PointForce &push : _body_touch->find_forces(_places)) {
        const std::size_t first = 4 * _record_of[static_cast<std::size_t>(push.point)];
        for (std::size_t j = 0; j < 3; ++j) {
            const Real force = static_cast<Real>(push.force[j]);
            _body_force[first + j] += force;
            total[first + j] -= force;
        }
        _body_entries.push_back(first);
    }
    // Not into what was given: the other threads may still be reading that.
    _shares[0].pressure_work += std::abs(work);
}

/// Once all threads have touched: what each tool feels.
template <typename Real> void ExplicitRun<Real>::sum_reactions() {
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Reaction &sum = _tools[t].reaction;
        sum = {};
        for (const Share &share : _shares) {
            const Reaction &part = share.reactions[t];
            sum.force = along(sum.force, part.force, 1.0);
            sum.moment = along(sum.moment, part.moment, 1.0);
            sum.gap = std::min(sum.gap, part.gap);
        }
    }
}

/// Force, moment, impulse since the last record, offset and smallest gap of each tool.
template <typename Real> void ExplicitRun<Real>::record_tools(std::span<double> row) {
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        double *const out = row.data() + reaction_size * t;
        std::copy_n(tool.reaction.force.begin(), 3, out);
        std::copy_n(tool.reaction.moment.begin(), 3, out + 3);
        std::copy_n(tool.impulse.begin(), 3, out + 6);
        out[9] = tool.offset;
        out[10] = tool.reaction.gap;
        tool.impulse = {};
    }
}

/// The step of the tools that are driven by a force.
template <typename Real> void ExplicitRun<Real>::move_tools(const Step &step) {
    const double dt = _settings.time_step;
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        tool.impulse = along(tool.impulse, tool.reaction.force, dt);
        if (!(tool.settings.mass > 0.0))
            continue;
        const double drive = step.poses[pose_size * t + pose_size - 1];
        const double push = drive + dot(tool.settings.direction, tool.reaction.force);
        // From rest: a(-dt) = a(dt), eq. 13.
        const double part = _has_begun ? 1.0 : 0.5;
        tool.increment += part * dt * dt * push / tool.settings.mass;
        tool.offset += tool.increment;
    }
}

template class ExplicitRun<float>;
template class ExplicitRun<double>;

} // namespace fastsim
