#pragma once
// What the core refuses, with the indices that show it; module.cpp makes Python's errors of them.

#include <cstdint>
#include <stdexcept>
#include <utility>
#include <vector>

namespace fastsim {

struct NonFiniteError : std::invalid_argument {
    std::vector<std::int32_t> points;

    explicit NonFiniteError(std::vector<std::int32_t> guilty)
        : std::invalid_argument("a point is not finite"), points(std::move(guilty)) {}
};

struct CrowdedPointError : std::length_error {
    std::int32_t point;

    explicit CrowdedPointError(std::int32_t guilty)
        : std::length_error("a point has too many neighbours"), point(guilty) {}
};

} // namespace fastsim
