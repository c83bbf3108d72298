#pragma once
// The stable time step of a cell as a length: 1 / root(sum of the squared gradients of its shape
// functions), which is what it is of any law but for a factor, and all but exactly where the body
// keeps its volume.

#include "mesher/tet_complex.hpp"

namespace fastsim {

/// Negative when inverted; 0 where it is out of range.
double cell_step(const Point &a, const Point &b, const Point &c, const Point &d);
double cell_step(const TetComplex &complex, const Cell &cell);

/// What no cell on a facet exceeds, whatever lies behind it: that of an endlessly high one.
double facet_step(const TetComplex &complex, const Triple &facet);

} // namespace fastsim
