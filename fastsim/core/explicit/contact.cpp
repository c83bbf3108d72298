#include "explicit/contact.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

template <typename Real>
void RigidTools<Real>::add(const TouchSettings &settings, const PointRecords &records,
                           std::span<const double> points, std::span<const Index> vertices,
                           std::span<const double> stiffnesses) {
    Tool tool{settings, {}};
    for (std::size_t k = 0; k < vertices.size(); ++k) {
        const double *place = &points[3 * static_cast<std::size_t>(vertices[k])];
        tool.vertices.push_back(
            {records.first_entry(vertices[k]), {place[0], place[1], place[2]}, stiffnesses[k], {}});
    }
    std::ranges::sort(tool.vertices, {}, &TouchVertex::entry);
    _tools.push_back(std::move(tool));
    for (std::vector<Reaction> &reactions : _reactions)
        reactions.resize(_tools.size());
}

template <typename Real>
void RigidTools<Real>::add_over_facets(const TouchSettings &settings, const PointRecords &records,
                                       std::span<const double> points,
                                       std::span<const Index> facets,
                                       std::span<const double> stiffnesses) {
    add(settings, records, points, {}, {});
    for (std::size_t f = 0; f < stiffnesses.size(); ++f) {
        TouchFacet facet{{}, {}, stiffnesses[f], {}};
        for (std::size_t k = 0; k < 3; ++k) {
            const double *place = &points[3 * static_cast<std::size_t>(facets[3 * f + k])];
            facet.entries[k] = records.first_entry(facets[3 * f + k]);
            facet.rest[k] = {place[0], place[1], place[2]};
        }
        _tools.back().facets.push_back(facet);
    }
}

template <typename Real>
void RigidTools<Real>::add_constraint_over_facets(const TouchSettings &settings,
                                                  FacetConstraint<Real> constraint) {
    _tools.push_back({settings, {}});
    _tools.back().constraint.emplace(std::move(constraint));
    for (std::vector<Reaction> &reactions : _reactions)
        reactions.resize(_tools.size());
}

template <typename Real> bool RigidTools<Real>::has_constraints_over_facets() const {
    return std::ranges::any_of(_tools,
                               [](const Tool &tool) { return tool.constraint.has_value(); });
}

template <typename Real> bool RigidTools<Real>::has_facets() const {
    return std::ranges::any_of(_tools, [](const Tool &tool) { return !tool.facets.empty(); });
}

template <typename Real>
double RigidTools<Real>::touch_facets(std::span<const ToolStep> now, Motion<Real> &motion,
                                      Push<Real> &push) {
    const double work = push.clear(0, motion);
    push.touched[0].clear();
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        tool.on_facets =
            fastsim::touch_facets<Real>(tool.settings, tool.facets, tool.at(now[t]), motion, push);
    }
    return work;
}

template <typename Real>
void RigidTools<Real>::sort_by_distance(std::span<const ToolStep> now, const Motion<Real> &motion,
                                        double part, std::vector<std::size_t> &near) {
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        // In a step of the body no looked at place is farther from its begin than it moves.
        const double margin = 2.0 * tool.on_facets.fastest;
        const Pose pose = tool.at(now[t]);
        const Box box = posed_box(box_of(tool.settings.shape), pose, margin);
        const bool is_sharp = std::holds_alternative<SharpBox>(tool.settings.shape);
        const auto is_near = [&](const TouchFacet &facet) {
            std::array<Point, 3> corner{};
            for (std::size_t k = 0; k < 3; ++k)
                for (std::size_t j = 0; j < 3; ++j)
                    corner[k][j] = facet.rest[k][j] +
                                   static_cast<double>(motion.displacement[facet.entries[k] + j]);
            for (std::size_t j = 0; j < 3; ++j) {
                const auto [low, high] = std::minmax({corner[0][j], corner[1][j], corner[2][j]});
                if (!(low < box.high[j] && high > box.low[j]))
                    return false;
            }
            return is_sharp || !is_clear(tool.settings.shape,
                                         {pose.to_tool(corner[0]), pose.to_tool(corner[1]),
                                          pose.to_tool(corner[2])},
                                         margin);
        };
        const auto end = std::ranges::partition(tool.facets, is_near).begin();
        tool.num_near = static_cast<std::size_t>(end - tool.facets.begin());
        for (std::size_t f = 0; f < tool.num_near; ++f)
            near.insert(near.end(), tool.facets[f].entries.begin(), tool.facets[f].entries.end());
        tool.on_facets.force = along({}, tool.on_facets.force, part);
        tool.on_facets.moment = along({}, tool.on_facets.moment, part);
    }
    std::ranges::sort(near);
    near.erase(std::ranges::unique(near).begin(), near.end());
}

