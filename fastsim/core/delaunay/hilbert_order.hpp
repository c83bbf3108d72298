#pragma once

#include "predicates/predicates.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

// Order of insertion: rounds of random points, each eight times the last (BRIO: Amenta, Choi, Rote
// 2003, which keeps the expected cost linear for any input), each along a Hilbert curve, so that
// a point lies near the one before. The same points give the same order.
std::vector<std::int32_t> insertion_order(std::span<const Point> points);

} // namespace fastsim
