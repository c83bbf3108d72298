#include "contact/box_faces.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <variant>

namespace fastsim {

namespace {

// Of the smallest half width: nearer than this a vertex is still at the face or edge it touches.
constexpr double touching = 1e-6;

struct Face {
    std::size_t axis;
    double side; // -1 or 1
};

double side_of(double coordinate) { return coordinate < 0.0 ? -1.0 : 1.0; }

double slack_of(const SharpBox &box) {
    return touching * *std::ranges::min_element(box.half_widths);
}

/// Of the least depth, or the smallest distance.
Face nearest_face(const SharpBox &box, const Point &own) {
    std::size_t nearest = 0;
    for (std::size_t i = 1; i < 3; ++i)
        if (std::abs(own[i]) - box.half_widths[i] >
            std::abs(own[nearest]) - box.half_widths[nearest])
            nearest = i;
    return {nearest, side_of(own[nearest])};
}

Face entered_face(const SharpBox &box, const Point &own, const WayIn &way) {
    Face face = nearest_face(box, own);
    if (!way.is_known)
        return face;
    const double slack = slack_of(box);
    double last = -1.0;
    for (std::size_t i = 0; i < 3; ++i) {
        const double side = side_of(way.begin[i]);
        const double beyond = std::abs(way.begin[i]) - box.half_widths[i];
        const double length = std::abs(way.begin[i]) - side * own[i];
        // By an axis on which it is still outside it has crossed no plane.
        if (beyond > slack && length >= beyond - slack && beyond / length > last) {
            last = beyond / length;
            face = {i, side};
        }
    }
    return face;
}

} // namespace

Gap gap_on_way(const ToolShape &shape, const Point &own, const WayIn &way) {
    const auto *const box = std::get_if<SharpBox>(&shape);
    if (box == nullptr || !way.is_known)
        return gap_of(shape, own);
    // What was put onto a side has to stay there, roundings or not.
    for (std::size_t i = 0; i < 3; ++i)
        if (std::abs(own[i]) - box->half_widths[i] > slack_of(*box))
            return gap_of(shape, own);
    const Face face = entered_face(*box, own, way);
    Gap found{face.side * own[face.axis] - box->half_widths[face.axis], {}};
    found.normal[face.axis] = face.side;
    return found;
}

WayIn way_from(const SharpBox &box, const Point &own, const WayIn &way) {
    const Face near = nearest_face(box, own);
    if (near.side * own[near.axis] - box.half_widths[near.axis] > slack_of(box))
        return {own, true};
    // What touches the box begins straight in front of the face by which it came.
    const Face face = entered_face(box, own, way);
    WayIn next{own, true};
    for (std::size_t i = 0; i < 3; ++i)
        next.begin[i] = std::clamp(own[i], -box.half_widths[i], box.half_widths[i]);
    next.begin[face.axis] = 2.0 * face.side * box.half_widths[face.axis];
    return next;
}

} // namespace fastsim
