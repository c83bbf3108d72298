#include "recovery/segment_walk.hpp"

#include <algorithm>

namespace fastsim {

namespace {

constexpr std::size_t longest_walk = 200;

class Walk {
  public:
    Walk(const TetComplex &complex, Index a, Index b) : _complex(complex), _a(a), _b(b) {}

    std::vector<Obstacle> run() {
        bool goes_on = start();
        while (goes_on && _met.size() < longest_walk)
            goes_on = _cell == none ? leave_edge() : leave_facet();
        return std::move(_met);
    }

  private:
    const Point &place(Index i) const { return _complex.points[TetComplex::at(i)]; }
    int side(Index a, Index b, Index c, Index d) const {
        return orient3d(place(a), place(b), place(c), place(d));
    }

    /// Takes facet g of a cell, or the edge or corner of it that the line meets.
    bool meet(Index cell, const Triple &g, const std::array<int, 3> &sign) {
        int zeros = 0;
        std::size_t zero = 0, other = 0;
        for (std::size_t k = 0; k < 3; ++k)
            if (sign[k] == 0) {
                ++zeros;
                zero = k;
            } else {
                other = k;
            }
        if (zeros == 0) {
            _cell = cell;
            _facet = g;
            _met.push_back({g[0], g[1], g[2]});
            return true;
        }
        if (zeros > 1) {
            // On two sides: at the corner that they share, off the third side.
            if (zeros == 2 && g[(other + 2) % 3] != _b)
                _met.push_back({g[(other + 2) % 3], none, none});
            return false;
        }
        return meet_edge(g[zero], g[(zero + 1) % 3]);
    }

    bool meet_edge(Index p, Index q) {
        _cell = none;
        _p = p;
        _q = q;
        _met.push_back({p, q, none});
        return true;
    }

    /// Signs of the line against the sides of facet g; whether it passes through, edges counted.
    bool passes(const Triple &g, std::array<int, 3> &sign) const {
        for (std::size_t k = 0; k < 3; ++k)
            sign[k] = side(_a, _b, g[k], g[(k + 1) % 3]);
        return (sign[0] >= 0 && sign[1] >= 0 && sign[2] >= 0) ||
               (sign[0] <= 0 && sign[1] <= 0 && sign[2] <= 0);
    }

    bool start() {
        std::vector<Index> around;
        _complex.cells_around(_a, around);
        for (const Index c : around) {
            const Triple f = _complex.facet(c, _complex.corner_of(c, _a));
            // Outward facet: (a, f0, f1, f2) is positive, and b lies in the cone of a over it.
            const std::array<int, 3> sign{side(_a, f[0], f[1], _b), side(_a, f[1], f[2], _b),
                                          side(_a, f[2], f[0], _b)};
            if (sign[0] >= 0 && sign[1] >= 0 && sign[2] >= 0)
                return meet(c, f, sign);
        }
        return false;
    }

    /// Where the segment goes on after a facet.
    bool leave_facet() {
        const Triple entry = sorted_triple(_facet[0], _facet[1], _facet[2]);
        Index next = none;
        for (int k = 0; k < 4; ++k) {
            const Triple g = _complex.facet(_cell, k);
            if (sorted_triple(g[0], g[1], g[2]) == entry)
                next = _complex.neighbour(_cell, k);
        }
        if (next == none || _complex.corner_of(next, _b) >= 0)
            return false;
        for (int k = 0; k < 4; ++k) {
            const Triple g = _complex.facet(next, k);
            std::array<int, 3> sign{};
            if (sorted_triple(g[0], g[1], g[2]) != entry && passes(g, sign))
                return meet(next, g, sign);
        }
        return false;
    }

    /// Where the segment goes on after an edge: along a facet at it, or through a cell at it.
    bool leave_edge() {
        std::vector<Index> cells, ring;
        bool is_closed = false;
        _complex.edge_ring(_p, _q, cells, ring, is_closed);
        if (!is_closed || std::find(ring.begin(), ring.end(), _b) != ring.end())
            return false;
        const std::size_t n = ring.size();
        for (std::size_t i = 0; i < n; ++i) {
            const Index u = ring[i], v = ring[(i + 1) % n];
            // b in the wedge of planes (p, q, u) and (p, q, v), on the far side from a.
            const int turn = side(_p, _q, u, v);
            const int from_u = turn * side(_p, _q, u, _b);
            const int from_v = -turn * side(_p, _q, v, _b);
            if (from_u == 0 && from_v > 0) {
                // In the plane of facet (p, q, u): out through the side whose ends the line
                // separates, seen from v off that plane.
                const int of_p = side(_a, _b, v, _p), of_u = side(_a, _b, v, u);
                if (of_u == 0) {
                    _met.push_back({u, none, none});
                    return false;
                }
                return meet_edge(u, of_u == of_p ? _q : _p);
            }
            if (from_u > 0 && from_v > 0) {
                for (const Index end : {_p, _q}) {
                    const Triple g = _complex.facet(cells[i], _complex.corner_of(cells[i], end));
                    std::array<int, 3> sign{};
                    if (passes(g, sign))
                        return meet(cells[i], g, sign);
                }
                return false;
            }
        }
        return false;
    }

    const TetComplex &_complex;
    Index _a, _b;
    // Where the walk is: about to leave _cell through _facet, or at edge (_p, _q).
    Index _cell = none, _p = none, _q = none;
    Triple _facet{};
    std::vector<Obstacle> _met;
};

} // namespace

std::vector<Obstacle> find_obstacles(const TetComplex &complex, Index a, Index b) {
    return Walk(complex, a, b).run();
}

} // namespace fastsim
