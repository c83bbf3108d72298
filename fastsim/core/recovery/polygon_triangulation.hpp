#pragma once
// Triangles of a polygon that is plane up to rounding.

#include "mesher/tet_complex.hpp"

#include <span>
#include <vector>

namespace fastsim {

/// Triangulates a simple polygon, counter-clockwise about `normal`, with triangles of positive
/// area whose worst shape is best (Klincsek's dynamic programme). Empty when there is none.
std::vector<Triple> triangulate_polygon(std::span<const Point> points,
                                        std::span<const Index> polygon, const Point &normal);

} // namespace fastsim
