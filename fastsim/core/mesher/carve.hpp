#pragma once
// Keeps the inside: step 5 of section II ends with cells on both sides of the surface.

#include "mesher/tet_complex.hpp"

#include <span>
#include <vector>

namespace fastsim {

/// Keeps the cells that lie behind the facets, which face outwards; in the result the boundary
/// has no neighbours. Empty when a region lies on both sides of the surface.
std::vector<Cell> carve(const TetComplex &complex, std::span<const Triple> facets);

} // namespace fastsim
