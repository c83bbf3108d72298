#pragma once
// The point of a surface nearest to a place, by a tree of boxes.

#include "surface/box_tree.hpp"

namespace fastsim {

struct ClosestPoint {
    Point point;
    double distance_squared;
    std::int32_t facet;
};

class SurfaceDistance {
  public:
    // Keeps its own copy. Pre-condition: at least one facet.
    SurfaceDistance(std::vector<Point> points, std::vector<std::array<std::int32_t, 3>> facets);

    [[nodiscard]] ClosestPoint closest(const Point &place) const;

    // An upper bound of the largest distance of a triangle's points from the surface, above it by
    // at most `accuracy` and a hundredth of it where few halvings of the triangle suffice.
    [[nodiscard]] double farthest(const std::array<Point, 3> &triangle, double accuracy) const;

    // Whether some point of the surface is within the distance; quicker than `closest`.
    [[nodiscard]] bool is_within(const Point &place, double distance) const;

  private:
    ClosestPoint search(const Point &place, double reach_squared, bool any) const;

    std::vector<Point> _points;
    std::vector<std::array<std::int32_t, 3>> _facets;
    BoxTree _tree;
};

// The point of triangle (a, b, c) nearest to a place (Ericson 2005, section 5.1.5: which of the
// seven regions of the triangle's plane the place lies over).
Point closest_on_triangle(const Point &place, const Point &a, const Point &b, const Point &c);

} // namespace fastsim