template <typename Real>
void RigidTools<Real>::touch_again(std::span<const ToolStep> now, double part, Motion<Real> &motion,
                                   Push<Real> &push) {
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        const Reaction found = fastsim::touch_facets<Real>(
            tool.settings, {tool.facets.data(), tool.num_near}, tool.at(now[t]), motion, push);
        tool.on_facets.force = along(tool.on_facets.force, found.force, part);
        tool.on_facets.moment = along(tool.on_facets.moment, found.moment, part);
        tool.on_facets.gap = std::min(tool.on_facets.gap, found.gap);
    }
}

template <typename Real> void RigidTools<Real>::reset() {
    for (Tool &tool : _tools) {
        tool.offset = tool.increment = 0.0;
        tool.impulse = {};
        for (TouchVertex &vertex : tool.vertices)
            vertex.way = {};
        for (TouchFacet &facet : tool.facets)
            facet.ways = {};
    }
}

template <typename Real> Pose RigidTools<Real>::Tool::at(const ToolStep &step) const {
    return {along(step.pose.position, settings.direction, offset), step.pose.rotation};
}

template <typename Real> Pose RigidTools<Real>::Tool::after(const ToolStep &step) const {
    // What pushes a driven tool is not known before it has touched: as fast as in the last step.
    const double ahead = offset + increment;
    return {along(step.pose.position, settings.direction, ahead), step.pose.rotation};
}

template <typename Real> bool RigidTools<Real>::Tool::is_known(const Reaction &found) const {
    return found.gap >= -settings.deepest && found.fastest <= 0.5 * settings.deepest;
}

namespace {

/// What pushes some records does along the step ahead [J].
template <typename Real>
double work_ahead(std::span<const std::size_t> records, const Push<Real> &push,
                  const Motion<Real> &motion) {
    double work = 0.0;
    for (const std::size_t first : records)
        for (std::size_t i = first; i < first + 3; ++i)
            if (motion.is_free[i] != 0)
                work += static_cast<double>(push.force[i]) *
                        static_cast<double>(motion.increment_ahead(i));
    return work;
}

} // namespace

template <typename Real>
typename RigidTools<Real>::Touched
RigidTools<Real>::touch(std::size_t thread, const Portion &portion, std::span<const ToolStep> now,
                        std::span<const ToolStep> next, Motion<Real> &motion, Push<Real> &push,
                        const Push<Real> &facets) {
    const double behind = push.clear(thread, motion);
    std::vector<std::size_t> &touched = push.touched[thread];
    touched.clear();
    bool is_known = true;
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        const auto begin = std::ranges::lower_bound(tool.vertices, 4 * portion.first_owned, {},
                                                    &TouchVertex::entry);
        const auto end = std::ranges::lower_bound(begin, tool.vertices.end(),
                                                  4 * portion.last_owned, {}, &TouchVertex::entry);
        Reaction &reaction = _reactions[thread][t];
        reaction = fastsim::touch<Real>(tool.settings, {begin, end}, tool.at(now[t]),
                                        tool.after(next[t]), motion, push, thread);
        if (thread == 0 && !tool.facets.empty())
            reaction = tool.on_facets;
        is_known = is_known && tool.is_known(reaction);
    }
    const auto &on_facets = facets.touched[0]; // ascending
    const auto first = std::ranges::lower_bound(on_facets, 4 * portion.first_owned);
    const auto last = std::ranges::lower_bound(on_facets, 4 * portion.last_owned);
    const double ahead =
        work_ahead<Real>(touched, push, motion) + work_ahead<Real>({first, last}, facets, motion);
    return {is_known, 0.5 * (std::abs(behind) + std::abs(ahead))};
}

