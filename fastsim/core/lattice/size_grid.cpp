#include "lattice/size_grid.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

constexpr int key_bits = 20;

} // namespace

std::uint64_t SizeGrid::pack(const Leaf &leaf) {
    std::uint64_t key = 0;
    for (const Index i : leaf)
        key = (key << key_bits) | static_cast<std::uint64_t>(i);
    return key;
}

SizeGrid::SizeGrid(const Point &low, double edge, const std::array<Index, 3> &count,
                   std::span<const Leaf> leaves, std::span<const double> sizes)
    : _low(low), _edge(edge), _count(count), _leaves(leaves.begin(), leaves.end()),
      _sizes(sizes.begin(), sizes.end()) {
    _size_of.reserve(_leaves.size());
    for (std::size_t k = 0; k < _leaves.size(); ++k) {
        _size_of.emplace(pack(_leaves[k]), _sizes[k]);
        _deepest = std::max(_deepest, _leaves[k][0]);
    }
}

double SizeGrid::at(const Point &place) const {
    if (_size_of.empty())
        return _edge_length;
    Leaf leaf{};
    double edge = _edge;
    for (Index level = 0; level <= _deepest; ++level, edge /= 2.0) {
        leaf[0] = level;
        for (std::size_t i = 0; i < 3; ++i) {
            const double last = std::ldexp(static_cast<double>(_count[i]), level) - 1.0;
            leaf[i + 1] =
                static_cast<Index>(std::clamp(std::floor((place[i] - _low[i]) / edge), 0.0, last));
        }
        const auto found = _size_of.find(pack(leaf));
        if (found != _size_of.end())
            return found->second;
    }
    return _sizes.front(); // leaves fill the grid: never reached
}

void SizeGrid::visit(const std::function<void(const Point &, double)> &take) const {
    for (std::size_t k = 0; k < _leaves.size(); ++k) {
        const double edge = std::ldexp(_edge, -_leaves[k][0]);
        Point centre;
        for (std::size_t i = 0; i < 3; ++i)
            centre[i] = _low[i] + (static_cast<double>(_leaves[k][i + 1]) + 0.5) * edge;
        take(centre, _sizes[k]);
    }
}

} // namespace fastsim
