#include "surface/box_tree.hpp"

#include <algorithm>
#include <limits>

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
    std::vector<Item> items(facets.size());
    for (std::size_t f = 0; f < facets.size(); ++f) {
        items[f].facet = static_cast<std::int32_t>(f);
        for (std::size_t i = 0; i < 3; ++i)
            items[f].middle[i] = _boxes[f].low[i] + _boxes[f].high[i];
    }
    _nodes.reserve(2 * facets.size());
    if (!facets.empty())
        build(items);
}

std::int32_t BoxTree::build(std::span<Item> items) {
    Box box = box_of(static_cast<std::size_t>(items[0].facet));
    std::int32_t last = items[0].facet;
    for (const Item &item : items) {
        const Box &other = box_of(static_cast<std::size_t>(item.facet));
        for (std::size_t i = 0; i < 3; ++i) {
            box.low[i] = std::min(box.low[i], other.low[i]);
            box.high[i] = std::max(box.high[i], other.high[i]);
        }
        last = std::max(last, item.facet);
    }
    const auto number = static_cast<std::int32_t>(_nodes.size());
    _nodes.push_back({box, items[0].facet, -1, last});
    if (items.size() == 1)
        return number;
    std::size_t axis = 0;
    for (std::size_t i = 1; i < 3; ++i)
        if (box.high[i] - box.low[i] > box.high[axis] - box.low[axis])
            axis = i;
    const std::size_t middle = items.size() / 2;
    std::nth_element(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(middle),
                     items.end(), [&](const Item &a, const Item &b) {
                         return a.middle[axis] != b.middle[axis] ? a.middle[axis] < b.middle[axis]
                                                                 : a.facet < b.facet;
                     });
    const std::int32_t left = build(items.first(middle)), right = build(items.subspan(middle));
    _nodes[static_cast<std::size_t>(number)].left = left;
    _nodes[static_cast<std::size_t>(number)].right = right;
    return number;
}

} // namespace fastsim
