#include "mesher/flips.hpp"

#include "slivers/cell_step.hpp"

#include <algorithm>
#include <limits>

namespace fastsim {

namespace {

constexpr double impossible = -std::numeric_limits<double>::infinity();

/// Quality of a cell, or impossible when it does not beat what must be beaten, or is not positive
/// by the exact predicate.
double safe_quality(const TetComplex &complex, const Cell &cell, double quality_to_beat) {
    if (complex.least_sine > 0.0) {
        const double step = cell_step(complex, cell);
        return step > quality_to_beat && cell_quality(complex, cell) >= complex.least_sine &&
                       complex.orientation(cell) > 0
                   ? step
                   : impossible;
    }
    const double quality = cell_quality_above(complex, cell, quality_to_beat);
    return quality > quality_to_beat && complex.orientation(cell) > 0 ? quality : impossible;
}

} // namespace

bool remove_edge(TetComplex &complex, Index a, Index b, const Protection &protection,
                 std::size_t max_ring, double quality_to_beat, Index wanted_a, Index wanted_b) {
    if (protection.edges.contains(edge_key(a, b)))
        return false;
    std::vector<Index> cells, ring;
    bool is_closed = false;
    complex.edge_ring(a, b, cells, ring, is_closed);
    if (!is_closed || ring.size() < 3 || ring.size() > max_ring)
        return false;
    return retriangulate_ring(complex, a, b, cells, ring, quality_to_beat, wanted_a, wanted_b);
}

bool retriangulate_ring(TetComplex &complex, Index a, Index b, const std::vector<Index> &cells,
                        std::vector<Index> &ring, double quality_to_beat, Index wanted_a,
                        Index wanted_b) {
    const std::size_t n = ring.size();
    // Make the ring run so that (ring[i], ring[i+1], a, b) is positive: then triangle (i, j, k)
    // with i < j < k gives cells (i, j, k, b) and (j, i, k, a).
    const Cell first{ring[0], ring[1], a, b};
    if (complex.orientation(first) < 0) {
        std::reverse(ring.begin(), ring.end());
    }
    // Two ring corners that already share an edge elsewhere may not get a second one.
    const auto triangle_quality = [&](std::size_t i, std::size_t j, std::size_t k) {
        const double above = safe_quality(complex, {ring[i], ring[j], ring[k], b}, quality_to_beat);
        if (above == impossible)
            return impossible;
        return std::min(above,
                        safe_quality(complex, {ring[j], ring[i], ring[k], a}, quality_to_beat));
    };
    std::size_t wanted_i = n, wanted_j = n;
    if (wanted_a >= 0) {
        wanted_i =
            static_cast<std::size_t>(std::find(ring.begin(), ring.end(), wanted_a) - ring.begin());
        wanted_j =
            static_cast<std::size_t>(std::find(ring.begin(), ring.end(), wanted_b) - ring.begin());
        if (wanted_i == n || wanted_j == n)
            return false;
        if (wanted_i > wanted_j)
            std::swap(wanted_i, wanted_j);
    }
    const auto crosses_wanted = [&](std::size_t i, std::size_t j) {
        if (wanted_i == n)
            return false;
        const bool i_between = i > wanted_i && i < wanted_j;
        const bool j_between = j > wanted_i && j < wanted_j;
        const bool touches = i == wanted_i || i == wanted_j || j == wanted_i || j == wanted_j;
        return !touches && i_between != j_between;
    };
    // best[i][j]: best worst quality of the polygon i, i+1, ..., j.
    thread_local std::vector<double> best; // kept for their memory, here and below
    thread_local std::vector<std::size_t> split;
    best.assign(n * n, std::numeric_limits<double>::infinity());
    split.assign(n * n, 0);
    for (std::size_t width = 2; width < n; ++width)
        for (std::size_t i = 0; i + width < n; ++i) {
            const std::size_t j = i + width;
            double &here = best[i * n + j];
            here = impossible;
            const bool is_whole = i == 0 && j == n - 1;
            if (!is_whole && crosses_wanted(i, j))
                continue;
            for (std::size_t k = i + 1; k < j; ++k) {
                if (crosses_wanted(i, k) || crosses_wanted(k, j))
                    continue;
                const double parts = std::min(best[i * n + k], best[k * n + j]);
                if (parts <= here)
                    continue;
                const double quality = std::min(parts, triangle_quality(i, k, j));
                if (quality > here) {
                    here = quality;
                    split[i * n + j] = k;
                }
            }
        }
    if (!(best[n - 1] > quality_to_beat))
        return false;
    thread_local std::vector<Cell> fresh;
    thread_local std::vector<std::pair<std::size_t, std::size_t>> open;
    fresh.clear();
    open.assign(1, {0, n - 1});
    while (!open.empty()) {
        const auto [i, j] = open.back();
        open.pop_back();
        if (j < i + 2)
            continue;
        const std::size_t k = split[i * n + j];
        fresh.push_back({ring[i], ring[k], ring[j], b});
        fresh.push_back({ring[k], ring[i], ring[j], a});
        open.emplace_back(i, k);
        open.emplace_back(k, j);
    }
    complex.replace(cells, fresh);
    return true;
}

bool flip_facet(TetComplex &complex, Side side, const Protection &protection,
                double quality_to_beat) {
    const Index other = complex.neighbour(side.cell, side.facet);
    if (other == none)
        return false;
    const Triple f = complex.facet(side.cell, side.facet);
    if (protection.facets.contains(sorted_triple(f[0], f[1], f[2])))
        return false;
    const Index inner = complex.cell(side.cell)[static_cast<std::size_t>(side.facet)];
    Index outer = none;
    for (const Index v : complex.cell(other))
        if (v != f[0] && v != f[1] && v != f[2])
            outer = v;
    // (f1, f0, f2, inner) is positive; turning around the new edge (inner, outer):
    std::array<Cell, 3> fresh;
    for (std::size_t k = 0; k < 3; ++k) {
        fresh[k] = {f[k], f[(k + 1) % 3], inner, outer};
        if (safe_quality(complex, fresh[k], quality_to_beat) == impossible)
            return false;
    }
    const std::array<Index, 2> dead{side.cell, other};
    complex.replace(dead, fresh);
    return true;
}

} // namespace fastsim
