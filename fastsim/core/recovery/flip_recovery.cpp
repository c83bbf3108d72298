#include "recovery/flip_recovery.hpp"

#include <algorithm>

namespace fastsim {

namespace {

constexpr std::size_t largest_ring = 14;
// Any positive cell will do while recovering; shape is mended afterwards.
constexpr double any_quality = 1e-9;

} // namespace

int FlipRecovery::side(Index a, Index b, Index c, Index d) const {
    const auto place = [&](Index i) -> const Point & { return _complex.points[TetComplex::at(i)]; };
    return orient3d(place(a), place(b), place(c), place(d));
}

bool FlipRecovery::recover_edge(Index a, Index b, std::size_t most_flips) {
    for (std::size_t attempt = 0; attempt < most_flips; ++attempt) {
        if (_complex.has_edge(a, b))
            return true;
        std::vector<Obstacle> obstacles = find_obstacles(_complex, a, b);
        const std::vector<Obstacle> back = find_obstacles(_complex, b, a);
        obstacles.insert(obstacles.end(), back.begin(), back.end());
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

bool FlipRecovery::recover_facet(const Triple &f, std::size_t most_flips) {
    for (std::size_t attempt = 0; attempt < most_flips; ++attempt) {
        if (_complex.find_facet(f[0], f[1], f[2]).cell != none)
            return true;
        bool has_flipped = false;
        for (std::size_t k = 0; k < 3 && !has_flipped; ++k) {
            std::vector<std::array<Index, 2>> piercing;
            add_piercing(f[k], f[(k + 1) % 3], f[(k + 2) % 3], piercing);
            for (std::size_t i = 0; i < piercing.size() && !has_flipped; ++i) {
                const auto [u, v] = piercing[i];
                has_flipped = remove_piercing(u, v);
            }
        }
        if (!has_flipped)
            return false;
    }
    return false;
}

/// Among the cells around edge (a, b), the one towards c holds an edge that pierces the facet.
void FlipRecovery::add_piercing(Index a, Index b, Index c,
                                std::vector<std::array<Index, 2>> &out) const {
    std::vector<Index> cells, ring;
    bool is_closed = false;
    _complex.edge_ring(a, b, cells, ring, is_closed);
    for (std::size_t i = 0; i < cells.size(); ++i) {
        const Index u = ring[i], v = ring[(i + 1) % ring.size()];
        const int su = side(a, b, c, u), sv = side(a, b, c, v);
        if (su * sv >= 0)
            continue;
        const int s0 = side(u, v, a, b), s1 = side(u, v, b, c), s2 = side(u, v, c, a);
        if ((s0 > 0 && s1 > 0 && s2 > 0) || (s0 < 0 && s1 < 0 && s2 < 0))
            out.push_back({u, v});
    }
}

bool FlipRecovery::flip_away(const Obstacle &o, Index a, Index b) {
    if (o.b == none)
        return false;
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
bool FlipRecovery::loosen(Index p, Index q) {
    std::vector<Index> cells, ring;
    bool is_closed = false;
    _complex.edge_ring(p, q, cells, ring, is_closed);
    const std::size_t n = ring.size();
    if (!is_closed)
        return false;
    _turn = _turn * 1664525u + 1013904223u;
    const std::size_t first = (_turn >> 8) % n;
    const auto remove_any = [&](Index u, Index v) {
        return remove_edge(_complex, u, v, _protection, largest_ring, any_quality, none, none);
    };
    for (std::size_t i = 0; i < n; ++i) {
        const Index r = ring[(first + i) % n], next = ring[(first + i + 1) % n];
        const Side s = _complex.find_facet(p, q, r);
        if (s.cell != none && flip_facet(_complex, s, _protection, any_quality))
            return true;
        if (remove_any(p, r) || remove_any(q, r) || remove_any(r, next))
            return true;
    }
    return false;
}

/// Removes an edge, with (a, b) among the new ones where they are both on its ring.
bool FlipRecovery::remove(Index p, Index q, Index a, Index b) {
    return (a != none &&
            remove_edge(_complex, p, q, _protection, largest_ring, any_quality, a, b)) ||
           remove_edge(_complex, p, q, _protection, largest_ring, any_quality, none, none);
}

} // namespace fastsim
