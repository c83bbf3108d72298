#include "surface/box_tree.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace fastsim {

BoxTree::BoxTree(std::span<const Point> points, std::span<const std::array<std::int32_t, 3>> facets)
    : _boxes(facets.size()) {
    for (std::size_t f = 0; f < facets.size(); ++f) {
        Box &box = _boxes[f];
        box.low.fill(std::numeric_limits<double>::infinity());
        box.high.fill(-std::numeric_limits<double>::infinity());
        for (const std::int32_t v : facets[f])
            for (std::size_t i = 0; i < 3; ++i) {
                const double x = points[static_cast<std::size_t>(v)][i];
                box.low[i] = std::min(box.low[i], x);
                box.high[i] = std::max(box.high[i], x);
            }
    }
    std::vector<std::int32_t> order(facets.size());
    for (std::size_t f = 0; f < facets.size(); ++f)
        order[f] = static_cast<std::int32_t>(f);
    _nodes.reserve(2 * facets.size());
    if (!facets.empty())
        build(order, 0, facets.size());
}

std::int32_t BoxTree::build(std::vector<std::int32_t> &order, std::size_t begin, std::size_t end) {
    const auto box_at = [&](std::int32_t f) -> const Box & {
        return _boxes[static_cast<std::size_t>(f)];
    };
    Box box = box_at(order[begin]);
    for (std::size_t k = begin; k < end; ++k) {
        const Box &other = box_at(order[k]);
        for (std::size_t i = 0; i < 3; ++i) {
            box.low[i] = std::min(box.low[i], other.low[i]);
            box.high[i] = std::max(box.high[i], other.high[i]);
        }
    }
    const auto number = static_cast<std::int32_t>(_nodes.size());
    const auto first = order.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto last = std::max_element(first, order.begin() + static_cast<std::ptrdiff_t>(end));
    _nodes.push_back({box, *first, -1, *last});
    if (end - begin == 1)
        return number;
    std::size_t axis = 0;
    for (std::size_t i = 1; i < 3; ++i)
        if (box.high[i] - box.low[i] > box.high[axis] - box.low[axis])
            axis = i;
    const std::size_t middle = (begin + end) / 2;
    const auto at = [&](std::size_t k) { return order.begin() + static_cast<std::ptrdiff_t>(k); };
    std::nth_element(at(begin), at(middle), at(end), [&](std::int32_t a, std::int32_t b) {
        const Box &p = box_at(a), &q = box_at(b);
        return std::pair(p.low[axis] + p.high[axis], a) < std::pair(q.low[axis] + q.high[axis], b);
    });
    const std::int32_t left = build(order, begin, middle), right = build(order, middle, end);
    _nodes[static_cast<std::size_t>(number)].left = left;
    _nodes[static_cast<std::size_t>(number)].right = right;
    return number;
}

} // namespace fastsim
