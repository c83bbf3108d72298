#pragma once
// Slivers are re-meshed with their neighbours (section II, last step): edges of bad cells are
// removed, facets flipped, inner points moved, each only when the worst cell gets better.
// The boundary is never touched.

#include "mesher/flips.hpp"
#include "mesher/watch.hpp"

namespace fastsim {

/// sin 10 degrees.
constexpr double told_sine = 0.17364817766693033;

struct SliverReport {
    std::size_t flips = 0;
    std::size_t moves = 0;
    std::size_t insertions = 0;
    std::size_t work = 0; // see the budget
    bool is_cut_short = false;
    std::size_t left = 0; // cells with a dihedral angle below 10 degrees
};

/// Bounds the work: cells tried, of which one that a point is tried for counts as many. Ordinary
/// meshes need a part of it, noisy ones are cut short with the worst cells done.
struct SliverBudget {
    std::size_t least;
    double per_cell;
};

/// Improves cells whose smallest sine of a dihedral angle is below `target`. Points numbered
/// below `num_fixed` are never moved. A cell counts as bad below `least_altitude`, too; 0 takes
/// what the surface suggests (find_wanted_altitude).
SliverReport remove_slivers(TetComplex &complex, Index num_fixed, double target, int max_passes,
                            double least_altitude, SliverBudget budget, Watch &watch);

} // namespace fastsim
