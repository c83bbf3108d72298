#pragma once
// Signed distance to a closed surface of triangles, by the nearest point and its pseudo-normal
// (Baerentzen and Aanaes 2005, "Signed distance computation using the angle weighted
// pseudonormal"): the sign is right over edges and corners too, and nothing jumps between facets.

#include "surface/closest_point.hpp"

#include <array>
#include <cstdint>
#include <vector>

namespace fastsim {

struct SurfaceGap {
    double distance; // negative inside
    Point normal;    // unit, gradient of the distance
    double curvature;
    Point axis;
};

class ClosedSurface {
  public:
    using Facet = std::array<std::int32_t, 3>;

    // Pre-conditions: closed, facets counter-clockwise seen from outside, none without area.
    ClosedSurface(std::vector<Point> points, std::vector<Facet> facets);

    [[nodiscard]] SurfaceGap gap(const Point &place) const;
    [[nodiscard]] const Box &box() const { return _box; }

  private:
    std::vector<Point> _points;
    std::vector<Facet> _facets;
    std::vector<Point> _facet_normals;               // unit
    std::vector<std::array<Point, 3>> _edge_normals; // edge k runs from corner k to the next
    std::vector<Point> _point_normals;
    SurfaceDistance _distance;
    Box _box;
};

} // namespace fastsim
