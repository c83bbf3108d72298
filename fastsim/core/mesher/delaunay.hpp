#pragma once
// Incremental Delaunay insertion (Bowyer 1981, Watson 1981) into the five tetrahedra of the
// circum-cube: step 1 and step 5 of the paper's section II.
//
//   1. locate the cell that holds the new point, by walking across facets;
//   2. grow the cavity: the connected cells whose circumsphere holds the point strictly inside;
//   3. replace them by the point joined to the cavity's outer facets.
//
// All signs are exact. Points on a circumsphere count as outside, which keeps the cavity
// star-shaped and every new cell positive, whatever the order of insertion.

#include "mesher/tet_complex.hpp"

#include <functional>
#include <span>
#include <unordered_set>

namespace fastsim {

/// Facets that a cavity may not cross, by sorted_triple.
using FacetSet = std::unordered_set<Triple, TripleHash>;

/// The eight corners (points 0 to 7) of a cube around all points, `margin` box sizes away, cut
/// into five cells.
TetComplex start_in_cube(std::span<const Point> points, double margin);

/// The cell that holds a point, by a walk from `hint`.
/// Pre-condition: the point lies inside the complex.
Index locate(const TetComplex &complex, const Point &point, Index hint);

/// Inserts point number `point` (already among complex.points); false when it coincides with
/// another, whose number is left in `twin`.
bool insert_point(TetComplex &complex, Index point, Index &hint, const FacetSet &walls,
                  Index &twin);

/// Order of insertion along a Hilbert-like curve, deterministic.
std::vector<Index> spatial_order(std::span<const Point> points);

} // namespace fastsim
