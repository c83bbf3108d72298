#pragma once
// By which face a vertex came into a box, and has to leave it again.
//
// The nearest face is the wrong one beside an edge: under the bottom, nearer to a side than deep,
// a vertex would be pushed out of that side. It came in by a face it was outside of; by the one
// whose plane it crossed last, of several. What has touched a face keeps to it until it is clear of
// the box.

#include "contact/tool_shape.hpp"

namespace fastsim {

/// Where a vertex was before, in the tool's frame.
struct WayIn {
    Point begin{};
    bool is_known = false;
};

/// Gap of a place in the tool's frame: inside a box from the face it came by, else as `gap_of`.
Gap gap_on_way(const ToolShape &shape, const Point &own, const WayIn &way);

/// The way of a vertex that is now at a place in the box's frame.
WayIn way_from(const SharpBox &box, const Point &own, const WayIn &way);

} // namespace fastsim
