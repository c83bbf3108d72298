#pragma once
// Keeps the inside: step 5 of section II ends with cells on both sides of the surface.

#include "mesher/tet_complex.hpp"

#include <span>

namespace fastsim {

/// The cells that lie behind the facets, which face outwards, on all the points; the boundary has
/// no neighbours. Without cells when a region lies on both sides of the surface.
TetComplex carve(const TetComplex &complex, std::span<const Triple> facets);

} // namespace fastsim
