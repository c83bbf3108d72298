#include "explicit/renumber.hpp"

#include "mechanics/smoothing_patches.hpp"

#include <algorithm>
#include <utility>

namespace fastsim {

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// Points that share a cell with each point, itself among them, in ascending order.
struct Neighbours {
    std::vector<std::size_t> start;
    std::vector<Index> points;

    Neighbours(std::size_t num_points, std::span<const Index> cells) : start{0} {
        const Groups cells_of = rows_naming(cells, 4, num_points);
        std::vector<Index> seen_from(num_points, -1);
        points.reserve(4 * cells.size());
        for (std::size_t i = 0; i < num_points; ++i) {
            for (const Index cell : cells_of.of(i))
                for (const Index other : cells.subspan(4 * at(cell), 4)) {
                    if (seen_from[at(other)] == static_cast<Index>(i))
                        continue;
                    seen_from[at(other)] = static_cast<Index>(i);
                    points.push_back(other);
                }
            std::sort(points.begin() + static_cast<std::ptrdiff_t>(start.back()), points.end());
            start.push_back(points.size());
        }
    }

    std::size_t count(Index i) const { return start[at(i) + 1] - start[at(i)]; }
};

/// The least crowded first, of equal ones as they are.
void sort_by_count(std::span<Index> points, const Neighbours &graph) {
    const auto is_less = [&](Index a, Index b) { return graph.count(a) < graph.count(b); };
    if (points.size() > 32)
        return std::stable_sort(points.begin(), points.end(), is_less);
    for (std::size_t k = 1; k < points.size(); ++k)
        for (std::size_t i = k; i > 0 && is_less(points[i], points[i - 1]); --i)
            std::swap(points[i], points[i - 1]);
}

} // namespace

std::vector<Index> reverse_cuthill_mckee(std::size_t num_points, std::span<const Index> cells) {
    const Neighbours graph(num_points, cells);
    std::vector<Index> order;
    order.reserve(num_points);
    std::vector<bool> is_listed(num_points, false);
    const auto visit_from = [&](Index seed) {
        std::size_t next = order.size();
        order.push_back(seed);
        is_listed[static_cast<std::size_t>(seed)] = true;
        for (; next < order.size(); ++next) {
            const auto row = static_cast<std::size_t>(order[next]);
            const std::size_t first_new = order.size();
            for (std::size_t k = graph.start[row]; k < graph.start[row + 1]; ++k) {
                const Index other = graph.points[k];
                if (is_listed[static_cast<std::size_t>(other)])
                    continue;
                is_listed[static_cast<std::size_t>(other)] = true;
                order.push_back(other);
            }
            sort_by_count(std::span(order).subspan(first_new), graph);
        }
    };
    for (std::size_t i = 0; i < num_points; ++i) {
        if (is_listed[i])
            continue;
        // Twice from the far end: a cheap pseudo-peripheral start for each part.
        const std::size_t before = order.size();
        visit_from(static_cast<Index>(i));
        const Index far = order.back();
        for (std::size_t k = before; k < order.size(); ++k)
            is_listed[static_cast<std::size_t>(order[k])] = false;
        order.resize(before);
        visit_from(far);
    }
    std::reverse(order.begin(), order.end());
    return order;
}

} // namespace fastsim
