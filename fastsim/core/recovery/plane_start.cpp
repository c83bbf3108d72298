#include "recovery/plane_start.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <unordered_set>

namespace fastsim {

namespace {

using Edge = PlaneTriangulation::Edge;
using Points = std::unordered_set<Index>;
using Keys = std::unordered_set<std::uint64_t>;

// Lawson's flips end; roundings can be no reason why they should not.
constexpr std::size_t most_looks = 40; // for each edge

/// Whether a cell has a facet in the plane and its other corner outside.
bool lies_outside(const TetComplex &complex, const Points &on, const Point &normal, Index c) {
    const Cell &corners = complex.cell(c);
    Index apex = none;
    for (const Index v : corners)
        if (!on.contains(v)) {
            if (apex != none)
                return false;
            apex = v;
        }
    if (apex == none)
        return false;
    const Index foot = corners[0] == apex ? corners[1] : corners[0];
    return dot(normal, minus(complex.points[TetComplex::at(apex)],
                             complex.points[TetComplex::at(foot)])) > 0.0;
}

/// Brings edges in that cross none of those which are fixed, and fixes them.
void fix(PlaneTriangulation &plane, std::vector<Edge> edges, Keys &fixed) {
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    const auto flip = [&](Index p, Index q) {
        plane.flip(p, q);
        return true;
    };
    for (const auto &[a, b] : edges) {
        if (!plane.has_edge(a, b)) {
            const auto crossed = plane.crossed(a, b);
            if (!crossed ||
                std::any_of(crossed->begin(), crossed->end(),
                            [&](const Edge &e) { return fixed.contains(edge_key(e[0], e[1])); }) ||
                !plane.bring_in(a, b, flip))
                continue;
        }
        fixed.insert(edge_key(a, b));
    }
}

} // namespace

PlaneTriangulation follow_complex(const TetComplex &complex, const PlaneTriangulation &wanted,
                                  const Point &normal) {
    PlaneTriangulation plane = wanted;
    Points on;
    for (const Triple &f : plane.triangles())
        on.insert(f.begin(), f.end());
    std::vector<Index> points(on.begin(), on.end()), cells;
    std::sort(points.begin(), points.end());
    // Where points lie in the plane but for roundings, cells between them are flat: of their edges
    // those are taken first that are seen from outside.
    std::vector<Edge> seen, others;
    for (const Index a : points) {
        complex.cells_around(a, cells);
        for (const Index c : cells) {
            const bool is_outside = lies_outside(complex, on, normal, c);
            for (const Index b : complex.cell(c))
                if (a < b && on.contains(b))
                    (is_outside ? seen : others).push_back({a, b});
        }
    }
    Keys fixed;
    fix(plane, std::move(seen), fixed);
    fix(plane, std::move(others), fixed);
    std::vector<Edge> suspects = plane.inner_edges();
    const std::size_t most = most_looks * suspects.size();
    for (std::size_t i = 0; i < suspects.size() && i < most; ++i) {
        const auto [a, b] = suspects[i];
        if (fixed.contains(edge_key(a, b)) || !plane.can_flip(a, b) ||
            !plane.is_better_flipped(a, b))
            continue;
        const auto [left, right] = plane.far_corners(a, b);
        plane.flip(a, b);
        suspects.insert(suspects.end(), {{a, left}, {left, b}, {b, right}, {right, a}});
    }
    return plane;
}

} // namespace fastsim
