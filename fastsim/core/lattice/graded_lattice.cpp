#include "lattice/graded_lattice.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fastsim {

namespace {

// Three coordinates of 21 bits, kept positive by the offset.
constexpr int key_bits = 21;
constexpr Index key_offset = 1 << (key_bits - 1);
constexpr std::size_t most_levels = 10;

} // namespace

GradedLattice::Key GradedLattice::pack(const Cube &cube) {
    Key key = 0;
    for (const Index i : cube)
        key = (key << key_bits) | static_cast<Key>(i + key_offset);
    return key;
}

GradedLattice::Cube GradedLattice::unpack(Key key) {
    Cube cube;
    for (std::size_t axis = 3; axis-- > 0; key >>= key_bits)
        cube[axis] = static_cast<Index>(key & ((Key{1} << key_bits) - 1)) - key_offset;
    return cube;
}

bool GradedLattice::is_split(std::size_t level, const Cube &cube) const {
    return level < _split.size() && _split[level].contains(pack(cube));
}

Point GradedLattice::corner(const Cube &cube, double edge, double shift) const {
    Point p;
    for (std::size_t i = 0; i < 3; ++i)
        p[i] = _grid.low[i] + (static_cast<double>(cube[i]) + shift) * edge;
    return p;
}

GradedLattice::GradedLattice(const CubeGrid &grid, std::span<const Point> places,
                             std::span<const double> wanted_edges, std::size_t num_wide,
                             Halving halving)
    : _grid(grid) {
    std::size_t deepest = 0;
    const Index longest = *std::max_element(grid.count.begin(), grid.count.end()) + 2;
    while (deepest < most_levels && (longest << (deepest + 1)) < key_offset)
        ++deepest;
    std::vector<Level> wanted(deepest);
    for (std::size_t p = 0; p < places.size(); ++p) {
        std::size_t level = 0;
        double edge = grid.edge;
        while (level < deepest && edge > halving.tolerance * wanted_edges[p]) {
            ++level;
            edge /= 2.0;
        }
        if (level == 0)
            continue;
        // Cubes that reach within its distance of the place.
        Cube first, last;
        for (std::size_t i = 0; i < 3; ++i) {
            const double x = places[p][i] - grid.low[i],
                         radius = p < num_wide ? halving.reach * wanted_edges[p] : 0.0;
            first[i] = static_cast<Index>(std::floor((x - radius) / (2.0 * edge)));
            last[i] = static_cast<Index>(std::floor((x + radius) / (2.0 * edge)));
        }
        for (Index i = first[0]; i <= last[0]; ++i)
            for (Index j = first[1]; j <= last[1]; ++j)
                for (Index k = first[2]; k <= last[2]; ++k)
                    wanted[level - 1].insert(pack({i, j, k}));
    }
    while (!wanted.empty() && wanted.back().empty())
        wanted.pop_back();
    _split.resize(wanted.size());
    for (std::size_t level = wanted.size(); level-- > 0;) {
        _split[level] = std::move(wanted[level]);
        if (level + 1 == _split.size())
            continue;
        // Neighbours of halves are halves, too.
        for (const Key key : _split[level + 1]) {
            const Cube half = unpack(key);
            for (Index n = 0; n < 27; ++n)
                _split[level].insert(
                    pack({(half[0] + n / 9 - 1) >> 1, (half[1] + n / 3 % 3 - 1) >> 1,
                          (half[2] + n % 3 - 1) >> 1}));
        }
    }
}

void GradedLattice::visit(bool has_centres,
                          const std::function<void(const Point &, double)> &take) const {
    for (Index i = 0; i <= _grid.count[0]; ++i)
        for (Index j = 0; j <= _grid.count[1]; ++j)
            for (Index k = 0; k <= _grid.count[2]; ++k) {
                take(corner({i, j, k}, _grid.edge, 0.0), _grid.edge);
                if (has_centres && !is_split(0, {i, j, k}))
                    take(corner({i, j, k}, _grid.edge, 0.5), _grid.edge);
            }
    // Corners of halves; those of the coarser cubes have been met before.
    std::vector<Key> keys;
    for (std::size_t level = 0; level < _split.size(); ++level) {
        keys.assign(_split[level].begin(), _split[level].end());
        std::sort(keys.begin(), keys.end());
        const double edge = std::ldexp(_grid.edge, -static_cast<int>(level) - 1);
        Level met;
        for (const Key key : keys) {
            const Cube parent = unpack(key);
            for (Index n = 0; n < 27; ++n) {
                const Cube half{2 * parent[0] + n / 9, 2 * parent[1] + n / 3 % 3,
                                2 * parent[2] + n % 3};
                const bool is_old = ((half[0] | half[1] | half[2]) & 1) == 0;
                if (!is_old && met.insert(pack(half)).second)
                    take(corner(half, edge, 0.0), edge);
                const bool is_cube = n / 9 < 2 && n / 3 % 3 < 2 && n % 3 < 2;
                if (has_centres && is_cube && !is_split(level + 1, half))
                    take(corner(half, edge, 0.5), edge);
            }
        }
    }
}

} // namespace fastsim
