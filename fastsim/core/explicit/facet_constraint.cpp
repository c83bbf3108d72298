#include "explicit/facet_constraint.hpp"

#include "explicit/facet_points.hpp"
#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace fastsim {

// An average differs from the gap of its vertex by less than 1.4 of the longest edge: the gap
// changes by no more than the way, and the sum of |4 phi - 1| w times the ways is that of the 12
// points. The rest is for edges that are longer than at rest.
constexpr double reach_in_edges = 2.5;
// So much longer.
constexpr double stretch = 1.8;
// Of an edge, for what the multipliers of neighbours move a vertex by.
constexpr double moved_by_others = 0.25;
// Of constraints: their average is unknown, or known and too far off to push.
constexpr std::int32_t far_off = -1, without_row = -2;

namespace {

/// How far from the tool an average's vertex may be, if the average is to be inside [m].
///
/// A gap that was linear over the facets would have the vertex's as its average. One with a
/// curvature up to kappa differs from its linear interpolation by kappa e^2 / 6 at most, e the
/// longest edge, and the average by 2.4 times that, the mean of |4 phi - 1| over that of phi.
double reach_of(const ToolShape &shape, double gap, double edge) {
    const double longest = stretch * edge, widest = reach_in_edges * edge;
    double curvature = 0.0; // of a plane
    if (const double radius = std::holds_alternative<Sphere>(shape) ? std::get<Sphere>(shape).radius
                              : std::holds_alternative<Capsule>(shape)
                                  ? std::get<Capsule>(shape).radius
                                  : 0.0;
        radius > 0.0) {
        const double nearest = radius + gap - longest; // of the facets to the centre or line
        if (nearest <= 0.0)
            return widest;
        curvature = 1.0 / nearest;
    } else if (!std::holds_alternative<HalfSpace>(shape)) {
        return widest;
    }
    return std::min(widest, 0.4 * curvature * longest * longest + moved_by_others * edge);
}

Point weighted(const std::array<Point, 3> &corner, const Point &part) {
    Point place{};
    for (std::size_t k = 0; k < 3; ++k)
        place = along(place, corner[k], part[k]);
    return place;
}

} // namespace

template <typename Real>
FacetConstraint<Real>::FacetConstraint(const PointRecords &records, std::span<const double> points,
                                       std::span<const Index> facets,
                                       std::span<const double> facet_areas,
                                       std::span<const Index> constraints,
                                       std::span<const double> areas)
    : _row_of(areas.size(), far_off), _averages(areas.size()) {
    std::unordered_map<Index, std::uint32_t> numbers;
    for (std::size_t f = 0; f < facet_areas.size(); ++f) {
        Facet corners{};
        for (std::size_t k = 0; k < 3; ++k) {
            const Index point = facets[3 * f + k];
            const auto [at, is_new] =
                numbers.try_emplace(point, static_cast<std::uint32_t>(_vertices.size()));
            if (is_new) {
                const double *place = &points[3 * static_cast<std::size_t>(point)];
                _vertices.push_back({records.first_entry(point), {place[0], place[1], place[2]}});
            }
            const Index own = constraints[3 * f + k];
            const double share = own < 0
                                     ? 0.0
                                     : facet_areas[f] / (static_cast<double>(facet_points.size()) *
                                                         areas[static_cast<std::size_t>(own)]);
            corners[k] = {at->second, own, share};
        }
        double longest = 0.0;
        for (std::size_t k = 0; k < 3; ++k)
            longest = std::max(longest, norm(minus(_vertices[corners[k].vertex].rest,
                                                   _vertices[corners[(k + 1) % 3].vertex].rest)));
        for (const Corner &corner : corners)
            _vertices[corner.vertex].edge = std::max(_vertices[corner.vertex].edge, longest);
        _margin = std::max(_margin, reach_in_edges * longest);
        _facets.push_back(corners);
    }
    _ahead.resize(_vertices.size());
}

