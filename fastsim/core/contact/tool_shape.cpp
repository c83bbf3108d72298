#include "contact/tool_shape.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr Point z_axis{0.0, 0.0, 1.0};

/// Distance to a ball about the origin; `fallback` where its centre has no direction.
Gap ball(const Point &place, double radius, const Point &fallback) {
    const double r = norm(place);
    if (r <= 0.0)
        return {-radius, fallback};
    return {r - radius, along({}, place, 1.0 / r), 1.0 / r};
}

Gap gap(const Sphere &sphere, const Point &place) { return ball(place, sphere.radius, z_axis); }

Gap gap(const Capsule &capsule, const Point &place) {
    const double z = std::clamp(place[2], -capsule.half_length, capsule.half_length);
    Gap found = ball({place[0], place[1], place[2] - z}, capsule.radius, {1.0, 0.0, 0.0});
    // Over the cylinder the distance does not bend along the axis.
    if (z == place[2])
        found.axis = z_axis;
    return found;
}

Gap gap(const HalfSpace &, const Point &place) { return {place[2], z_axis}; }

Gap gap(const SharpBox &box, const Point &place) {
    Point beyond{}, outside{};
    std::size_t nearest = 0, num_outside = 0, inside_axis = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        beyond[i] = std::abs(place[i]) - box.half_widths[i];
        if (beyond[i] > beyond[nearest])
            nearest = i;
        if (beyond[i] > 0.0) {
            outside[i] = std::copysign(beyond[i], place[i]);
            ++num_outside;
        } else {
            inside_axis = i;
        }
    }
    if (num_outside < 2) {
        Point normal{};
        normal[nearest] = std::copysign(1.0, place[nearest]);
        return {beyond[nearest], normal};
    }
    Gap found = ball(outside, 0.0, z_axis);
    if (num_outside == 2)
        found.axis[inside_axis] = 1.0;
    return found;
}

Gap gap(const std::shared_ptr<const ClosedSurface> &surface, const Point &place) {
    const SurfaceGap found = surface->gap(place);
    return {found.distance, found.normal, found.curvature, found.axis};
}

Box own_box(const Sphere &s) {
    return {{-s.radius, -s.radius, -s.radius}, {s.radius, s.radius, s.radius}};
}
Box own_box(const Capsule &c) {
    const double z = c.radius + c.half_length;
    return {{-c.radius, -c.radius, -z}, {c.radius, c.radius, z}};
}
Box own_box(const SharpBox &b) {
    const Point &w = b.half_widths;
    return {{-w[0], -w[1], -w[2]}, w};
}
Box own_box(const HalfSpace &) {
    constexpr double all = std::numeric_limits<double>::infinity();
    return {{-all, -all, -all}, {all, all, all}};
}
Box own_box(const std::shared_ptr<const ClosedSurface> &surface) { return surface->box(); }

} // namespace

Gap gap_of(const ToolShape &shape, const Point &place) {
    return std::visit([&](const auto &kind) { return gap(kind, place); }, shape);
}

Box box_of(const ToolShape &shape) {
    return std::visit([](const auto &kind) { return own_box(kind); }, shape);
}

Point Pose::to_tool(const Point &place) const {
    const Point d = minus(place, position);
    Point own{};
    for (std::size_t j = 0; j < 3; ++j)
        own[j] = rotation[j] * d[0] + rotation[3 + j] * d[1] + rotation[6 + j] * d[2];
    return own;
}

Point Pose::turned_out(const Point &vector) const {
    Point out{};
    for (std::size_t i = 0; i < 3; ++i)
        out[i] = rotation[3 * i] * vector[0] + rotation[3 * i + 1] * vector[1] +
                 rotation[3 * i + 2] * vector[2];
    return out;
}

Gap gap_at(const ToolShape &shape, const Pose &pose, const Point &place) {
    Gap found = gap_of(shape, pose.to_tool(place));
    found.normal = pose.turned_out(found.normal);
    found.axis = pose.turned_out(found.axis);
    return found;
}

Box posed_box(const Box &own, const Pose &pose, double margin) {
    if (!std::isfinite(own.high[0]))
        return own;
    Point centre{}, half{};
    for (std::size_t j = 0; j < 3; ++j) {
        centre[j] = 0.5 * (own.low[j] + own.high[j]);
        half[j] = 0.5 * (own.high[j] - own.low[j]);
    }
    centre = along(pose.position, pose.turned_out(centre), 1.0);
    Box box{};
    for (std::size_t i = 0; i < 3; ++i) {
        double reach = margin;
        for (std::size_t j = 0; j < 3; ++j)
            reach += std::abs(pose.rotation[3 * i + j]) * half[j];
        box.low[i] = centre[i] - reach;
        box.high[i] = centre[i] + reach;
    }
    return box;
}

} // namespace fastsim
