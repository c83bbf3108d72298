#pragma once
// Distances between a point and a facet, and between two edges: one function for each, which the
// hashed search and the brute-force one share.

#include "collision/extent.hpp"

namespace fastsim {

struct NearestOnFacet {
    std::array<double, 3> weights; // of the facet's corners, >= 0, sum 1
    double distance_squared;
};

// The point of triangle (a, b, c) nearest to p; the facet may be a segment or a point.
NearestOnFacet nearest_on_facet(const Position &p, const Position &a, const Position &b,
                                const Position &c);

struct NearestOnEdges {
    std::array<double, 2> parameters; // along each edge, 0 at its first point, 1 at its second
    double distance_squared;
};

// The points of segments (a, b) and (c, d) nearest to each other; parallel ones have several, of
// which one at an end is given; either may be a point.
NearestOnEdges nearest_on_edges(const Position &a, const Position &b, const Position &c,
                                const Position &d);

} // namespace fastsim