template <typename Real>
Reaction FacetConstraint<Real>::touch(const TouchSettings &tool, const Pose &now, const Pose &next,
                                      Motion<Real> &motion, Push<Real> &push) {
    Reaction reaction{};
    _is_solved = true;
    if (!look(tool, now, next, motion, reaction))
        return reaction;
    average(tool, next, motion);
    for (const std::int32_t constraint : _averaged)
        reaction.gap = std::min(reaction.gap, _averages[static_cast<std::size_t>(constraint)]);
    if (reaction.gap < 0.0) {
        differentiate(tool, next, motion);
        solve();
        if (tool.friction > 0.0)
            drag(tool, now, next, motion);
        act(now, motion, push, reaction);
    }
    for (const std::int32_t constraint : _averaged)
        _row_of[static_cast<std::size_t>(constraint)] = far_off;
    _averaged.clear();
    return reaction;
}

/// Finds the vertices that are near the tool at the end of the step; false where none is.
template <typename Real>
bool FacetConstraint<Real>::look(const TouchSettings &tool, const Pose &now, const Pose &next,
                                 const Motion<Real> &motion, Reaction &reaction) {
    Real fastest(0);
    bool is_any = false;
    const Box box = posed_box(box_of(tool.shape), now, tool.reach + _margin);
    for (std::uint32_t v = 0; v < _vertices.size(); ++v) {
        const Vertex &vertex = _vertices[v];
        _ahead[v].is_known = _ahead[v].is_near = false;
        bool is_in = true;
        for (std::size_t j = 0; j < 3; ++j) {
            const std::size_t i = vertex.entry + j;
            const double place = vertex.rest[j] + static_cast<double>(motion.displacement[i]);
            is_in &= place >= box.low[j] && place <= box.high[j];
            fastest = std::max(fastest, std::abs(motion.increment[i]));
        }
        if (!is_in)
            continue;
        const Point place = next.to_tool(ahead(v, motion).place);
        const double gap = gap_of(tool.shape, place).distance;
        _ahead[v].is_near = gap < reach_of(tool.shape, gap, vertex.edge);
        is_any |= _ahead[v].is_near;
    }
    reaction.fastest = static_cast<double>(fastest);
    return is_any;
}

template <typename Real>
const typename FacetConstraint<Real>::Ahead &
FacetConstraint<Real>::ahead(std::uint32_t vertex, const Motion<Real> &motion) {
    Ahead &found = _ahead[vertex];
    if (found.is_known)
        return found;
    const auto &[entry, rest, edge] = _vertices[vertex];
    Point now = rest;
    for (std::size_t j = 0; j < 3; ++j)
        now[j] += static_cast<double>(motion.displacement[entry + j]);
    const Mover mover = mover_of(motion, entry, now);
    found.mobility = mover.mobility;
    found.place = mover.after({});
    found.force = {};
    found.is_known = true;
    return found;
}

template <typename Real>
typename FacetConstraint<Real>::Row &FacetConstraint<Real>::row_of(const Corner &corner) {
    std::int32_t &row = _row_of[static_cast<std::size_t>(corner.constraint)];
    if (row == without_row) {
        row = static_cast<std::int32_t>(_rows.size());
        _rows.push_back({corner.vertex, _averages[static_cast<std::size_t>(corner.constraint)]});
    }
    return _rows[static_cast<std::size_t>(row)];
}

