#include "explicit/tool_touch.hpp"

#include "explicit/facet_points.hpp"
#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

/// Gap of a place in space; see `gap_on_way`.
Gap gap_at(const ToolShape &shape, const Pose &pose, const Point &place, const WayIn &way) {
    Gap found = gap_on_way(shape, pose.to_tool(place), way);
    found.normal = pose.turned_out(found.normal);
    return found;
}

// A vertex with held components leaves the tool along another line than its normal.
constexpr int most_corrections = 6;
// Least cosine between the normals of a step's two ends: beyond it the vertex turned a corner.
constexpr double nearly_one_normal = 0.5;

bool is_round(const ToolShape &shape) {
    return std::holds_alternative<Sphere>(shape) || std::holds_alternative<Capsule>(shape);
}

Point constraint_force(const TouchSettings &tool, const Pose &now, const Pose &next,
                       const Mover &mover, const WayIn &way, Gap &gap) {
    Point force{};
    gap = gap_at(tool.shape, next, mover.after(force), way);
    if (!(gap.distance < 0.0))
        return force;
    Gap last = gap;
    const Point begin =
        is_round(tool.shape) ? gap_at(tool.shape, now, mover.place, way).normal : gap.normal;
    for (int k = 0; k < most_corrections && last.distance < 0.0; ++k) {
        const Point &line = dot(begin, last.normal) > nearly_one_normal ? begin : last.normal;
        double give = 0.0;
        for (std::size_t j = 0; j < 3; ++j)
            give += mover.mobility[j] * last.normal[j] * line[j];
        if (!(give > 0.0))
            break;
        force = along(force, line, -last.distance / give);
        const bool is_free =
            mover.mobility[0] == mover.mobility[1] && mover.mobility[1] == mover.mobility[2];
        if (is_free)
            break;
        last = gap_at(tool.shape, next, mover.after(force), way);
    }
    return force;
}

} // namespace

Point friction_force(const Pose &now, const Pose &next, const Mover &mover, const Point &pushed,
                     const Point &normal, double most) {
    const Point end = mover.after(pushed);
    const Point own = next.to_tool(end);
    const Point came = along(now.position, now.turned_out(own), 1.0);
    Point slip{};
    for (std::size_t j = 0; j < 3; ++j)
        slip[j] = (end[j] - mover.place[j]) - (end[j] - came[j]);
    slip = along(slip, normal, -dot(slip, normal));
    Point force{};
    for (std::size_t j = 0; j < 3; ++j)
        if (mover.mobility[j] > 0.0)
            force[j] = -slip[j] / mover.mobility[j];
    const double size = norm(force);
    return size > most ? along({}, force, most / size) : force;
}

template <typename Real>
Reaction touch(const TouchSettings &tool, std::span<TouchVertex> vertices, const Pose &now,
               const Pose &next, Motion<Real> &motion, Push<Real> &push, std::size_t thread) {
    Reaction reaction{};
    Real fastest(0);
    const auto *const sharp = std::get_if<SharpBox>(&tool.shape);
    const Box box = posed_box(box_of(tool.shape), now, tool.reach);
    for (TouchVertex &vertex : vertices) {
        Point place{};
        bool is_near = true;
        for (std::size_t j = 0; j < 3; ++j) {
            place[j] = vertex.rest[j] + static_cast<double>(motion.displacement[vertex.entry + j]);
            is_near &= place[j] >= box.low[j] && place[j] <= box.high[j];
            fastest = std::max(fastest, std::abs(motion.increment[vertex.entry + j]));
        }
        if (!is_near)
            continue;
        const WayIn way = vertex.way;
        if (sharp != nullptr)
            vertex.way = way_from(*sharp, now.to_tool(place), way);
        Point force{};
        Gap gap{};
        if (tool.is_constraint) {
            const Mover mover = mover_of(motion, vertex.entry, place);
            force = constraint_force(tool, now, next, mover, vertex.way, gap);
            reaction.gap = std::min(reaction.gap, gap.distance);
            if (!(gap.distance < 0.0))
                continue;
        } else {
            gap = gap_at(tool.shape, now, place, way);
            reaction.gap = std::min(reaction.gap, gap.distance);
            if (!(gap.distance < 0.0))
                continue;
            force = along({}, gap.normal, -gap.distance * vertex.stiffness);
        }
        if (tool.friction > 0.0) {
            const Mover mover = mover_of(motion, vertex.entry, place);
            const double most = tool.friction * norm(force);
            force = along(force, friction_force(now, next, mover, force, gap.normal, most), 1.0);
        }
        // What acts on the body is rounded to its precision; just that acts back on the tool.
        Point acting{};
        for (std::size_t j = 0; j < 3; ++j) {
            const Real rounded = static_cast<Real>(force[j]);
            motion.force[vertex.entry + j] -= rounded;
            push.force[vertex.entry + j] += rounded;
            acting[j] = static_cast<double>(rounded);
            reaction.force[j] -= acting[j];
        }
        const Point moment = cross(minus(place, now.position), acting);
        reaction.moment = along(reaction.moment, moment, -1.0);
        push.touched[thread].push_back(vertex.entry);
    }
    reaction.fastest = static_cast<double>(fastest);
    return reaction;
}

