#include "delaunay/triangulation.hpp"

#include <algorithm>
#include <tuple>

namespace fastsim {

namespace {

// Facet k lies opposite corner k; counter-clockwise seen from outside a positive cell.
constexpr std::array<std::array<std::size_t, 3>, 4> facet_of{
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

// A facet of one cell: its corners, counter-clockwise seen from outside.
struct HullFacet {
    std::array<std::int32_t, 3> corners;
    std::int32_t cell, facet;
};

// A closed surface that bends outwards nowhere, edge by edge, is convex. Each edge must have two
// facets, and the far corner of one may not lie beyond the other.
DelaunayFault find_hull_fault(std::span<const Point> points, std::span<const HullFacet> facets) {
    struct EdgeSide {
        std::int32_t a, b; // sorted
        std::size_t facet, corner;
    };
    const auto at = [&](std::int32_t i) { return points[static_cast<std::size_t>(i)]; };
    std::vector<EdgeSide> sides;
    sides.reserve(3 * facets.size());
    for (std::size_t f = 0; f < facets.size(); ++f) {
        for (std::size_t k = 0; k < 3; ++k) {
            const auto [a, b] =
                std::minmax(facets[f].corners[(k + 1) % 3], facets[f].corners[(k + 2) % 3]);
            sides.push_back({a, b, f, k});
        }
    }
    std::sort(sides.begin(), sides.end(), [](const EdgeSide &x, const EdgeSide &y) {
        return std::tie(x.a, x.b, x.facet) < std::tie(y.a, y.b, y.facet);
    });
    for (std::size_t i = 0; i < sides.size(); i += 2) {
        const HullFacet &here = facets[sides[i].facet];
        const auto is_same_edge = [&](std::size_t j) {
            return j < sides.size() && sides[j].a == sides[i].a && sides[j].b == sides[i].b;
        };
        if (!is_same_edge(i + 1) || is_same_edge(i + 2)) {
            return {here.cell, here.facet, -1};
        }
        const std::int32_t apex = facets[sides[i + 1].facet].corners[sides[i + 1].corner];
        const auto &c = here.corners;
        if (orient3d(at(c[0]), at(c[1]), at(c[2]), at(apex)) > 0) {
            return {here.cell, here.facet, apex};
        }
    }
    return {};
}

} // namespace

DelaunayFault find_delaunay_fault(std::span<const Point> points,
                                  std::span<const std::array<std::int32_t, 4>> cells) {
    struct Side {
        std::array<std::int32_t, 3> facet; // sorted
        std::int32_t cell, corner;
    };
    const auto at = [&](std::int32_t i) { return points[static_cast<std::size_t>(i)]; };
    std::vector<HullFacet> hull;
    std::vector<Side> sides;
    sides.reserve(4 * cells.size());
    for (std::size_t c = 0; c < cells.size(); ++c) {
        const auto &v = cells[c];
        const auto number = static_cast<std::int32_t>(c);
        if (orient3d(at(v[0]), at(v[1]), at(v[2]), at(v[3])) <= 0) {
            return {number, -1, -1};
        }
        for (std::size_t k = 0; k < 4; ++k) {
            Side side{{v[(k + 1) % 4], v[(k + 2) % 4], v[(k + 3) % 4]},
                      number,
                      static_cast<std::int32_t>(k)};
            std::sort(side.facet.begin(), side.facet.end());
            sides.push_back(side);
        }
    }
    std::sort(sides.begin(), sides.end(), [](const Side &a, const Side &b) {
        return std::pair(a.facet, a.cell) < std::pair(b.facet, b.cell);
    });
    for (std::size_t i = 0; i < sides.size(); ++i) {
        const Side &here = sides[i];
        const bool is_pair = i + 1 < sides.size() && sides[i + 1].facet == here.facet;
        if (!is_pair) {
            const auto &v = cells[static_cast<std::size_t>(here.cell)];
            const auto &f = facet_of[static_cast<std::size_t>(here.corner)];
            hull.push_back({{v[f[0]], v[f[1]], v[f[2]]}, here.cell, here.corner});
            continue;
        }
        const Side &there = sides[i + 1];
        if (i + 2 < sides.size() && sides[i + 2].facet == here.facet) {
            return {here.cell, here.corner, -1}; // three cells at one facet
        }
        const auto &v = cells[static_cast<std::size_t>(here.cell)];
        const std::int32_t apex =
            cells[static_cast<std::size_t>(there.cell)][static_cast<std::size_t>(there.corner)];
        std::array<std::int32_t, 4> flipped = v;
        flipped[static_cast<std::size_t>(here.corner)] = apex;
        if (orient3d(at(flipped[0]), at(flipped[1]), at(flipped[2]), at(flipped[3])) >= 0 ||
            in_sphere(at(v[0]), at(v[1]), at(v[2]), at(v[3]), at(apex)) > 0) {
            return {here.cell, here.corner, apex};
        }
        ++i;
    }
    return find_hull_fault(points, hull);
}

} // namespace fastsim
