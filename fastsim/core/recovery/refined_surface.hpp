#pragma once
// The given surface while points lie on some of its edges and facets: triangles with the facet
// that each is a part of. Closed and manifold, so every edge has two triangles.

#include "mesher/tet_complex.hpp"

#include <span>
#include <unordered_map>
#include <vector>

namespace fastsim {

class RefinedSurface {
  public:
    void add(const Triple &triangle, Index parent);

    /// The given facet that a triangle is a part of.
    Index parent(Index t) const { return _parents[TetComplex::at(t)]; }
    /// Whether a point lies on the surface.
    bool has_point(Index v) const { return _triangle_of_point.contains(v); }
    bool has_edge(Index a, Index b) const { return _sides.contains(edge_key(a, b)); }
    std::vector<Triple> triangles() const;

    /// Triangles at point s, in turn: triangle i is (s, link[i], link[i + 1]). Empty where they
    /// do not close.
    std::vector<Index> fan(Index s, std::vector<Index> &link) const;
    /// Replaces triangles by others with the same outer edges.
    void replace(std::span<const Index> dead, std::span<const Triple> fresh,
                 std::span<const Index> parents);

  private:
    void remove(Index t);

    std::vector<Triple> _triangles;
    std::vector<Index> _parents;
    std::unordered_map<std::uint64_t, std::array<Index, 2>> _sides; // triangles by edge
    std::unordered_map<Index, Index> _triangle_of_point;
};

} // namespace fastsim
