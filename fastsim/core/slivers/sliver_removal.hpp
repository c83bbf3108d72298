#pragma once
// Slivers are re-meshed with their neighbours (section II, last step): edges of bad cells are
// removed, facets flipped, inner points moved, each only when the worst cell gets better.
// The boundary is never touched.

#include "mesher/flips.hpp"
#include "mesher/watch.hpp"

namespace fastsim {

struct SliverReport {
    std::size_t flips = 0;
    std::size_t moves = 0;
    std::size_t insertions = 0;
    std::size_t work = 0; // see the budget
    bool is_cut_short = false;
    std::size_t left = 0; // see count_slivers
};

/// Bounds the work: cells tried, of which one that a point is tried for counts as many. Ordinary
/// meshes need a part of it, noisy ones are cut short with the worst cells done.
struct SliverBudget {
    std::size_t least;
    double per_cell;
};

/// Improves cells whose smallest sine of a dihedral angle is below `target`, or that are below the
/// complex's altitude. Points numbered below `num_fixed` are never moved. The ratings are those of
/// the cells by that altitude, before and after.
SliverReport remove_slivers(TetComplex &complex, Index num_fixed, CellRatings &ratings,
                            double target, int max_passes, SliverBudget budget, Watch &watch);

/// Cells with a dihedral angle below 10 degrees, by the smallest sine of each, by slot.
std::size_t count_slivers(const TetComplex &complex, std::span<const double> sines);

} // namespace fastsim
