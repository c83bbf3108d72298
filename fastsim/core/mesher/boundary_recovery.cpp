#include "mesher/boundary_recovery.hpp"

#include <algorithm>
#include <stdexcept>
#include <unordered_map>

namespace fastsim {

namespace {

constexpr std::size_t most_flips_for_an_edge = 400;
constexpr std::size_t most_flips_for_a_facet = 200;
constexpr std::size_t largest_ring = 14;
constexpr std::size_t longest_walk = 200;
// Any positive cell will do while recovering; shape is mended afterwards.
constexpr double any_quality = -0.5;

/// Something in the way of an edge: a facet (c >= 0) or an edge (a, b).
struct Obstacle {
    Index a, b, c;
};

class Recovery {
  public:
    Recovery(TetComplex &complex, Protection &protection)
        : _complex(complex), _protection(protection) {}

    bool recover_edge(Index a, Index b) {
        for (std::size_t attempt = 0; attempt < most_flips_for_an_edge; ++attempt) {
            if (_complex.has_edge(a, b))
                return true;
            std::vector<Obstacle> obstacles;
            find_obstacles(a, b, obstacles);
            find_obstacles(b, a, obstacles);
            // Start elsewhere each time: the same first flip may be undone by the next.
            _turn = _turn * 1664525u + 1013904223u;
            const std::size_t first = obstacles.empty() ? 0 : (_turn >> 8) % obstacles.size();
            bool has_flipped = false;
            for (std::size_t i = 0; i < obstacles.size() && !has_flipped; ++i)
                has_flipped = flip_away(obstacles[(first + i) % obstacles.size()], a, b);
            if (!has_flipped)
                return false;
        }
        return _complex.has_edge(a, b);
    }

    bool recover_facet(const Triple &f) {
        for (std::size_t attempt = 0; attempt < most_flips_for_a_facet; ++attempt) {
            if (_complex.find_facet(f[0], f[1], f[2]).cell != none)
                return true;
            bool has_flipped = false;
            for (std::size_t k = 0; k < 3 && !has_flipped; ++k)
                has_flipped = remove_piercing_edge(f[k], f[(k + 1) % 3], f[(k + 2) % 3]);
            if (!has_flipped)
                return false;
        }
        return false;
    }

  private:
    const Point &place(Index i) const { return _complex.points[TetComplex::at(i)]; }
    int side(Index a, Index b, Index c, Index d) const {
        return orient3d(place(a), place(b), place(c), place(d));
    }

    /// What the segment from a to b crosses next: a facet of a cell that it leaves, or an edge.
    struct Crossing {
        Index cell = none; // the cell left through the facet; none for an edge
        Triple facet{};
        Index p = none, q = none; // the edge
    };

    /// Whether the line a-b passes through facet g; edges it touches count.
    bool passes(Index a, Index b, const Triple &g, int (&sign)[3]) const {
        for (std::size_t k = 0; k < 3; ++k)
            sign[k] = side(a, b, g[k], g[(k + 1) % 3]);
        return (sign[0] >= 0 && sign[1] >= 0 && sign[2] >= 0) ||
               (sign[0] <= 0 && sign[1] <= 0 && sign[2] <= 0);
    }

    /// Turns a facet the line passes through into a crossing; false when it meets a corner.
    static bool make_crossing(Index cell, const Triple &g, const int (&sign)[3], Crossing &out) {
        int zeros = 0;
        std::size_t zero = 0;
        for (std::size_t k = 0; k < 3; ++k)
            if (sign[k] == 0) {
                ++zeros;
                zero = k;
            }
        if (zeros > 1)
            return false;
        out = zeros == 0 ? Crossing{cell, g, none, none}
                         : Crossing{none, {}, g[zero], g[(zero + 1) % 3]};
        return true;
    }

    bool first_crossing(Index a, Index b, Crossing &out) const {
        std::vector<Index> around;
        _complex.cells_around(a, around);
        for (const Index c : around) {
            const Triple f = _complex.facet(c, _complex.corner_of(c, a));
            // Outward facet: (a, f0, f1, f2) is positive, and b lies in the cone of a over it.
            const int sign[3]{side(a, f[0], f[1], b), side(a, f[1], f[2], b),
                              side(a, f[2], f[0], b)};
            if (sign[0] >= 0 && sign[1] >= 0 && sign[2] >= 0)
                return make_crossing(c, f, sign, out);
        }
        return false;
    }

    /// Where the segment goes on after a facet.
    bool after_facet(Index a, Index b, const Crossing &last, Crossing &out) const {
        const Triple entry = sorted_triple(last.facet[0], last.facet[1], last.facet[2]);
        Index next = none;
        for (int k = 0; k < 4; ++k) {
            const Triple g = _complex.facet(last.cell, k);
            if (sorted_triple(g[0], g[1], g[2]) == entry)
                next = _complex.neighbour(last.cell, k);
        }
        if (next == none || _complex.corner_of(next, b) >= 0)
            return false;
        for (int k = 0; k < 4; ++k) {
            const Triple g = _complex.facet(next, k);
            int sign[3];
            if (sorted_triple(g[0], g[1], g[2]) != entry && passes(a, b, g, sign))
                return make_crossing(next, g, sign, out);
        }
        return false;
    }

