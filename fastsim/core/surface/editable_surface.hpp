#pragma once
// A closed triangulated surface whose edges can be split, collapsed and flipped.

#include "predicates/predicates.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <unordered_set>
#include <utility>
#include <vector>

namespace fastsim {

class EditableSurface {
  public:
    using Index = std::int32_t;
    using Facet = std::array<Index, 3>;
    // The two facets of an edge (a, b): one that runs a -> b, with corner `left` opposite, and one
    // that runs b -> a, with corner `right` opposite.
    struct Flaps {
        Index left_facet = -1, right_facet = -1, left = -1, right = -1;
    };

    // Pre-condition: closed and manifold.
    EditableSurface(std::span<const Point> points, std::span<const Facet> facets);

    [[nodiscard]] std::size_t num_points() const { return _points.size(); }
    [[nodiscard]] const Point &point(Index v) const { return _points[at(v)]; }
    [[nodiscard]] const Facet &facet(Index f) const { return _facets[at(f)]; }
    [[nodiscard]] std::span<const Index> facets_around(Index v) const { return _around[at(v)]; }
    [[nodiscard]] bool is_alive(Index v) const { return !_around[at(v)].empty(); }

    // All edges (a < b), ascending.
    [[nodiscard]] std::vector<std::pair<Index, Index>> edges() const;
    [[nodiscard]] bool has_edge(Index a, Index b) const;
    [[nodiscard]] Flaps flaps(Index a, Index b) const;
    void neighbours(Index v, std::vector<Index> &out) const;

    // Sharp edges are kept: halved by splits, joined by collapses along them.
    [[nodiscard]] bool is_sharp(Index a, Index b) const { return _sharp.count(key(a, b)) > 0; }
    void make_sharp(Index a, Index b);
    [[nodiscard]] int num_sharp(Index v) const { return _num_sharp[at(v)]; }

    void move(Index v, const Point &place) { _points[at(v)] = place; }
    Index split(Index a, Index b, const Point &place);
    // Whether the surface stays a manifold of the same topology (link condition).
    [[nodiscard]] bool can_collapse(Index keep, Index gone) const;
    void collapse(Index keep, Index gone, const Point &place);
    [[nodiscard]] bool can_flip(Index a, Index b) const;
    void flip(Index a, Index b);

    // The surface as it is, without gaps in the numbers.
    void compact(std::vector<Point> &points, std::vector<Facet> &facets) const;

  private:
    static std::size_t at(Index i) { return static_cast<std::size_t>(i); }
    static std::uint64_t key(Index a, Index b) {
        return a < b ? (static_cast<std::uint64_t>(a) << 32) | static_cast<std::uint32_t>(b)
                     : (static_cast<std::uint64_t>(b) << 32) | static_cast<std::uint32_t>(a);
    }
    void forget_sharp(Index a, Index b);
    void detach(Index v, Index f);
    void replace_corner(Index f, Index from, Index to);

    std::vector<Point> _points;
    std::vector<Facet> _facets;
    std::vector<std::vector<Index>> _around;
    std::unordered_set<std::uint64_t> _sharp;
    std::vector<int> _num_sharp;
};

} // namespace fastsim