bool is_clear(const ToolShape &shape, const std::array<Point, 3> &corner, double margin) {
    Point middle{};
    for (const Point &place : corner)
        middle = along(middle, place, 1.0 / 3.0);
    double squared = 0.0;
    for (const Point &place : corner) {
        const Point way = minus(place, middle);
        squared = std::max(squared, dot(way, way));
    }
    const double distance = gap_of(shape, middle).distance - margin;
    return distance > 0.0 && distance * distance > squared;
}

namespace {

/// Adds the forces over the area on the corners, in the tool's frame; returns the smallest gap.
double add_facet_forces(const ToolShape &shape, const std::array<Point, 3> &corner,
                        TouchFacet &facet, std::array<Point, 3> &force) {
    double smallest = std::numeric_limits<double>::infinity();
    const auto *const sharp = std::get_if<SharpBox>(&shape);
    for (std::size_t q = 0; q < facet_points.size(); ++q) {
        const Point &part = facet_points[q];
        Point place{};
        for (std::size_t k = 0; k < 3; ++k)
            place = along(place, corner[k], part[k]);
        const Gap gap = gap_on_way(shape, place, facet.ways[q]);
        if (sharp != nullptr)
            facet.ways[q] = way_from(*sharp, place, facet.ways[q]);
        smallest = std::min(smallest, gap.distance);
        if (gap.distance < 0.0)
            for (std::size_t k = 0; k < 3; ++k)
                force[k] =
                    along(force[k], gap.normal, -gap.distance * facet.stiffness / 12.0 * part[k]);
    }
    return smallest;
}

} // namespace

template <typename Real>
Reaction touch_facets(const TouchSettings &tool, std::span<TouchFacet> facets, const Pose &now,
                      Motion<Real> &motion, Push<Real> &push) {
    Reaction reaction{};
    Real fastest(0);
    // Beside a box they are seen before they come in.
    const bool is_sharp = std::holds_alternative<SharpBox>(tool.shape);
    const Box box = posed_box(box_of(tool.shape), now, is_sharp ? tool.reach : 0.0);
    for (TouchFacet &facet : facets) {
        std::array<Point, 3> corner{}, force{};
        Point low = box.high, high = box.low;
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t j = 0; j < 3; ++j) {
                const std::size_t i = facet.entries[k] + j;
                corner[k][j] = facet.rest[k][j] + static_cast<double>(motion.displacement[i]);
                low[j] = std::min(low[j], corner[k][j]);
                high[j] = std::max(high[j], corner[k][j]);
                fastest = std::max(fastest, std::abs(motion.increment[i]));
            }
        bool is_near = true;
        for (std::size_t j = 0; j < 3; ++j)
            is_near &= low[j] < box.high[j] && high[j] > box.low[j];
        if (!is_near)
            continue;
        const std::array<Point, 3> own{now.to_tool(corner[0]), now.to_tool(corner[1]),
                                       now.to_tool(corner[2])};
        if (!is_sharp && is_clear(tool.shape, own, 0.0))
            continue;
        const double gap = add_facet_forces(tool.shape, own, facet, force);
        reaction.gap = std::min(reaction.gap, gap);
        if (!(gap < 0.0))
            continue;
        for (std::size_t k = 0; k < 3; ++k) {
            const Point given = now.turned_out(force[k]);
            Point acting{};
            for (std::size_t j = 0; j < 3; ++j) {
                const Real rounded = static_cast<Real>(given[j]);
                motion.force[facet.entries[k] + j] -= rounded;
                push.force[facet.entries[k] + j] += rounded;
                acting[j] = static_cast<double>(rounded);
                reaction.force[j] -= acting[j];
            }
            const Point moment = cross(minus(corner[k], now.position), acting);
            reaction.moment = along(reaction.moment, moment, -1.0);
            push.touched[0].push_back(facet.entries[k]);
        }
    }
    reaction.fastest = static_cast<double>(fastest);
    return reaction;
}

template Reaction touch_facets(const TouchSettings &, std::span<TouchFacet>, const Pose &,
                               Motion<float> &, Push<float> &);
template Reaction touch_facets(const TouchSettings &, std::span<TouchFacet>, const Pose &,
                               Motion<double> &, Push<double> &);
template Reaction touch(const TouchSettings &, std::span<TouchVertex>, const Pose &, const Pose &,
                        Motion<float> &, Push<float> &, std::size_t);
template Reaction touch(const TouchSettings &, std::span<TouchVertex>, const Pose &, const Pose &,
                        Motion<double> &, Push<double> &, std::size_t);

} // namespace fastsim
