#include "delaunay/triangulation.hpp"

#include <algorithm>

namespace fastsim {

DelaunayFault find_delaunay_fault(std::span<const Point> points,
                                  std::span<const std::array<std::int32_t, 4>> cells) {
    struct Side {
        std::array<std::int32_t, 3> facet; // sorted
        std::int32_t cell, corner;
    };
    const auto at = [&](std::int32_t i) { return points[static_cast<std::size_t>(i)]; };
    std::vector<Side> sides;
    sides.reserve(4 * cells.size());
    for (std::size_t c = 0; c < cells.size(); ++c) {
        const auto &v = cells[c];
        const auto number = static_cast<std::int32_t>(c);
        if (orient3d(at(v[0]), at(v[1]), at(v[2]), at(v[3])) <= 0) {
            return {number, -1, -1};
        }
        for (std::size_t k = 0; k < 4; ++k) {
            Side side{{v[(k + 1) % 4], v[(k + 2) % 4], v[(k + 3) % 4]},
                      number,
                      static_cast<std::int32_t>(k)};
            std::sort(side.facet.begin(), side.facet.end());
            sides.push_back(side);
        }
    }
    std::sort(sides.begin(), sides.end(), [](const Side &a, const Side &b) {
        return std::pair(a.facet, a.cell) < std::pair(b.facet, b.cell);
    });
    for (std::size_t i = 0; i < sides.size(); ++i) {
        const Side &here = sides[i];
        const bool is_pair = i + 1 < sides.size() && sides[i + 1].facet == here.facet;
        if (!is_pair) {
            // A facet of one cell: on the hull, so no other point may lie beyond it. The facet's
            // neighbours on the hull suffice, which the convexity check of the volume covers.
            continue;
        }
        const Side &there = sides[i + 1];
        if (i + 2 < sides.size() && sides[i + 2].facet == here.facet) {
            return {here.cell, here.corner, -1}; // three cells at one facet
        }
        const auto &v = cells[static_cast<std::size_t>(here.cell)];
        const std::int32_t apex =
            cells[static_cast<std::size_t>(there.cell)][static_cast<std::size_t>(there.corner)];
        std::array<std::int32_t, 4> flipped = v;
        flipped[static_cast<std::size_t>(here.corner)] = apex;
        if (orient3d(at(flipped[0]), at(flipped[1]), at(flipped[2]), at(flipped[3])) >= 0 ||
            in_sphere(at(v[0]), at(v[1]), at(v[2]), at(v[3]), at(apex)) > 0) {
            return {here.cell, here.corner, apex};
        }
        ++i;
    }
    return {};
}

} // namespace fastsim
