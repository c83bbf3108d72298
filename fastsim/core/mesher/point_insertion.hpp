#pragma once
// A new inner point where flips and moves do not help: most slivers left have all four corners on
// the surface, and nothing in them may move (after Klingner and Shewchuk 2007, Aggressive
// tetrahedral mesh improvement, vertex insertion).

#include "mesher/tet_complex.hpp"

namespace fastsim {

/// Replaces a bad cell and some around it by cells to a new point, placed to make the worst of
/// them as good as can be; only when that beats the worst of the old ones. The point is always
/// inside: the outer facets of the complex are kept. `spare` is a point number that no cell uses,
/// or none; it is used up on success.
bool insert_point_at(TetComplex &complex, Index bad_cell, Index &spare);

} // namespace fastsim
