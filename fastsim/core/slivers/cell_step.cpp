#include "slivers/cell_step.hpp"

#include "predicates/vector_algebra.hpp"

#include <cmath>

namespace fastsim {

double cell_step(const Point &p, const Point &q, const Point &r, const Point &s) {
    const Point u = minus(q, p), v = minus(r, p), w = minus(s, p);
    // Six volumes times the gradients of the shape functions.
    const Point b = cross(v, w), c = cross(w, u), d = cross(u, v);
    const Point a{b[0] + c[0] + d[0], b[1] + c[1] + d[1], b[2] + c[2] + d[2]};
    const double step = dot(d, w) / std::sqrt(dot(a, a) + dot(b, b) + dot(c, c) + dot(d, d));
    return std::isfinite(step) ? step : 0.0;
}

double cell_step(const TetComplex &complex, const Cell &cell) {
    const auto at = [&](std::size_t k) -> const Point & {
        return complex.points[TetComplex::at(cell[k])];
    };
    return cell_step(at(0), at(1), at(2), at(3));
}

double facet_step(const TetComplex &complex, const Triple &facet) {
    const Point &a = complex.points[TetComplex::at(facet[0])];
    const Point u = minus(complex.points[TetComplex::at(facet[1])], a);
    const Point v = minus(complex.points[TetComplex::at(facet[2])], a);
    const Point normal = cross(u, v), w = minus(v, u);
    return std::sqrt(dot(normal, normal) / (dot(u, u) + dot(v, v) + dot(w, w)));
}

} // namespace fastsim
