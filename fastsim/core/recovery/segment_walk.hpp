#pragma once
// What a segment between two points of a tetrahedralisation passes through, by exact predicates.

#include "mesher/tet_complex.hpp"

#include <vector>

namespace fastsim {

/// Something in the way of a segment: a facet (c >= 0), an edge (a, b), or a point a (b < 0).
struct Obstacle {
    Index a, b, c;
};

/// Walks from a towards b and lists what is crossed, at most `longest_walk` obstacles. A point on
/// the segment ends the walk; it is the last obstacle.
std::vector<Obstacle> find_obstacles(const TetComplex &complex, Index a, Index b);

} // namespace fastsim
