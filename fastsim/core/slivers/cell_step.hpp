#pragma once
// The stable time step of a cell as a length: 1 / root(sum of the squared gradients of its shape
// functions), which is what it is of any law but for a factor, and all but exactly where the body
// keeps its volume.

#include "mesher/tet_complex.hpp"

namespace fastsim {

struct CellStep {
    double step; // negative when inverted
    double sine; // the smallest of a dihedral angle, see cell_quality
};

CellStep cell_step(const std::array<Point, 4> &corners);
CellStep cell_step(const TetComplex &complex, const Cell &cell);

/// What no cell on a facet exceeds, whatever lies behind it: that of an endlessly high one.
double facet_step(const TetComplex &complex, const Triple &facet);

} // namespace fastsim
