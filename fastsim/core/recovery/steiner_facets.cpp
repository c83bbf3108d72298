// The facets of SteinerRecovery: a facet is followed through the complex from its rim inwards.
#include "recovery/polygon_triangulation.hpp"
#include "recovery/segment_geometry.hpp"
#include "recovery/steiner_recovery.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

constexpr std::size_t most_flips = 30;
constexpr int most_looks = 40;
// Of those, the last are without flips, which might go round in circles.
constexpr int most_looks_with_flips = 30;
// Points of one edge are in line up to rounding.
constexpr double least_sine = 1e-9;

std::uint64_t directed(Index a, Index b) {
    return (static_cast<std::uint64_t>(a) << 32) | static_cast<std::uint64_t>(b);
}

} // namespace

bool SteinerRecovery::recover_facet(const Triple &f) {
    Front front;
    front.facet = f;
    std::vector<Edge> &open = front.open;
    for (std::size_t k = 0; k < 3; ++k) {
        const std::vector<Index> side = chain(f[k], f[(k + 1) % 3]);
        for (std::size_t i = 0; i + 1 < side.size(); ++i) {
            open.push_back({side[i], side[i + 1]});
            front.on.insert(side[i]);
            front.passed.insert(directed(side[i + 1], side[i]));
        }
    }
    while (!open.empty()) {
        const auto [a, b] = open.back();
        open.pop_back();
        if (front.passed.contains(directed(a, b)))
            continue;
        const Index w = next_point(front, a, b);
        if (w == none)
            return false;
        const Triple part{a, b, w};
        front.parts.push_back(part);
        _protection.facets.insert(sorted_triple(a, b, w));
        for (std::size_t k = 0; k < 3; ++k) {
            const Index p = part[k], q = part[(k + 1) % 3];
            front.passed.insert(directed(p, q));
            _protection.edges.insert(edge_key(p, q));
            if (k > 0 && !front.passed.contains(directed(q, p)))
                open.push_back({q, p});
        }
    }
    _parts[sorted_triple(f[0], f[1], f[2])] = std::move(front.parts);
    return true;
}

/// Points around edge (a, b), in the sense of a right-handed screw.
bool SteinerRecovery::ring_of(Index a, Index b, std::vector<Index> &ring) const {
    std::vector<Index> cells;
    bool is_closed = false;
    _complex.edge_ring(a, b, cells, ring, is_closed);
    if (!is_closed)
        return false;
    if (_complex.orientation({a, b, ring[0], ring[1]}) < 0)
        std::reverse(ring.begin(), ring.end());
    return true;
}

/// The corner of the facet's part on the left of (a, b), seen from above the facet.
Index SteinerRecovery::next_point(Front &front, Index a, Index b) {
    const Triple &f = front.facet;
    for (int look = 0; look < most_looks; ++look) {
        _watch.look();
        std::vector<Index> ring;
        if (!ring_of(a, b, ring))
            return none;
        const Index w = point_in_ring(front, a, b, ring);
        if (w != none)
            return w;
        // In the ring's sense the facet's side comes after the points below it and before those
        // above: there an edge pierces the facet.
        const auto height = [&](Index v) {
            return front.on.contains(v) ? 0
                                        : orient3d(place(f[0]), place(f[1]), place(f[2]), place(v));
        };
        Index u = none, v = none;
        for (std::size_t i = 0; i < ring.size(); ++i)
            if (height(ring[i]) < 0 && height(ring[(i + 1) % ring.size()]) > 0) {
                u = ring[i];
                v = ring[(i + 1) % ring.size()];
            }
        if (u == none) {
            // Flat cells hide the facet's side: go for a corner of the front instead.
            const Index corner = corner_of_front(front, a, b);
            if (corner == none)
                return none;
            return _flips.recover_edge(b, corner, most_flips) &&
                           _flips.recover_edge(corner, a, most_flips) &&
                           _flips.recover_facet({a, b, corner}, most_flips)
                       ? corner
                       : none;
        }
        if (look < most_looks_with_flips && _flips.remove_piercing(u, v))
            continue;
        const Index s = cut_piercing(front, u, v);
        if (s == none)
            return none;
        front.on.insert(s);
    }
    return none;
}

/// Among the points around (a, b) one on the facet, ahead of the front.
Index SteinerRecovery::point_in_ring(Front &front, Index a, Index b,
                                     const std::vector<Index> &ring) {
    const Triple &f = front.facet;
    const Point normal = normal_of(f);
    Index best = none;
    // Three points of one edge do for a last resort: roundings tell them apart.
    double best_sine = -least_sine;
    for (const Index w : ring) {
        if (front.passed.contains(directed(b, w)) || front.passed.contains(directed(w, a)))
            continue;
        const bool is_on = front.on.contains(w);
        if (!is_on && (w < _first_inner || !lies_on(f, w)))
            continue;
        const Point ab = minus(place(b), place(a)), aw = minus(place(w), place(a));
        const double sine =
            dot(cross(ab, aw), normal) / std::sqrt(dot(ab, ab) * dot(aw, aw) * dot(normal, normal));
        if (sine > best_sine) {
            best_sine = sine;
            best = w;
        }
    }
    // A point that happens to lie in the facet is taken for one of those put on it.
    if (best != none && front.on.insert(best).second)
        _points.push_back(best);
    return best;
}

Point SteinerRecovery::normal_of(const Triple &f) const {
    return cross(minus(place(f[1]), place(f[0])), minus(place(f[2]), place(f[0])));
}

/// Whether a point lies in the plane of a facet, inside it.
bool SteinerRecovery::lies_on(const Triple &f, Index w) const {
    if (orient3d(place(f[0]), place(f[1]), place(f[2]), place(w)) != 0)
        return false;
    const Point normal = normal_of(f);
    for (std::size_t k = 0; k < 3; ++k) {
        const Point &p = place(f[k]);
        if (!(dot(cross(minus(place(f[(k + 1) % 3]), p), minus(place(w), p)), normal) > 0.0))
            return false;
    }
    return true;
}

/// The third corner at edge (a, b) when what is left of the facet is cut into triangles.
Index SteinerRecovery::corner_of_front(const Front &front, Index a, Index b) const {
    std::vector<Index> loop{a};
    for (Index here = b; here != a && loop.size() <= front.open.size() + 1;) {
        loop.push_back(here);
        const auto next = std::find_if(front.open.begin(), front.open.end(), [&](const Edge &e) {
            return e[0] == here && !front.passed.contains(directed(e[0], e[1]));
        });
        if (next == front.open.end())
            return none;
        here = (*next)[1];
    }
    for (const Triple &t : triangulate_polygon(_complex.points, loop, normal_of(front.facet)))
        for (std::size_t k = 0; k < 3; ++k)
            if (t[k] == a && t[(k + 1) % 3] == b)
                return t[(k + 2) % 3];
    return none;
}

/// Cuts edge (u, v) where it pierces the facet.
Index SteinerRecovery::cut_piercing(const Front &front, Index u, Index v) {
    const Triple &f = front.facet;
    std::vector<Candidate> candidates(1);
    std::vector<Index> ring;
    bool is_closed = false;
    _complex.edge_ring(u, v, candidates[0].cells, ring, is_closed);
    const double t = at_plane(place(u), place(v), place(f[0]), place(f[1]), place(f[2]));
    if (!is_closed || !(t > 0.0 && t < 1.0))
        return none;
    candidates[0].place = between(place(u), place(v), t);
    return insert(candidates);
}

} // namespace fastsim
