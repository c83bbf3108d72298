#pragma once
// Wanted edge lengths from place to place: a size field sampled on cubes that are halved where it
// is smaller than they are.

#include "mesher/tet_complex.hpp"

#include <functional>
#include <span>
#include <unordered_map>

namespace fastsim {

class SizeGrid {
  public:
    /// One cube that is not halved: its level (0 is the largest) and its number along each axis.
    using Leaf = std::array<Index, 4>;

    /// No sizes: wanted everywhere is `edge_length`.
    explicit SizeGrid(double edge_length) : _edge_length(edge_length) {}

    /// Leaves fill `count` cubes of `edge` from `low` on; a size for each, all above 0.
    SizeGrid(const Point &low, double edge, const std::array<Index, 3> &count,
             std::span<const Leaf> leaves, std::span<const double> sizes);

    /// Wanted edge length at a place; outside, that of the nearest cube.
    double at(const Point &place) const;

    /// Calls with the centre of every leaf and its size, in an order that depends on nothing else.
    void visit(const std::function<void(const Point &, double)> &take) const;

  private:
    static std::uint64_t pack(const Leaf &leaf);

    double _edge_length = 0.0;
    Point _low{};
    double _edge = 0.0;
    std::array<Index, 3> _count{};
    Index _deepest = 0;
    std::vector<Leaf> _leaves;
    std::vector<double> _sizes;
    std::unordered_map<std::uint64_t, double> _size_of;
};

} // namespace fastsim
