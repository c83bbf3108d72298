#include "mesher/sliver_removal.hpp"

#include "mesher/point_insertion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr std::size_t largest_ring = 9;
// A change must be worth it, or passes never end.
constexpr double least_gain = 1e-6;
// Points are inserted for the worst cells only: below about 25 degrees for a target of 30.
constexpr double insertion_share = 0.84;

/// Worst quality; any value not above `floor` once that is known.
double worst_of(const TetComplex &complex, const std::vector<Index> &cells,
                double floor = -std::numeric_limits<double>::infinity()) {
    double worst = std::numeric_limits<double>::infinity();
    for (const Index c : cells) {
        worst = std::min(worst, cell_quality(complex, complex.cell(c)));
        if (!(worst > floor))
            break;
    }
    return worst;
}

bool flip_around(TetComplex &complex, Index c, const Protection &protection) {
    const Cell v = complex.cell(c);
    std::vector<Index> cells, ring;
    bool is_closed = false;
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j) {
            complex.edge_ring(v[i], v[j], cells, ring, is_closed);
            if (!is_closed || ring.size() > largest_ring)
                continue;
            const double before = worst_of(complex, cells);
            if (remove_edge(complex, v[i], v[j], protection, largest_ring, before + least_gain,
                            none, none))
                return true;
        }
    for (int k = 0; k < 4; ++k) {
        const Index n = complex.neighbour(c, k);
        if (n == none)
            continue;
        const double before = std::min(cell_quality(complex, complex.cell(c)),
                                       cell_quality(complex, complex.cell(n)));
        if (flip_facet(complex, {c, k}, protection, before + least_gain))
            return true;
    }
    return false;
}

/// Moves a point to make the worst cell around it better: to its neighbours' centre, then by a
/// pattern of steps along the axes, halved until they are small.
bool move_point(TetComplex &complex, Index point, std::vector<Index> &around) {
    complex.cells_around(point, around);
    if (around.empty())
        return false;
    Point &place = complex.points[TetComplex::at(point)];
    const Point start = place;
    const double before = worst_of(complex, around);
    double best = before;
    Point best_place = start;
    const auto try_place = [&](const Point &candidate) {
        place = candidate;
        const double worst = worst_of(complex, around, best);
        if (worst > best)
            // Quality is rounded; positivity is asked of the exact predicate.
            if (std::all_of(around.begin(), around.end(),
                            [&](Index c) { return complex.orientation(complex.cell(c)) > 0; })) {
                best = worst;
                best_place = candidate;
                place = candidate;
                return true;
            }
        place = best_place;
        return false;
    };
    Point centre{};
    double count = 0.0, reach = 0.0;
    for (const Index c : around)
        for (const Index v : complex.cell(c)) {
            if (v == point)
                continue;
            double squared = 0.0;
            for (std::size_t i = 0; i < 3; ++i) {
                const double x = complex.points[TetComplex::at(v)][i];
                centre[i] += x;
                squared += (x - start[i]) * (x - start[i]);
            }
            reach = std::max(reach, std::sqrt(squared));
            count += 1.0;
        }
    Point candidate;
    for (std::size_t i = 0; i < 3; ++i)
        candidate[i] = centre[i] / count;
    try_place(candidate);
    for (double step = 0.2 * reach; step > 0.01 * reach; step *= 0.5)
        for (std::size_t axis = 0; axis < 3; ++axis)
            for (const double way : {1.0, -1.0}) {
                candidate = best_place;
                candidate[axis] += way * step;
                try_place(candidate);
            }
    place = best_place;
    return best > before + least_gain;
}

} // namespace

SliverReport remove_slivers(TetComplex &complex, Index num_fixed, double target, int max_passes) {
    SliverReport report;
    const Protection nothing_more; // boundary edges and facets have no ring or neighbour to flip
    std::vector<Index> around;
    Index spare = none;
    std::vector<std::pair<Cell, int>> failures; // insertions tried in vain, by slot
    // Bounds the work and the growth of the mesh.
    const std::size_t most_insertions = complex.num_slots() / 10;
    for (int pass = 0; pass < max_passes; ++pass) {
        std::size_t changes = 0;
        std::vector<std::pair<double, Index>> bad;
        for (std::size_t slot = 0; slot < complex.num_slots(); ++slot) {
            const auto c = static_cast<Index>(slot);
            if (!complex.is_alive(c))
                continue;
            const double quality = cell_quality(complex, complex.cell(c));
            if (quality < target)
                bad.emplace_back(quality, c);
        }
        std::sort(bad.begin(), bad.end());
        for (const auto &[quality, c] : bad) {
            if (!complex.is_alive(c) || cell_quality(complex, complex.cell(c)) >= target)
                continue;
            if (flip_around(complex, c, nothing_more)) {
                ++report.flips;
                ++changes;
                continue;
            }
            bool has_moved = false;
            for (const Index v : Cell(complex.cell(c)))
                if (v >= num_fixed && move_point(complex, v, around)) {
                    ++report.moves;
                    ++changes;
                    has_moved = true;
                }
            if (has_moved || quality > insertion_share * target ||
                report.insertions >= most_insertions)
                continue;
            // What failed once fails again unless something near has changed; twice is enough.
            if (TetComplex::at(c) >= failures.size())
                failures.resize(2 * complex.num_slots(), {Cell{}, 0});
            auto &[failed, times] = failures[TetComplex::at(c)];
            if (failed != complex.cell(c)) {
                failed = complex.cell(c);
                times = 0;
            }
            if (times == 2)
                continue;
            if (insert_point_at(complex, c, spare)) {
                ++report.insertions;
                ++changes;
            } else {
                ++times;
            }
        }
        if (changes == 0)
            break;
    }
    return report;
}

} // namespace fastsim