    /// Where the segment goes on after an edge: along a facet at it, or through a cell at it.
    bool after_edge(Index a, Index b, const Crossing &last, Crossing &out) const {
        std::vector<Index> cells, ring;
        bool is_closed = false;
        _complex.edge_ring(last.p, last.q, cells, ring, is_closed);
        if (!is_closed || std::find(ring.begin(), ring.end(), b) != ring.end())
            return false;
        const std::size_t n = ring.size();
        for (std::size_t i = 0; i < n; ++i) {
            const Index u = ring[i], v = ring[(i + 1) % n];
            // b in the wedge of planes (p, q, u) and (p, q, v), on the far side from a.
            const int turn = side(last.p, last.q, u, v);
            const int from_u = turn * side(last.p, last.q, u, b);
            const int from_v = -turn * side(last.p, last.q, v, b);
            if (from_u == 0 && from_v > 0) {
                // In the plane of facet (p, q, u): out through the side whose ends the line
                // separates, seen from v off that plane.
                const int of_p = side(a, b, v, last.p), of_u = side(a, b, v, u);
                if (of_u == 0)
                    return false;
                out = Crossing{none, {}, u, of_u == of_p ? last.q : last.p};
                return true;
            }
            if (from_u > 0 && from_v > 0) {
                for (const Index end : {last.p, last.q}) {
                    const Triple g = _complex.facet(cells[i], _complex.corner_of(cells[i], end));
                    int sign[3];
                    if (passes(a, b, g, sign))
                        return make_crossing(cells[i], g, sign, out);
                }
                return false;
            }
        }
        return false;
    }

    /// Walks from a towards b and lists what is crossed.
    void find_obstacles(Index a, Index b, std::vector<Obstacle> &out) const {
        Crossing here;
        bool goes_on = first_crossing(a, b, here);
        for (std::size_t step = 0; goes_on && step < longest_walk; ++step) {
            Crossing next;
            if (here.cell == none) {
                out.push_back({here.p, here.q, none});
                goes_on = after_edge(a, b, here, next);
            } else {
                out.push_back({here.facet[0], here.facet[1], here.facet[2]});
                goes_on = after_facet(a, b, here, next);
            }
            here = next;
        }
    }

    bool flip_away(const Obstacle &o, Index a, Index b) {
        if (o.c == none)
            return remove(o.a, o.b, a, b) || loosen(o.a, o.b);
        const Side s = _complex.find_facet(o.a, o.b, o.c);
        if (s.cell != none && flip_facet(_complex, s, _protection, any_quality))
            return true;
        return remove(o.a, o.b, a, b) || remove(o.b, o.c, a, b) || remove(o.c, o.a, a, b) ||
               loosen(o.a, o.b) || loosen(o.b, o.c) || loosen(o.c, o.a);
    }

    /// Changes the ring of an edge that cannot be removed as it stands: flips one of its facets,
    /// or removes another edge of its cells. Starts elsewhere each time.
    bool loosen(Index p, Index q) {
        std::vector<Index> cells, ring;
        bool is_closed = false;
        _complex.edge_ring(p, q, cells, ring, is_closed);
        const std::size_t n = ring.size();
        if (!is_closed)
            return false;
        const auto try_edge = [&](Index u, Index v) {
            return remove_edge(_complex, u, v, _protection, largest_ring, any_quality, none, none);
        };
        _turn = _turn * 1664525u + 1013904223u;
        const std::size_t first = (_turn >> 8) % n;
        for (std::size_t i = 0; i < n; ++i) {
            const Index r = ring[(first + i) % n], next = ring[(first + i + 1) % n];
            const Side s = _complex.find_facet(p, q, r);
            if (s.cell != none && flip_facet(_complex, s, _protection, any_quality))
                return true;
            if (try_edge(p, r) || try_edge(q, r) || try_edge(r, next))
                return true;
        }
        return false;
    }

    /// Removes an edge, with (a, b) among the new ones where they are both on its ring.
    bool remove(Index p, Index q, Index a, Index b) {
        return remove_edge(_complex, p, q, _protection, largest_ring, any_quality, a, b) ||
               remove_edge(_complex, p, q, _protection, largest_ring, any_quality, none, none);
    }

