#include "mesher/carve.hpp"

#include "mesher/facet_table.hpp"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace fastsim {

namespace {

bool is_same_way(const Triple &f, const Triple &g) {
    return (f[0] == g[0] && f[1] == g[1]) || (f[0] == g[1] && f[1] == g[2]) ||
           (f[0] == g[2] && f[1] == g[0]);
}

} // namespace

TetComplex carve(const TetComplex &complex, std::span<const Triple> facets) {
    TetComplex inside;
    const FacetTable given(facets);
    // Of cells inside that in their turn, of others some number that nobody asks for.
    std::vector<Index> number(complex.num_slots(), none);
    std::vector<Cell> cells, neighbours;
    std::vector<Index> region;
    // What is not used of it costs nothing.
    cells.reserve(complex.num_slots());
    neighbours.reserve(complex.num_slots());
    region.reserve(complex.num_slots());
    // One region: cells reachable without crossing a facet of the surface. False where it lies on
    // both sides of that.
    const auto walk = [&](Index start, bool is_known_outside) {
        const auto first = static_cast<Index>(cells.size());
        region.assign(1, start);
        number[TetComplex::at(start)] = first;
        bool is_inside = false, is_outside = is_known_outside;
        for (std::size_t i = 0; i < region.size(); ++i) {
            const Index c = region[i];
            Cell beyond{none, none, none, none};
            const bool may_have_wall = given.may_have_one_of(complex.cell(c));
            for (int k = 0; k < 4; ++k) {
                if (may_have_wall) {
                    const Triple f = complex.facet(c, k);
                    const Index wall = given.find(f);
                    if (wall != none) {
                        // The surface faces outwards, and so does the facet seen from its own cell.
                        (is_same_way(f, facets[TetComplex::at(wall)]) ? is_inside : is_outside) =
                            true;
                        continue;
                    }
                }
                const Index n = complex.neighbour(c, k);
                if (n == none) {
                    is_outside = true;
                    continue;
                }
                Index &next = number[TetComplex::at(n)];
                if (next == none) {
                    next = first + static_cast<Index>(region.size());
                    region.push_back(n);
                }
                beyond[static_cast<std::size_t>(k)] = next;
            }
            if (!is_known_outside) {
                cells.push_back(complex.cell(c));
                neighbours.push_back(beyond);
            }
        }
        if (!is_inside) {
            cells.resize(TetComplex::at(first));
            neighbours.resize(TetComplex::at(first));
        }
        return !(is_inside && is_outside);
    };
    const auto is_open = [&](std::size_t slot) {
        return number[slot] == none && complex.is_alive(static_cast<Index>(slot));
    };
    const auto is_outer = [&](std::size_t slot) {
        return std::ranges::any_of(std::array{0, 1, 2, 3}, [&](int k) {
            return complex.neighbour(static_cast<Index>(slot), k) == none;
        });
    };
    // The outside first, of which nothing is needed.
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot)
        if (is_open(slot) && is_outer(slot)) {
            if (!walk(static_cast<Index>(slot), true))
                return inside;
            break;
        }
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot)
        if (is_open(slot) && !walk(static_cast<Index>(slot), false))
            return inside;
    inside.add_points(complex.points);
    inside.set_cells(std::move(cells), std::move(neighbours));
    return inside;
}

} // namespace fastsim
