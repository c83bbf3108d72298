#pragma once
// Local changes of a tetrahedralisation that keep its points: 2-3 flips and the removal of an
// edge (3-2, 4-4 and larger), each only when every new cell is positive by the exact predicate.

#include "mesher/flat_set.hpp"
#include "slivers/cell_quality.hpp"

namespace fastsim {

/// What flips must leave alone.
struct Protection {
    FlatSet<std::uint64_t, EdgeHash, ~std::uint64_t{0}> edges;    // by edge_key
    FlatSet<Triple, TripleHash, Triple{none, none, none}> facets; // by sorted_triple
};

/// Removes edge (a, b), re-triangulating its ring of at most `max_ring` cells.
/// Of all triangulations with positive cells the one with the best worst cell is taken (Klincsek's
/// dynamic programme). With (wanted_a, wanted_b) >= 0 only those that contain that edge count.
/// Refuses when the worst new cell is not better than `quality_to_beat`.
bool remove_edge(TetComplex &complex, Index a, Index b, const Protection &protection,
                 std::size_t max_ring, double quality_to_beat, Index wanted_a, Index wanted_b);

/// The same for an edge whose closed ring is known, see TetComplex::edge_ring; `ring` may come out
/// reversed.
bool retriangulate_ring(TetComplex &complex, Index a, Index b, const std::vector<Index> &cells,
                        std::vector<Index> &ring, double quality_to_beat, Index wanted_a,
                        Index wanted_b);

/// Replaces the two cells at a facet by three around the edge of their far corners.
bool flip_facet(TetComplex &complex, Side side, const Protection &protection,
                double quality_to_beat);

} // namespace fastsim
