#pragma once
// The boundary of a mesh, from its cells alone.

#include "mesher/tet_complex.hpp"

#include <span>
#include <vector>

namespace fastsim {

/// Facets of one cell only, or of more than two: each side that is not one of a pair, in the order
/// of the cells, counter-clockwise seen from outside.
std::vector<Triple> find_boundary_facets(std::span<const Cell> cells, std::size_t num_points);

} // namespace fastsim
