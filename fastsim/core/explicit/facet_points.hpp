#pragma once
// The points of a facet at which gaps are taken, three in each quarter; see ContactRule of Python.

#include "predicates/vector_algebra.hpp"

#include <array>

namespace fastsim {

// Barycentric coordinates (a, b, b) and its rotations in each quarter of a triangle, over its own:
// a = 2/3, b = 1/6, exact for products of two shape functions.
inline std::array<Point, 12> make_facet_points() {
    constexpr std::array<std::array<Point, 3>, 4> quarters{
        {{{{1, 0, 0}, {0.5, 0.5, 0}, {0.5, 0, 0.5}}},
         {{{0, 1, 0}, {0, 0.5, 0.5}, {0.5, 0.5, 0}}},
         {{{0, 0, 1}, {0.5, 0, 0.5}, {0, 0.5, 0.5}}},
         {{{0.5, 0.5, 0}, {0, 0.5, 0.5}, {0.5, 0, 0.5}}}}};
    std::array<Point, 12> points{};
    for (std::size_t q = 0; q < 12; ++q)
        for (std::size_t c = 0; c < 3; ++c)
            points[q] = along(points[q], quarters[q / 3][c], c == q % 3 ? 2.0 / 3.0 : 1.0 / 6.0);
    return points;
}
inline const std::array<Point, 12> facet_points = make_facet_points();

} // namespace fastsim
