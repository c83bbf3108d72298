#pragma once
// Points that boundary recovery put on the surface are moved off it, into the inside, so that the
// surface comes back as it was given (George, Borouchaki and Saltel 2003, "Ultimate robustness in
// meshing an arbitrary polyhedron"; Si 2015, TetGen, section on Steiner point removal).
//
// The cells at such a point fill a region that is star-shaped about it. Its outer triangles at
// the point are exchanged for triangles without it, and the point moves inwards so far that it
// sees every wall of the region, old and new, strictly from inside: in exact arithmetic a small
// enough step always does, in floating point it is checked by the exact predicate.

#include "mesher/flips.hpp"
#include "mesher/watch.hpp"
#include "recovery/refined_surface.hpp"

#include <vector>

namespace fastsim {

/// Moves or removes the points of `steiner`, which lie on the boundary of `complex`, the carved
/// inside of `surface`. `given` are the facets that the surface refines. Returns the points that
/// had to stay.
std::vector<Index> remove_steiner_points(TetComplex &complex, RefinedSurface &surface,
                                         std::span<const Triple> given, std::vector<Index> steiner,
                                         Watch &watch);

} // namespace fastsim
