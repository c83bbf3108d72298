#pragma once
// A closed surface around what facets of any kind wind around: the places where their winding
// number falls through a half, by marching tetrahedra on the cubes that the surface passes.

#include "predicates/predicates.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace fastsim {

struct WrappedSurface {
    std::vector<Point> points;
    std::vector<std::array<std::int32_t, 3>> facets;
    bool is_too_fine = false; // more cubes than allowed: empty then
};

// Cubes of edge `spacing` [m], at most `most_cubes` of them. The result is closed, manifold,
// outward and crosses nothing: its points lie within different edges of one tetrahedralisation.
// `tell` is called with the number of cubes cut so far, after each few thousand; what it throws
// ends the work. Pre-condition: at least one facet; finite.
WrappedSurface wrap_surface(std::span<const Point> points,
                            std::span<const std::array<std::int32_t, 3>> facets, double spacing,
                            std::size_t most_cubes, const std::function<void(std::size_t)> &tell);

} // namespace fastsim
