#pragma once
// Exact signs of orientation and in-sphere determinants: a floating-point filter after Shewchuk
// 1997 ("Adaptive precision floating-point arithmetic and fast robust geometric predicates",
// table of error bounds), and whole numbers where it cannot tell.

#include <array>

namespace fastsim {

using Point = std::array<double, 3>;

/// Sign of det(b - a, c - a, d - a): +1 when (a, b, c, d) is a positive tetrahedron, 0 when
/// coplanar. Pre-condition: finite coordinates.
int orient3d(const Point &a, const Point &b, const Point &c, const Point &d);

/// +1 when e lies inside the circumsphere of the positive tetrahedron (a, b, c, d), -1 outside,
/// 0 on it. Pre-condition: finite coordinates.
int in_sphere(const Point &a, const Point &b, const Point &c, const Point &d, const Point &e);

} // namespace fastsim
