#pragma once
// The quick part of the question whether a surface bounds a solid: most do, and plainly so.

#include "predicates/predicates.hpp"

#include <array>
#include <cstdint>
#include <span>

namespace fastsim {

/// Whether facets surely are one closed, connected, manifold shell that faces outwards, without a
/// facet of no area. False is no verdict: several shells, for one, need a longer look.
bool is_plain_shell(std::span<const Point> points,
                    std::span<const std::array<std::int32_t, 3>> facets);

} // namespace fastsim
