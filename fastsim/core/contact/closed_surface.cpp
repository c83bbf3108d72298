#include "contact/closed_surface.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace fastsim {

namespace {

// A nearest point this near to an edge or corner, measured by its weights, belongs to it.
constexpr double near_edge = 1e-10;

Point unit(const Point &v) {
    const double length = norm(v);
    return length > 0.0 ? along({}, v, 1.0 / length) : Point{0.0, 0.0, 1.0};
}

double angle_between(const Point &u, const Point &v) {
    return std::atan2(norm(cross(u, v)), dot(u, v));
}

} // namespace

ClosedSurface::ClosedSurface(std::vector<Point> points, std::vector<Facet> facets)
    : _points(std::move(points)), _facets(std::move(facets)), _point_normals(_points.size()),
      _distance(_points, _facets), _box{_points.at(0), _points.at(0)} {
    std::map<std::pair<std::int32_t, std::int32_t>, Point> of_edge;
    const auto edge = [](std::int32_t a, std::int32_t b) {
        return std::pair{std::min(a, b), std::max(a, b)};
    };
    for (const Facet &facet : _facets) {
        std::array<Point, 3> x{};
        for (std::size_t k = 0; k < 3; ++k)
            x[k] = _points[static_cast<std::size_t>(facet[k])];
        const Point normal = unit(cross(minus(x[1], x[0]), minus(x[2], x[0])));
        _facet_normals.push_back(normal);
        for (std::size_t k = 0; k < 3; ++k) {
            const std::size_t next = (k + 1) % 3, other = (k + 2) % 3;
            Point &sum = _point_normals[static_cast<std::size_t>(facet[k])];
            sum = along(sum, normal, angle_between(minus(x[next], x[k]), minus(x[other], x[k])));
            Point &both = of_edge[edge(facet[k], facet[next])];
            both = along(both, normal, 1.0);
        }
    }
    for (const Facet &facet : _facets) {
        std::array<Point, 3> normals{};
        for (std::size_t k = 0; k < 3; ++k)
            normals[k] = unit(of_edge[edge(facet[k], facet[(k + 1) % 3])]);
        _edge_normals.push_back(normals);
    }
    for (Point &normal : _point_normals)
        normal = unit(normal);
    for (const Point &p : _points)
        for (std::size_t i = 0; i < 3; ++i) {
            _box.low[i] = std::min(_box.low[i], p[i]);
            _box.high[i] = std::max(_box.high[i], p[i]);
        }
}

SurfaceGap ClosedSurface::gap(const Point &place) const {
    const ClosestPoint found = _distance.closest(place);
    const auto f = static_cast<std::size_t>(found.facet);
    const Facet &facet = _facets[f];
    const auto at = [&](std::size_t k) -> const Point & {
        return _points[static_cast<std::size_t>(facet[k])];
    };
    // Weights of the corners: areas opposite to them, over the whole.
    const Point whole = cross(minus(at(1), at(0)), minus(at(2), at(0)));
    const double squared = dot(whole, whole);
    std::array<bool, 3> has_weight{};
    std::size_t count = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        const Point part =
            cross(minus(at((k + 1) % 3), found.point), minus(at((k + 2) % 3), found.point));
        has_weight[k] = dot(part, whole) > near_edge * squared;
        count += has_weight[k] ? 1 : 0;
    }
    Point feature = _facet_normals[f], axis{};
    if (count == 2)
        for (std::size_t k = 0; k < 3; ++k)
            if (has_weight[k] && has_weight[(k + 1) % 3]) {
                feature = _edge_normals[f][k];
                axis = unit(minus(at((k + 1) % 3), at(k)));
            }
    if (count == 1)
        for (std::size_t k = 0; k < 3; ++k)
            if (has_weight[k])
                feature = _point_normals[static_cast<std::size_t>(facet[k])];
    const Point away = minus(place, found.point);
    const double length = norm(away);
    const double sign = dot(away, feature) < 0.0 ? -1.0 : 1.0;
    if (count == 3)
        return {sign * length, _facet_normals[f], 0.0, {}};
    // On the edge or corner itself the pseudo-normal is the direction.
    const double extent = std::sqrt(std::sqrt(squared));
    if (!(length > 1e-12 * extent))
        return {sign * length, feature, 0.0, {}};
    return {sign * length, along({}, away, sign / length), sign / length, axis};
}

} // namespace fastsim