/// The gaps of the constraints of vertices near the tool, and of those that may push a row each.
template <typename Real>
void FacetConstraint<Real>::average(const TouchSettings &tool, const Pose &next,
                                    const Motion<Real> &motion) {
    _near.clear();
    for (const Facet &facet : _facets) {
        const auto is_asked = [&](const Corner &corner) {
            return corner.constraint >= 0 && _ahead[corner.vertex].is_near;
        };
        if (std::ranges::none_of(facet, is_asked))
            continue;
        const std::array<Point, 3> place = places_of(facet, next, motion);
        std::array<double, 3> gaps{};
        for (const Point &part : facet_points) {
            const double distance = gap_of(tool.shape, weighted(place, part)).distance;
            for (std::size_t k = 0; k < 3; ++k)
                gaps[k] += facet[k].share * (4.0 * part[k] - 1.0) * distance;
        }
        for (std::size_t k = 0; k < 3; ++k)
            if (is_asked(facet[k])) {
                const auto constraint = static_cast<std::size_t>(facet[k].constraint);
                if (_row_of[constraint] == far_off) {
                    _row_of[constraint] = without_row;
                    _averages[constraint] = 0.0;
                    _averaged.push_back(facet[k].constraint);
                }
                _averages[constraint] += gaps[k];
            }
        _near.push_back(&facet);
    }
}

/// The gradients of the averages that neighbours may bring inside.
template <typename Real>
void FacetConstraint<Real>::differentiate(const TouchSettings &tool, const Pose &next,
                                          const Motion<Real> &motion) {
    _rows.clear();
    for (const Facet *const facet : _near) {
        const auto may_push = [&](const Corner &corner) {
            return corner.constraint >= 0 && _ahead[corner.vertex].is_near &&
                   _averages[static_cast<std::size_t>(corner.constraint)] <
                       moved_by_others * _vertices[corner.vertex].edge;
        };
        if (std::ranges::none_of(*facet, may_push))
            continue;
        const std::array<Point, 3> place = places_of(*facet, next, motion);
        // By corner: the gradients of the average's part by the three.
        std::array<std::array<Point, 3>, 3> gradients{};
        for (const Point &part : facet_points) {
            const Point normal = gap_of(tool.shape, weighted(place, part)).normal;
            for (std::size_t k = 0; k < 3; ++k) {
                const double share = (*facet)[k].share * (4.0 * part[k] - 1.0);
                for (std::size_t l = 0; l < 3; ++l)
                    gradients[k][l] = along(gradients[k][l], normal, share * part[l]);
            }
        }
        for (std::size_t k = 0; k < 3; ++k) {
            if (!may_push((*facet)[k]))
                continue;
            Row &row = row_of((*facet)[k]);
            for (std::size_t l = 0; l < 3; ++l) {
                const std::uint32_t vertex = (*facet)[l].vertex;
                const Point gradient = next.turned_out(gradients[k][l]);
                const auto known = std::ranges::find(row.parts, vertex, &Part::vertex);
                if (known == row.parts.end())
                    row.parts.push_back({vertex, gradient});
                else
                    known->gradient = along(known->gradient, gradient, 1.0);
            }
        }
    }
}

/// Where the corners of a facet would be at the end of the step, in the tool's frame.
template <typename Real>
std::array<Point, 3> FacetConstraint<Real>::places_of(const Facet &facet, const Pose &next,
                                                      const Motion<Real> &motion) {
    std::array<Point, 3> place{};
    for (std::size_t k = 0; k < 3; ++k)
        place[k] = next.to_tool(ahead(facet[k].vertex, motion).place);
    return place;
}

/// Adds rows that would be inside with the multipliers known so far; false where there are none.
template <typename Real> bool FacetConstraint<Real>::add_active() {
    for (const Row &row : _rows)
        for (const Part &part : row.parts)
            _ahead[part.vertex].force = {};
    for (const std::size_t r : _active)
        for (const Part &part : _rows[r].parts)
            _ahead[part.vertex].force =
                along(_ahead[part.vertex].force, part.gradient, _rows[r].multiplier);
    const std::size_t before = _active.size();
    for (std::size_t r = 0; r < _rows.size(); ++r) {
        Row &row = _rows[r];
        if (row.is_active)
            continue;
        double gap = row.gap, give = 0.0;
        for (const Part &part : row.parts)
            for (std::size_t j = 0; j < 3; ++j) {
                const double moved = part.gradient[j] * _ahead[part.vertex].mobility[j];
                gap += moved * _ahead[part.vertex].force[j];
                give += moved * part.gradient[j];
            }
        if (gap < 0.0 && give > 0.0) {
            row.is_active = true;
            _active.push_back(r);
        }
    }
    return _active.size() > before;
}

