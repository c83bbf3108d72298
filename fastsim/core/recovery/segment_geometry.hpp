#pragma once
// Where a segment meets a plane or passes a line; plain floating point.

#include "predicates/vector_algebra.hpp"

#include <cstddef>

namespace fastsim {

/// The point t of the way from a to b, counted from the nearer end: that has the least rounding.
inline Point between(const Point &a, const Point &b, double t) {
    Point p;
    for (std::size_t i = 0; i < 3; ++i)
        p[i] = t < 0.5 ? a[i] + t * (b[i] - a[i]) : b[i] - (1.0 - t) * (b[i] - a[i]);
    return p;
}

/// Where on segment (a, b) the plane of (p, q, r) is met, in parts of its length.
inline double at_plane(const Point &a, const Point &b, const Point &p, const Point &q,
                       const Point &r) {
    const Point normal = cross(minus(q, p), minus(r, p));
    const double height_a = dot(normal, minus(a, p)), height_b = dot(normal, minus(b, p));
    return height_a / (height_a - height_b);
}

/// Where on segment (a, b) the line (p, q) is nearest.
inline double at_line(const Point &a, const Point &b, const Point &p, const Point &q) {
    const Point d = minus(b, a), e = minus(q, p), w = minus(a, p);
    const double dd = dot(d, d), de = dot(d, e), ee = dot(e, e);
    return (de * dot(e, w) - ee * dot(d, w)) / (dd * ee - de * de);
}

} // namespace fastsim
