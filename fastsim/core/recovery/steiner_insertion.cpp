#include "recovery/steiner_insertion.hpp"

#include <algorithm>
#include <unordered_set>

namespace fastsim {

namespace {

constexpr std::size_t largest_cavity = 200;

bool holds(const std::vector<Index> &cells, Index c) {
    return std::find(cells.begin(), cells.end(), c) != cells.end();
}

/// Whether all corners and all protected edges and facets of the cavity lie on its walls.
bool keeps_all(const TetComplex &complex, const Protection &protection,
               const std::vector<Index> &cavity, const std::vector<Triple> &walls) {
    std::unordered_set<Index> corners;
    std::unordered_set<std::uint64_t> edges;
    for (const Triple &w : walls)
        for (std::size_t k = 0; k < 3; ++k) {
            corners.insert(w[k]);
            edges.insert(edge_key(w[k], w[(k + 1) % 3]));
        }
    for (const Index c : cavity) {
        const Cell &v = complex.cell(c);
        for (std::size_t i = 0; i < 4; ++i) {
            if (!corners.contains(v[i]))
                return false;
            for (std::size_t j = i + 1; j < 4; ++j) {
                const std::uint64_t edge = edge_key(v[i], v[j]);
                if (!edges.contains(edge) && protection.edges.contains(edge))
                    return false;
            }
        }
        for (int k = 0; k < 4; ++k) {
            const Triple f = complex.facet(c, k);
            if (complex.neighbour(c, k) != none && holds(cavity, complex.neighbour(c, k)) &&
                protection.facets.contains(sorted_triple(f[0], f[1], f[2])))
                return false;
        }
    }
    return true;
}

} // namespace

bool insert_star(TetComplex &complex, const Protection &protection, std::vector<Index> cavity,
                 Index s, double least_quality) {
    std::vector<Triple> walls;
    for (bool has_grown = true; has_grown;) {
        has_grown = false;
        walls.clear();
        for (std::size_t i = 0; i < cavity.size(); ++i)
            for (int k = 0; k < 4; ++k) {
                const Index n = complex.neighbour(cavity[i], k);
                if (n != none && holds(cavity, n))
                    continue;
                const Triple f = complex.facet(cavity[i], k);
                const Cell seen{f[1], f[0], f[2], s};
                if (complex.orientation(seen) > 0 && cell_quality(complex, seen) >= least_quality) {
                    walls.push_back(f);
                    continue;
                }
                if (n == none || cavity.size() >= largest_cavity ||
                    protection.facets.contains(sorted_triple(f[0], f[1], f[2])))
                    return false;
                cavity.push_back(n);
                has_grown = true;
            }
    }
    if (!keeps_all(complex, protection, cavity, walls))
        return false;
    std::vector<Cell> fresh;
    fresh.reserve(walls.size());
    for (const Triple &f : walls)
        fresh.push_back({f[1], f[0], f[2], s});
    complex.replace(cavity, fresh);
    return true;
}

} // namespace fastsim
