#include "recovery/steiner_recovery.hpp"

#include "recovery/segment_geometry.hpp"
#include "recovery/steiner_insertion.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

constexpr std::size_t most_flips = 30;
constexpr double flat = 1e-9;

} // namespace

SteinerRecovery::SteinerRecovery(TetComplex &complex, Protection &protection, Index first_inner,
                                 std::size_t most_points, Watch &watch)
    : _complex(complex), _protection(protection), _watch(watch), _flips(complex, protection),
      _first_inner(first_inner), _most_points(most_points) {}

bool SteinerRecovery::recover_edge(Index a, Index b) {
    std::vector<Index> &inner = _chains[edge_key(a, b)];
    inner.clear();
    const std::size_t points_before = _points.size();
    // From the lower end: parts still to do are a stack, the part at hand starts at `from`.
    Index from = std::min(a, b);
    std::vector<Index> ahead{std::max(a, b)};
    while (!ahead.empty()) {
        _watch.look();
        const Index to = ahead.back();
        if (_flips.recover_edge(from, to, most_flips)) {
            _protection.edges.insert(edge_key(from, to));
            ahead.pop_back();
            if (!ahead.empty())
                inner.push_back(to);
            from = to;
            continue;
        }
        const Index s = cut_edge(from, to);
        if (s == none) {
            // The points become inner ones, and what is between them may be flipped again.
            Index last = std::min(a, b);
            for (const Index p : inner) {
                _protection.edges.erase(edge_key(last, p));
                last = p;
            }
            _protection.edges.erase(edge_key(last, from));
            inner.clear();
            _points.resize(points_before);
            return false;
        }
        ahead.push_back(s);
    }
    return true;
}

std::vector<Index> SteinerRecovery::chain(Index a, Index b) const {
    std::vector<Index> points{a};
    const auto found = _chains.find(edge_key(a, b));
    if (found != _chains.end()) {
        points.insert(points.end(), found->second.begin(), found->second.end());
        if (a > b)
            std::reverse(points.begin() + 1, points.end());
    }
    points.push_back(b);
    return points;
}

Index SteinerRecovery::insert(std::vector<Candidate> &candidates) {
    if (_num_inserted >= _most_points)
        return none;
    std::sort(candidates.begin(), candidates.end(),
              [](const Candidate &x, const Candidate &y) { return x.from_middle < y.from_middle; });
    const auto s = static_cast<Index>(_complex.points.size());
    _complex.add_point({});
    // Cells that are flat but for roundings would lead astray what comes after: rather others.
    for (const double least_quality : {flat, 0.0})
        for (const Candidate &candidate : candidates) {
            _complex.points.back() = candidate.place;
            if (insert_star(_complex, _protection, candidate.cells, s, least_quality)) {
                _points.push_back(s);
                ++_num_inserted;
                return s;
            }
        }
    return none; // the point stays, in no cell
}

/// Puts a point on edge (a, b) where something crosses it, or takes one that lies there.
Index SteinerRecovery::cut_edge(Index a, Index b) {
    Index point_on_it = none;
    std::vector<Candidate> candidates = crossings(a, b, point_on_it);
    if (point_on_it >= _first_inner &&
        std::find(_points.begin(), _points.end(), point_on_it) == _points.end()) {
        _points.push_back(point_on_it);
        return point_on_it;
    }
    return insert(candidates);
}

std::vector<SteinerRecovery::Candidate> SteinerRecovery::crossings(Index a, Index b,
                                                                   Index &point_on_it) const {
    std::vector<Candidate> found;
    for (const auto &[from, to] : {Edge{a, b}, Edge{b, a}})
        for (const Obstacle &o : find_obstacles(_complex, from, to)) {
            if (o.b == none) {
                point_on_it = o.a;
                continue;
            }
            Candidate candidate;
            double t = 0.0;
            if (o.c == none) {
                std::vector<Index> ring;
                bool is_closed = false;
                _complex.edge_ring(o.a, o.b, candidate.cells, ring, is_closed);
                t = at_line(place(a), place(b), place(o.a), place(o.b));
            } else {
                const Side side = _complex.find_facet(o.a, o.b, o.c);
                if (side.cell == none)
                    continue;
                candidate.cells = {side.cell, _complex.neighbour(side.cell, side.facet)};
                t = at_plane(place(a), place(b), place(o.a), place(o.b), place(o.c));
            }
            if (!(t > 0.0 && t < 1.0))
                continue;
            candidate.place = between(place(a), place(b), t);
            candidate.from_middle = std::abs(t - 0.5);
            found.push_back(std::move(candidate));
        }
    return found;
}

bool SteinerRecovery::is_cut(const Triple &f) const {
    for (std::size_t k = 0; k < 3; ++k)
        if (chain(f[k], f[(k + 1) % 3]).size() > 2)
            return true;
    return false;
}

std::vector<Triple> SteinerRecovery::parts(const Triple &f) const {
    const auto found = _parts.find(sorted_triple(f[0], f[1], f[2]));
    return found == _parts.end() ? std::vector<Triple>{f} : found->second;
}

} // namespace fastsim
