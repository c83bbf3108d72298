#include "mesher/carve.hpp"

#include <unordered_map>

namespace fastsim {

std::vector<Cell> carve(const TetComplex &complex, std::span<const Triple> facets) {
    std::unordered_map<Triple, Triple, TripleHash> given;
    for (const Triple &f : facets)
        given.emplace(sorted_triple(f[0], f[1], f[2]), f);
    const auto is_same_way = [](const Triple &f, const Triple &g) {
        return (f[0] == g[0] && f[1] == g[1]) || (f[0] == g[1] && f[1] == g[2]) ||
               (f[0] == g[2] && f[1] == g[0]);
    };
    std::vector<char> seen(complex.num_slots(), 0);
    std::vector<Cell> kept;
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot) {
        if (seen[slot] || !complex.is_alive(static_cast<Index>(slot)))
            continue;
        // One region: cells reachable without crossing a facet of the surface.
        std::vector<Index> region{static_cast<Index>(slot)};
        seen[slot] = 1;
        bool is_inside = false, is_outside = false;
        for (std::size_t i = 0; i < region.size(); ++i)
            for (int k = 0; k < 4; ++k) {
                const Index c = region[i], n = complex.neighbour(c, k);
                const Triple f = complex.facet(c, k);
                const auto wall = given.find(sorted_triple(f[0], f[1], f[2]));
                if (wall != given.end()) {
                    // The surface faces outwards, and so does the facet seen from its own cell.
                    (is_same_way(f, wall->second) ? is_inside : is_outside) = true;
                    continue;
                }
                if (n == none)
                    is_outside = true;
                else if (!seen[TetComplex::at(n)]) {
                    seen[TetComplex::at(n)] = 1;
                    region.push_back(n);
                }
            }
        if (is_inside && is_outside)
            return {};
        if (is_inside)
            for (const Index c : region)
                kept.push_back(complex.cell(c));
    }
    return kept;
}

} // namespace fastsim
