#pragma once
// Vectors in space, in plain floating point.

#include "predicates/predicates.hpp"

#include <cmath>

namespace fastsim {

inline Point minus(const Point &a, const Point &b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline double dot(const Point &a, const Point &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Point cross(const Point &a, const Point &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline double norm(const Point &a) { return std::sqrt(dot(a, a)); }
// a + t v
inline Point along(const Point &a, const Point &v, double t) {
    return {a[0] + t * v[0], a[1] + t * v[1], a[2] + t * v[2]};
}

} // namespace fastsim
