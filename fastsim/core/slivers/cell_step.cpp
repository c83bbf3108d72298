#include "slivers/cell_step.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

Point minus(const Point &a, const Point &b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Point cross(const Point &a, const Point &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Point &a, const Point &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

} // namespace

CellStep cell_step(const std::array<Point, 4> &x) {
    const Point u = minus(x[1], x[0]), v = minus(x[2], x[0]), w = minus(x[3], x[0]);
    // Six volumes times the gradients of the shape functions of corners 1, 2 and 3.
    const Point b = cross(v, w), c = cross(w, u), d = cross(u, v);
    const Point a{-b[0] - c[0] - d[0], -b[1] - c[1] - d[1], -b[2] - c[2] - d[2]};
    const double six_volumes = dot(d, w);
    const double aa = dot(a, a), bb = dot(b, b), cc = dot(c, c), dd = dot(d, d);
    // sin^2 = 1 - cos^2 loses its digits for flat cells: by edges, see cell_quality.
    const Point vu = minus(v, u), wu = minus(w, u), wv = minus(w, v);
    const double each =
        std::min({dot(u, u) / (cc * dd), dot(v, v) / (bb * dd), dot(w, w) / (bb * cc),
                  dot(vu, vu) / (aa * dd), dot(wu, wu) / (aa * cc), dot(wv, wv) / (aa * bb)});
    if (!std::isfinite(each))
        return {0.0, 0.0}; // out of range, or a facet without area
    return {six_volumes / std::sqrt(aa + bb + cc + dd), six_volumes * std::sqrt(each)};
}

CellStep cell_step(const TetComplex &complex, const Cell &cell) {
    std::array<Point, 4> corners;
    for (std::size_t i = 0; i < 4; ++i)
        corners[i] = complex.points[TetComplex::at(cell[i])];
    return cell_step(corners);
}

double facet_step(const TetComplex &complex, const Triple &facet) {
    const Point &a = complex.points[TetComplex::at(facet[0])];
    const Point u = minus(complex.points[TetComplex::at(facet[1])], a);
    const Point v = minus(complex.points[TetComplex::at(facet[2])], a);
    const Point normal = cross(u, v), w = minus(v, u);
    return std::sqrt(dot(normal, normal) / (dot(u, u) + dot(v, v) + dot(w, w)));
}

} // namespace fastsim