    /// Among the cells around edge (a, b), the one towards c holds an edge that pierces the facet.
    bool remove_piercing_edge(Index a, Index b, Index c) {
        std::vector<Index> cells, ring;
        bool is_closed = false;
        _complex.edge_ring(a, b, cells, ring, is_closed);
        for (std::size_t i = 0; i < cells.size(); ++i) {
            const Index u = ring[i], v = ring[(i + 1) % ring.size()];
            const int su = side(a, b, c, u), sv = side(a, b, c, v);
            if (su * sv >= 0)
                continue;
            const int s0 = side(u, v, a, b), s1 = side(u, v, b, c), s2 = side(u, v, c, a);
            const bool pierces = (s0 > 0 && s1 > 0 && s2 > 0) || (s0 < 0 && s1 < 0 && s2 < 0);
            if (pierces &&
                (remove_edge(_complex, u, v, _protection, largest_ring, any_quality, none, none) ||
                 loosen(u, v)))
                return true;
        }
        return false;
    }

    TetComplex &_complex;
    Protection &_protection;
    std::uint32_t _turn = 1;
};

} // namespace

RecoveryReport recover_boundary(TetComplex &complex, std::span<const Triple> facets,
                                Protection &protection) {
    RecoveryReport report;
    std::vector<std::array<Index, 2>> edges;
    std::unordered_set<std::uint64_t> seen;
    for (const Triple &f : facets)
        for (std::size_t k = 0; k < 3; ++k)
            if (seen.insert(edge_key(f[k], f[(k + 1) % 3])).second)
                edges.push_back({f[k], f[(k + 1) % 3]});
    std::vector<std::array<Index, 2>> missing;
    for (const auto &e : edges)
        if (complex.has_edge(e[0], e[1]))
            protection.edges.insert(edge_key(e[0], e[1]));
        else
            missing.push_back(e);
    Recovery recovery(complex, protection);
    const std::size_t missing_at_first = missing.size();
    // An edge that is stuck may come free once others are there.
    for (int pass = 0; pass < 4 && !missing.empty(); ++pass) {
        std::vector<std::array<Index, 2>> stuck;
        for (const auto &e : missing)
            if (recovery.recover_edge(e[0], e[1]))
                protection.edges.insert(edge_key(e[0], e[1]));
            else
                stuck.push_back(e);
        missing.swap(stuck);
    }
    report.recovered_edges = missing_at_first - missing.size();
    report.missing_edges = missing;

    std::vector<Index> lost;
    for (std::size_t i = 0; i < facets.size(); ++i) {
        const Triple &f = facets[i];
        if (complex.find_facet(f[0], f[1], f[2]).cell != none)
            protection.facets.insert(sorted_triple(f[0], f[1], f[2]));
        else
            lost.push_back(static_cast<Index>(i));
    }
    const std::size_t lost_at_first = lost.size();
    for (int pass = 0; pass < 4 && !lost.empty(); ++pass) {
        std::vector<Index> stuck;
        for (const Index i : lost) {
            const Triple &f = facets[TetComplex::at(i)];
            if (recovery.recover_facet(f))
                protection.facets.insert(sorted_triple(f[0], f[1], f[2]));
            else
                stuck.push_back(i);
        }
        lost.swap(stuck);
    }
    report.recovered_facets = lost_at_first - lost.size();
    report.missing_facets = lost;
    return report;
}

std::vector<Cell> carve(const TetComplex &complex, std::span<const Triple> facets) {
    std::unordered_map<Triple, Triple, TripleHash> given;
    for (const Triple &f : facets)
        given.emplace(sorted_triple(f[0], f[1], f[2]), f);
    const auto is_same_way = [](const Triple &f, const Triple &g) {
        return (f[0] == g[0] && f[1] == g[1]) || (f[0] == g[1] && f[1] == g[2]) ||
               (f[0] == g[2] && f[1] == g[0]);
    };
    std::vector<char> seen(complex.num_slots(), 0);
    std::vector<Cell> kept;
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot) {
        if (seen[slot] || !complex.is_alive(static_cast<Index>(slot)))
            continue;
        // One region: cells reachable without crossing a facet of the surface.
        std::vector<Index> region{static_cast<Index>(slot)};
        seen[slot] = 1;
        bool is_inside = false, is_outside = false;
        for (std::size_t i = 0; i < region.size(); ++i)
            for (int k = 0; k < 4; ++k) {
                const Index c = region[i], n = complex.neighbour(c, k);
                const Triple f = complex.facet(c, k);
                const auto wall = given.find(sorted_triple(f[0], f[1], f[2]));
                if (wall != given.end()) {
                    // The surface faces outwards, and so does the facet seen from its own cell.
                    (is_same_way(f, wall->second) ? is_inside : is_outside) = true;
                    continue;
                }
                if (n == none)
                    is_outside = true;
                else if (!seen[TetComplex::at(n)]) {
                    seen[TetComplex::at(n)] = 1;
                    region.push_back(n);
                }
            }
        if (is_inside && is_outside)
            throw std::runtime_error("a region lies on both sides of the surface");
        if (is_inside)
            for (const Index c : region)
                kept.push_back(complex.cell(c));
    }
    return kept;
}

} // namespace fastsim
