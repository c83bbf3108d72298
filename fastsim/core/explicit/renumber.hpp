#pragma once
// Reverse Cuthill-McKee numbering of the points (Cuthill and McKee 1969; George 1971), for
// locality: neighbours in space become neighbours in memory.

#include "mechanics/tet4.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace fastsim {

/// The old number of each new point. Deterministic.
std::vector<Index> reverse_cuthill_mckee(std::size_t num_points, std::span<const Index> cells);

} // namespace fastsim
