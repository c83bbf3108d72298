#pragma once
// Facets of a closed surface that lie in one plane and hang together.

#include "mesher/tet_complex.hpp"

#include <span>
#include <vector>

namespace fastsim {

struct PlaneGroup {
    Point normal; // of its largest facet, not of unit length
    std::vector<Triple> facets;
};

/// Groups with a needle, a facet less high than a tenth of its longest edge, and more than two
/// facets. All points of a group are within roundings of the plane of its largest facet.
std::vector<PlaneGroup> find_needle_planes(std::span<const Point> points,
                                           std::span<const Triple> facets);

} // namespace fastsim
