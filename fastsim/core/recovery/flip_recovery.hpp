#pragma once
// Brings one edge or facet into a tetrahedralisation by flips alone: what crosses it is flipped
// away, from both its ends. It may fail: Schoenhardt's prism has no tetrahedralisation at all.

#include "mesher/flips.hpp"
#include "recovery/segment_walk.hpp"

namespace fastsim {

class FlipRecovery {
  public:
    FlipRecovery(TetComplex &complex, const Protection &protection)
        : _complex(complex), _protection(protection) {}

    /// Whether edge (a, b) is there after at most `most_flips`.
    bool recover_edge(Index a, Index b, std::size_t most_flips);
    /// Likewise a facet whose edges are there.
    bool recover_facet(const Triple &f, std::size_t most_flips);
    /// Removes edge (u, v), or changes the cells around it.
    bool remove_piercing(Index u, Index v) { return remove(u, v) || loosen(u, v); }

  private:
    int side(Index a, Index b, Index c, Index d) const;
    bool flip_away(const Obstacle &o, Index a, Index b);
    bool loosen(Index p, Index q);
    bool remove(Index p, Index q, Index a = none, Index b = none);
    void add_piercing(Index a, Index b, Index c, std::vector<std::array<Index, 2>> &out) const;

    TetComplex &_complex;
    const Protection &_protection;
    std::uint32_t _turn = 1;
};

} // namespace fastsim
