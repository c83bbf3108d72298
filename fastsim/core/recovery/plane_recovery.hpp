#pragma once
// Facets in one plane that are needles, as CAD programs cut plane faces into triangles: their
// edges cross many others of a Delaunay tetrahedralisation, and flips that know nothing of the
// plane undo each other. What there is in the plane is brought into a well-shaped triangulation of
// the same points; that is turned into the given one by flips in the plane (Sloan 1993), each made
// in space by the flip of one edge. Where cells on one side are in the way, an inner point beside
// the edge takes their place: one near enough sees all that is around the edge.

#include "mesher/flips.hpp"
#include "mesher/watch.hpp"

#include <span>

namespace fastsim {

/// Brings needles in one plane in as far as this can; what else of the surface is there, and
/// protected, stays. `protection` holds what is there of these planes as well.
void recover_planes(TetComplex &complex, std::span<const Triple> facets, Protection &protection,
                    Watch &watch);

} // namespace fastsim
