#pragma once
// Where a rigid tool is over time: straight and at constant turn (slerp) between the knots of its
// path, at rest before the first and after the last.

#include "contact/tool_shape.hpp"

#include <optional>
#include <vector>

namespace fastsim {

using Quaternion = std::array<double, 4>; // unit: w, x, y, z

class ToolPath {
  public:
    /// Pre-condition: as many positions and rotations as times, at least one; times increase.
    ToolPath(std::span<const double> times, std::span<const Point> positions,
             std::span<const Quaternion> rotations);

    Quaternion rotation_at(double time) const;
    Pose pose_at(double time) const;
    /// From where the tool is at a time straight to a pose at a later one; no rotation keeps that
    /// which it has.
    ToolPath way_to(const Point &position, const std::optional<Quaternion> &rotation, double begin,
                    double end) const;
    /// Largest speed of a point this far from the origin: the origin's, and the rate of turn times
    /// the reach. Where that is infinite (a half space) the origin's alone.
    double fastest_point(double reach) const;

  private:
    /// The last knot not after a time, and how far on the way to the next one it is.
    std::pair<std::size_t, double> place_of(double time) const;

    std::vector<double> _times;
    std::vector<Point> _positions;
    std::vector<Quaternion> _rotations;
};

} // namespace fastsim
