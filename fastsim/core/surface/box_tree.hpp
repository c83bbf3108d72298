#pragma once
// A tree of axis-parallel boxes over facets, halved at the median of the longest axis.

#include "predicates/predicates.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

struct Box {
    Point low, high;
};

inline bool boxes_overlap(const Box &a, const Box &b) {
    for (std::size_t i = 0; i < 3; ++i)
        if (a.low[i] > b.high[i] || b.low[i] > a.high[i])
            return false;
    return true;
}

class BoxTree {
  public:
    // Leaves (right < 0) hold the single facet `left`; `last` is the largest number of a facet
    // below.
    struct Node {
        Box box;
        std::int32_t left, right, last;
    };

    BoxTree(std::span<const Point> points, std::span<const std::array<std::int32_t, 3>> facets);

    // The root is node 0; empty without facets.
    [[nodiscard]] std::span<const Node> nodes() const { return _nodes; }
    [[nodiscard]] const Box &box_of(std::size_t facet) const { return _boxes[facet]; }

  private:
    struct Item {
        Point middle; // twice
        std::int32_t facet;
    };

    std::int32_t build(std::span<Item> items);

    std::vector<Box> _boxes;
    std::vector<Node> _nodes;
};

} // namespace fastsim
