#pragma once
// Axis-aligned boxes of points, and what must hold before any of them is looked at.

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <vector>

namespace fastsim {

using Position = std::array<double, 3>;

// A closed box; low above high where it holds nothing.
struct Extent {
    Position low, high;

    [[nodiscard]] static Extent nothing() {
        constexpr double far = std::numeric_limits<double>::infinity();
        return {{far, far, far}, {-far, -far, -far}};
    }
    void add(const Position &p) {
        for (std::size_t i = 0; i < 3; ++i) {
            low[i] = std::min(low[i], p[i]);
            high[i] = std::max(high[i], p[i]);
        }
    }
    [[nodiscard]] bool contains(const Position &p) const {
        return p[0] >= low[0] && p[0] <= high[0] && p[1] >= low[1] && p[1] <= high[1] &&
               p[2] >= low[2] && p[2] <= high[2];
    }
    [[nodiscard]] bool meets(const Extent &other) const {
        return low[0] <= other.high[0] && other.low[0] <= high[0] && low[1] <= other.high[1] &&
               other.low[1] <= high[1] && low[2] <= other.high[2] && other.low[2] <= high[2];
    }
    [[nodiscard]] Extent common_with(const Extent &other) const {
        Extent both;
        for (std::size_t i = 0; i < 3; ++i) {
            both.low[i] = std::max(low[i], other.low[i]);
            both.high[i] = std::min(high[i], other.high[i]);
        }
        return both;
    }
    [[nodiscard]] Position middle() const { // between the two, without overflow
        return {low[0] + 0.5 * (high[0] - low[0]), low[1] + 0.5 * (high[1] - low[1]),
                low[2] + 0.5 * (high[2] - low[2])};
    }
    [[nodiscard]] double longest() const {
        return std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
    }
};

// Box of a cell's corners.
inline Extent extent_of(std::span<const Position> points, const std::array<std::int32_t, 4> &cell) {
    Extent box = Extent::nothing();
    for (const std::int32_t corner : cell)
        box.add(points[static_cast<std::size_t>(corner)]);
    return box;
}

// Box of all points. Throws std::invalid_argument when one is not finite.
Extent extent_of_all(std::span<const Position> points);

// Box of some points. Throws std::invalid_argument when one is not finite.
Extent extent_of_some(std::span<const Position> points, std::span<const std::int32_t> chosen);

// Of the chosen points those within a box, in the same order, into `kept`; returns their own box.
Extent keep_within(const Extent &box, std::span<const Position> points,
                   std::span<const std::int32_t> chosen, std::vector<std::int32_t> &kept);

} // namespace fastsim