template <typename Real>
typename RigidTools<Real>::Touched
RigidTools<Real>::constrain(std::span<const ToolStep> now, std::span<const ToolStep> next,
                            Motion<Real> &motion, Push<Real> &push) {
    const double behind = push.clear(0, motion);
    std::vector<std::size_t> &touched = push.touched[0];
    touched.clear();
    bool is_known = true;
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        if (!tool.constraint)
            continue;
        Reaction &reaction = _reactions[0][t];
        reaction = tool.constraint->touch(tool.settings, tool.at(now[t]), tool.after(next[t]),
                                          motion, push);
        is_known = is_known && tool.is_known(reaction) && tool.constraint->is_solved();
    }
    std::ranges::sort(touched);
    touched.erase(std::ranges::unique(touched).begin(), touched.end());
    const double ahead = work_ahead<Real>(touched, push, motion);
    return {is_known, 0.5 * (std::abs(behind) + std::abs(ahead))};
}

template <typename Real> void RigidTools<Real>::sum_reactions() {
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Reaction &sum = _tools[t].reaction;
        sum = {};
        for (const std::vector<Reaction> &parts : _reactions) {
            sum.force = along(sum.force, parts[t].force, 1.0);
            sum.moment = along(sum.moment, parts[t].moment, 1.0);
            sum.gap = std::min(sum.gap, parts[t].gap);
        }
    }
}

template <typename Real>
void RigidTools<Real>::move(std::span<const ToolStep> now, const Motion<Real> &motion) {
    const double dt = motion.scheme.time_step;
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        Tool &tool = _tools[t];
        tool.impulse = along(tool.impulse, tool.reaction.force, dt);
        if (!(tool.settings.mass > 0.0))
            continue;
        const double push = now[t].drive + dot(tool.settings.direction, tool.reaction.force);
        // From rest: a(-dt) = a(dt), eq. 13.
        const double part = motion.has_begun ? 1.0 : 0.5;
        tool.increment += part * dt * dt * push / tool.settings.mass;
        tool.offset += tool.increment;
    }
}

template <typename Real> std::vector<ToolRecord> RigidTools<Real>::take_records() {
    std::vector<ToolRecord> records;
    for (Tool &tool : _tools) {
        const Reaction &sum = tool.reaction;
        records.push_back({sum.force, sum.moment, tool.impulse, tool.offset, sum.gap});
        tool.impulse = {};
    }
    return records;
}

template <typename Real>
void SelfContact<Real>::set(std::unique_ptr<BodyTouch> touch, std::span<const double> points) {
    _touch = std::move(touch);
    _rest.resize(points.size() / 3);
    for (std::size_t i = 0; i < _rest.size(); ++i)
        _rest[i] = {points[3 * i], points[3 * i + 1], points[3 * i + 2]};
    _places = _rest;
}

template <typename Real>
double SelfContact<Real>::add(const PointRecords &records, Motion<Real> &motion, Push<Real> &push) {
    const double work = push.clear(0, motion);
    std::vector<std::size_t> &touched = push.touched[0];
    touched.clear();
    for (std::size_t i = 0; i < _rest.size(); ++i)
        for (std::size_t j = 0; j < 3; ++j)
            _places[i][j] = _rest[i][j] +
                            static_cast<double>(motion.displacement[4 * records.record_of[i] + j]);
    for (const PointForce &pushed : _touch->find_forces(_places)) {
        const std::size_t first = records.first_entry(pushed.point);
        for (std::size_t j = 0; j < 3; ++j) {
            const Real force = static_cast<Real>(pushed.force[j]);
            push.force[first + j] += force;
            motion.force[first + j] -= force;
        }
        touched.push_back(first);
    }
    return work;
}

template <typename Real> std::pair<std::size_t, double> SelfContact<Real>::overlap() const {
    if (!_touch)
        return {0, 0.0};
    return {_touch->num_touching(), _touch->deepest()};
}

template class RigidTools<float>;
template class RigidTools<double>;
template class SelfContact<float>;
template class SelfContact<double>;

} // namespace fastsim
