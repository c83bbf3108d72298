#include "mesher/delaunay.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace fastsim {

namespace {

Point corner_point(const TetComplex &complex, Index i) { return complex.points[TetComplex::at(i)]; }

/// Interleaves 20 bits of three coordinates (Morton order).
std::uint64_t spread_bits(std::uint64_t x) {
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    x = (x | x << 2) & 0x1249249249249249ull;
    return x;
}

void bounds(std::span<const Point> points, Point &low, Point &high) {
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
    for (const Point &p : points)
        for (std::size_t i = 0; i < 3; ++i) {
            low[i] = std::min(low[i], p[i]);
            high[i] = std::max(high[i], p[i]);
        }
}

} // namespace

std::vector<Index> spatial_order(std::span<const Point> points) {
    Point low, high;
    bounds(points, low, high);
    std::vector<std::uint64_t> code(points.size());
    for (std::size_t p = 0; p < points.size(); ++p)
        for (std::size_t i = 0; i < 3; ++i) {
            const double width = high[i] - low[i];
            const double part = width > 0.0 ? (points[p][i] - low[i]) / width : 0.0;
            code[p] |= spread_bits(static_cast<std::uint64_t>(part * 1048575.0)) << i;
        }
    std::vector<Index> order(points.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) {
        return code[TetComplex::at(a)] < code[TetComplex::at(b)];
    });
    return order;
}

TetComplex start_in_cube(std::span<const Point> points, double margin) {
    Point low, high;
    bounds(points, low, high);
    double size = 0.0;
    for (std::size_t i = 0; i < 3; ++i)
        size = std::max(size, high[i] - low[i]);
    const double reach = (0.5 + margin) * size;
    TetComplex complex;
    for (int corner = 0; corner < 8; ++corner) {
        Point p;
        for (std::size_t i = 0; i < 3; ++i) {
            const double centre = 0.5 * (low[i] + high[i]);
            p[i] = (corner >> i) & 1 ? centre + reach : centre - reach;
        }
        complex.add_point(p);
    }
    // One cell in the middle on alternate corners, one on each other corner.
    std::array<Cell, 5> cells{
        {{0, 3, 5, 6}, {1, 0, 3, 5}, {2, 0, 6, 3}, {4, 0, 5, 6}, {7, 3, 6, 5}}};
    for (Cell &c : cells)
        if (complex.orientation(c) < 0)
            std::swap(c[0], c[1]);
    complex.set_cells(cells);
    return complex;
}

Index locate(const TetComplex &complex, const Point &point, Index hint) {
    Index current = hint;
    Index from = none;
    // Starting at another facet each time keeps a walk from circling; the sequence is fixed.
    std::uint32_t turn = 12345;
    const std::size_t limit = 4 * complex.num_slots() + 64;
    for (std::size_t step = 0; step < limit; ++step) {
        turn = turn * 1664525u + 1013904223u;
        const int first = static_cast<int>(turn >> 30);
        Index next = none;
        bool is_outside = false;
        for (int k = 0; k < 4 && !is_outside; ++k) {
            const int facet = (first + k) & 3;
            const Index beyond = complex.neighbour(current, facet);
            if (beyond != none && beyond == from)
                continue;
            const Triple f = complex.facet(current, facet);
            // Outward facet: the point is beyond it when it sees the facet counter-clockwise.
            if (orient3d(corner_point(complex, f[0]), corner_point(complex, f[1]),
                         corner_point(complex, f[2]), point) > 0) {
                is_outside = true;
                next = beyond;
            }
        }
        if (!is_outside)
            return current;
        if (next == none)
            return none;
        from = current;
        current = next;
    }
    return none;
}

bool insert_point(TetComplex &complex, Index point, Index &hint, const FacetSet &walls,
                  Index &twin) {
    const Point place = complex.points[TetComplex::at(point)];
    const Index start = locate(complex, place, hint);
    twin = none;
    if (start == none)
        return false;
    for (const Index v : complex.cell(start))
        if (complex.points[TetComplex::at(v)] == place) {
            twin = v;
            hint = start;
            return false;
        }
    std::vector<Index> cavity{start};
    std::vector<Triple> hull;
    std::vector<Index> rejected;
    const auto contains = [](const std::vector<Index> &list, Index c) {
        return std::find(list.begin(), list.end(), c) != list.end();
    };
    for (std::size_t i = 0; i < cavity.size(); ++i) {
        const Index c = cavity[i];
        for (int k = 0; k < 4; ++k) {
            const Index n = complex.neighbour(c, k);
            if (n != none && contains(cavity, n))
                continue;
            const Triple f = complex.facet(c, k);
            const bool is_wall =
                n == none || (!walls.empty() && walls.contains(sorted_triple(f[0], f[1], f[2])));
            if (!is_wall && !contains(rejected, n)) {
                const Cell &v = complex.cell(n);
                if (in_sphere(corner_point(complex, v[0]), corner_point(complex, v[1]),
                              corner_point(complex, v[2]), corner_point(complex, v[3]),
                              place) > 0) {
                    cavity.push_back(n);
                    continue;
                }
                rejected.push_back(n);
            }
        }
    }
    std::vector<Cell> fresh;
    for (const Index c : cavity)
        for (int k = 0; k < 4; ++k) {
            const Index n = complex.neighbour(c, k);
            if (n != none && contains(cavity, n))
                continue;
            const Triple f = complex.facet(c, k);
            // Outward facet seen from inside: (f1, f0, f2, point) is positive.
            const Cell cell{f[1], f[0], f[2], point};
            if (complex.orientation(cell) <= 0)
                return false; // only with walls: the cavity is not star-shaped
            fresh.push_back(cell);
        }
    complex.replace(cavity, fresh);
    hint = complex.fresh_cells().front();
    return true;
}

} // namespace fastsim
