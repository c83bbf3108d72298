#include "explicit/renumber.hpp"

#include "mechanics/block_matrix.hpp"

#include <algorithm>
#include <numeric>

namespace fastsim {

std::vector<Index> reverse_cuthill_mckee(std::size_t num_points, std::span<const Index> cells) {
    const BlockMatrix graph = make_block_matrix(num_points, cells);
    const auto degree = [&](Index i) {
        const auto at = static_cast<std::size_t>(i);
        return graph.row_start[at + 1] - graph.row_start[at];
    };
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
            for (std::size_t k = graph.row_start[row]; k < graph.row_start[row + 1]; ++k) {
                const Index other = graph.columns[k];
                if (is_listed[static_cast<std::size_t>(other)])
                    continue;
                is_listed[static_cast<std::size_t>(other)] = true;
                order.push_back(other);
            }
            std::stable_sort(order.begin() + static_cast<std::ptrdiff_t>(first_new), order.end(),
                             [&](Index a, Index b) { return degree(a) < degree(b); });
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
