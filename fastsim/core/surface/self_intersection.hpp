#pragma once
// Pairs of facets that meet anywhere but at the corners and edges they share, by exact signs.

#include "predicates/predicates.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

// Whether two facets of non-zero area meet beyond what they share by number.
bool facets_intersect(std::span<const Point> points, const std::array<std::int32_t, 3> &first,
                      const std::array<std::int32_t, 3> &second);

// All such pairs, first < second, ascending; at most `most` of them.
std::vector<std::array<std::int32_t, 2>>
find_self_intersections(std::span<const Point> points,
                        std::span<const std::array<std::int32_t, 3>> facets, std::size_t most);

} // namespace fastsim
