#pragma once
// A triangulation of a part of a plane under change by flips of its edges (Lawson 1977; Sloan 1993,
// "A fast algorithm for generating constrained Delaunay triangulations").

#include "mesher/tet_complex.hpp"

#include <functional>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

namespace fastsim {

class PlaneTriangulation {
  public:
    using Edge = std::array<Index, 2>;

    /// Points are looked at along the axis that is nearest to `normal`, from the side to which it
    /// points. `is_proper` is false when a triangle is not counter-clockwise then.
    PlaneTriangulation(std::span<const Point> points, const Point &normal,
                       std::span<const Triple> triangles);

    bool is_proper() const { return _is_proper; }
    bool has_edge(Index a, Index b) const {
        return _third.contains(directed(a, b)) || _third.contains(directed(b, a));
    }
    /// Far corners of the triangles at (a, b): on its left, on its right; none at the rim.
    Edge far_corners(Index a, Index b) const { return {third(a, b), third(b, a)}; }
    /// Edges between two triangles, and all triangles; in the order of their numbers.
    std::vector<Edge> inner_edges() const;
    std::vector<Triple> triangles() const;

    /// Whether the triangles at (a, b) make a strictly convex quadrilateral.
    bool can_flip(Index a, Index b) const;
    /// Whether the flip of (a, b) would make its smaller angles larger.
    bool is_better_flipped(Index a, Index b) const;
    void flip(Index a, Index b);
    /// Brings edge (a, b) in by flips of what it crosses; `flip_edge(p, q)` makes each flip here
    /// and elsewhere, or refuses. Whether the edge is there.
    bool bring_in(Index a, Index b, const std::function<bool(Index, Index)> &flip_edge);
    /// Edges that segment (a, b) passes through, from a; nothing when it meets a point or the rim.
    std::optional<std::vector<Edge>> crossed(Index a, Index b) const;

  private:
    static std::uint64_t directed(Index a, Index b) {
        return (static_cast<std::uint64_t>(a) << 32) | static_cast<std::uint64_t>(b);
    }
    Index third(Index a, Index b) const {
        const auto found = _third.find(directed(a, b));
        return found == _third.end() ? none : found->second;
    }
    int turn(Index a, Index b, Index c) const;
    void add(Index a, Index b, Index c);
    void drop(Index a, Index b, Index c);

    std::span<const Point> _points;
    std::size_t _x = 0, _y = 1;
    bool _is_proper = true;
    std::unordered_map<std::uint64_t, Index> _third; // by directed side, its triangle on the left
    std::unordered_map<Index, std::vector<Index>> _ahead; // b for each directed side (a, b)
};

} // namespace fastsim
