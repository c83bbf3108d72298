#pragma once
// Signed distance to the shapes of rigid tools, in the tool's own frame.
//
// Negative inside. The normal is the gradient of the distance, so that a force along it has the
// potential that the distance gives it. Across a ridge of the inside (the middle of a box, the
// bisector below a convex edge) the distance is continuous and its gradient is not.

#include "contact/closed_surface.hpp"
#include "predicates/predicates.hpp"

#include <memory>
#include <span>
#include <variant>

namespace fastsim {

/// Distance, its gradient, and its second derivative curvature (I - n n^T - axis axis^T).
struct Gap {
    double distance;
    Point normal;         // unit
    double curvature = 0; // [1/m]
    Point axis{};         // unit, or zero
};

struct Sphere {
    double radius;
};
/// A cylinder with round ends along z; `half_length` to the centre of either end.
struct Capsule {
    double radius, half_length;
};
struct SharpBox {
    Point half_widths;
};
/// z <= 0.
struct HalfSpace {};

using ToolShape =
    std::variant<Sphere, Capsule, SharpBox, HalfSpace, std::shared_ptr<const ClosedSurface>>;

Gap gap_of(const ToolShape &shape, const Point &place);

/// Box of the shape in its own frame; infinite for a half space.
Box box_of(const ToolShape &shape);

/// Where a tool is: rotation @ place + position, the rotation row by row. A row of numbers in
/// Python.
struct Pose {
    Point position;
    std::array<double, 9> rotation;

    Point to_tool(const Point &place) const;     // of a place in space
    Point turned_out(const Point &vector) const; // of a vector in the tool's frame
};
static_assert(sizeof(Pose) == 12 * sizeof(double));

/// Gap of a place in space; normal and axis turned out into it.
Gap gap_at(const ToolShape &shape, const Pose &pose, const Point &place);

/// Box in space about the posed shape, wider by a margin.
Box posed_box(const Box &own, const Pose &pose, double margin);

} // namespace fastsim
