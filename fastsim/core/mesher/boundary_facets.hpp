#pragma once
// The boundary of a mesh, from its cells alone.

#include "mesher/tet_complex.hpp"

#include <span>
#include <vector>

namespace fastsim {

/// Facets of one cell only, or of more than two: each side that is not one of a pair, in the order
/// of the cells, counter-clockwise seen from outside.
std::vector<Triple> find_boundary_facets(std::span<const Cell> cells, std::size_t num_points);

/// Whether what bounds the cells is the facets, outward: each facet of a cell that is none of them
/// is that of another cell, on its other side. Told by sums of one number for each facet, which
/// agree by chance once in 2^64; several times as fast as to find them.
bool is_boundary(std::span<const Triple> facets, std::span<const Cell> cells);

} // namespace fastsim
