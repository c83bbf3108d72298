#pragma once
// From which triangulation of a plane's points the given one is reached.

#include "recovery/plane_triangulation.hpp"

namespace fastsim {

/// The points of `wanted`, triangulated with as many edges of the complex as go together, and by
/// Delaunay's criterion elsewhere. `normal` of the plane points outwards.
PlaneTriangulation follow_complex(const TetComplex &complex, const PlaneTriangulation &wanted,
                                  const Point &normal);

} // namespace fastsim
