#pragma once
// Slivers are re-meshed with their neighbours (section II, last step): edges of bad cells are
// removed, facets flipped, inner points moved, each only when the worst cell gets better.
// The boundary is never touched.

#include "mesher/flips.hpp"

namespace fastsim {

struct SliverReport {
    std::size_t flips = 0;
    std::size_t moves = 0;
    std::size_t insertions = 0;
};

/// Improves cells whose smallest sine of a dihedral angle is below `target`. Points numbered
/// below `num_fixed` are never moved.
SliverReport remove_slivers(TetComplex &complex, Index num_fixed, double target, int max_passes);

} // namespace fastsim
