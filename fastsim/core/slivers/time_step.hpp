#pragma once
// The few cells that decide the critical time step are made better: inner points are moved, or
// taken away where they crowd a facet, and edges and facets flipped. The boundary is never touched.

#include "mesher/flips.hpp"
#include "mesher/watch.hpp"

namespace fastsim {

/// Lengthens the stable step of the worst cell, up to what the thinnest facet of the boundary
/// allows. A changed cell keeps the smallest angle that was around it, or `least_sine` where that
/// is less. Points numbered below `num_fixed` stay. The ratings are those of the cells, without
/// altitudes, before and after.
void lengthen_time_step(TetComplex &complex, Index num_fixed, CellRatings &ratings,
                        double least_sine, Watch &watch);

} // namespace fastsim
