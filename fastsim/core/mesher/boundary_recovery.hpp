#pragma once
// "Check boundary points and topology preservation" (section II, step 5): every edge and facet
// of the given surface is brought into the tetrahedralisation by flips, none is ever split.
//
//   1. edges: what crosses a missing edge (facets, edges) is flipped away, from both its ends;
//   2. facets: with its three edges there, edges that pierce a missing facet are removed;
//   3. whatever is recovered is protected from later flips.
//
// Flips do not always suffice (Schoenhardt's prism has no tetrahedralisation at all); what is
// left is reported, not hidden.

#include "mesher/flips.hpp"

#include <span>
#include <vector>

namespace fastsim {

struct RecoveryReport {
    std::vector<std::array<Index, 2>> missing_edges;
    std::vector<Index> missing_facets; // indices of the given facets
    std::size_t recovered_edges = 0;
    std::size_t recovered_facets = 0;
};

/// Brings the facets into the complex; `protection` comes out holding what is there.
RecoveryReport recover_boundary(TetComplex &complex, std::span<const Triple> facets,
                                Protection &protection);

/// Keeps the cells that lie behind the facets, which face outwards; in the result the boundary
/// has no neighbours. Throws std::runtime_error when sides contradict each other.
std::vector<Cell> carve(const TetComplex &complex, std::span<const Triple> facets);

} // namespace fastsim