template <typename Real> void FacetConstraint<Real>::solve() {
    _active.clear();
    while (_is_solved && add_active()) {
        const std::size_t n = _active.size();
        _matrix.assign(n * n, 0.0);
        _right.resize(n);
        _found.assign(n, 0.0);
        for (const std::size_t r : _active)
            for (const Part &part : _rows[r].parts)
                _ahead[part.vertex].force = {};
        for (std::size_t a = 0; a < n; ++a) {
            const Row &row = _rows[_active[a]];
            // W G^T of the row, where the forces stand.
            for (const Part &part : row.parts)
                for (std::size_t j = 0; j < 3; ++j)
                    _ahead[part.vertex].force[j] =
                        _ahead[part.vertex].mobility[j] * part.gradient[j];
            for (std::size_t b = 0; b <= a; ++b) {
                double sum = 0.0;
                for (const Part &part : _rows[_active[b]].parts)
                    sum += dot(part.gradient, _ahead[part.vertex].force);
                _matrix[a * n + b] = _matrix[b * n + a] = sum;
            }
            for (const Part &part : row.parts)
                _ahead[part.vertex].force = {};
            _right[a] = row.gap;
        }
        _is_solved = _complementarity.solve(_matrix, _right, _found);
        for (std::size_t a = 0; a < n; ++a)
            _rows[_active[a]].multiplier = _found[a];
    }
}

/// Adds friction to the forces of the multipliers.
template <typename Real>
void FacetConstraint<Real>::drag(const TouchSettings &tool, const Pose &now, const Pose &next,
                                 const Motion<Real> &motion) {
    for (const std::size_t r : _active) {
        const Row &row = _rows[r];
        Point normal{}; // averaged: over its vertices the gradient adds up to it
        for (const Part &part : row.parts)
            normal = along(normal, part.gradient, 1.0);
        const double length = norm(normal);
        if (!(row.multiplier > 0.0 && length > 0.0))
            continue;
        const Vertex &vertex = _vertices[row.vertex];
        Point place = vertex.rest;
        for (std::size_t j = 0; j < 3; ++j)
            place[j] += static_cast<double>(motion.displacement[vertex.entry + j]);
        Point &force = _ahead[row.vertex].force;
        force =
            along(force,
                  friction_force(now, next, mover_of(motion, vertex.entry, place), force,
                                 along({}, normal, 1.0 / length), tool.friction * row.multiplier),
                  1.0);
    }
}

template <typename Real>
void FacetConstraint<Real>::act(const Pose &now, Motion<Real> &motion, Push<Real> &push,
                                Reaction &reaction) const {
    for (std::uint32_t v = 0; v < _vertices.size(); ++v) {
        const Point &force = _ahead[v].force;
        if (!_ahead[v].is_known || dot(force, force) == 0.0)
            continue;
        const std::size_t entry = _vertices[v].entry;
        Point acting{}, place{};
        for (std::size_t j = 0; j < 3; ++j) {
            // What acts on the body is rounded to its precision; just that acts back on the tool.
            const Real rounded = static_cast<Real>(force[j]);
            place[j] = _vertices[v].rest[j] + static_cast<double>(motion.displacement[entry + j]);
            motion.force[entry + j] -= rounded;
            push.force[entry + j] += rounded;
            acting[j] = static_cast<double>(rounded);
            reaction.force[j] -= acting[j];
        }
        reaction.moment = along(reaction.moment, cross(minus(place, now.position), acting), -1.0);
        push.touched[0].push_back(entry);
    }
}

template class FacetConstraint<float>;
template class FacetConstraint<double>;

} // namespace fastsim
