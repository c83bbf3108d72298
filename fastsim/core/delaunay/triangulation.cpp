#include "delaunay/triangulation.hpp"

#include "delaunay/hilbert_order.hpp"

#include <algorithm>
#include <utility>

namespace fastsim {
namespace {

// Facet k lies opposite vertex k; counter-clockwise seen from outside a positive cell.
constexpr std::array<std::array<std::size_t, 3>, 4> facet_of{
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

} // namespace

Triangulation::Index Triangulation::new_cell() {
    if (!_free_cells.empty()) {
        const Index c = _free_cells.back();
        _free_cells.pop_back();
        return c;
    }
    _cells.emplace_back();
    _mark.push_back(0);
    return static_cast<Index>(_cells.size() - 1);
}

bool Triangulation::start(const std::vector<Index> &order, std::array<Index, 4> &first) {
    // Four points that span space, the first of the order that do.
    const auto off_line = [&](Index p) {
        // Collinear exactly when flat with every direction off the line: three unit steps do.
        for (std::size_t axis = 0; axis < 3; ++axis) {
            Point off = at(first[0]);
            off[axis] = off[axis] == 0.0 ? 1.0 : 2.0 * off[axis];
            if (orient3d(at(first[0]), at(first[1]), at(p), off) != 0) {
                return true;
            }
        }
        return false;
    };
    std::size_t found = 0;
    for (const Index p : order) {
        const bool fits = found == 0   ? true
                          : found == 1 ? at(p) != at(first[0])
                          : found == 2
                              ? off_line(p)
                              : orient3d(at(first[0]), at(first[1]), at(first[2]), at(p)) != 0;
        if (fits) {
            first[found++] = p;
        }
        if (found == 4) {
            break;
        }
    }
    if (found < 4) {
        return false;
    }
    if (orient3d(at(first[0]), at(first[1]), at(first[2]), at(first[3])) < 0) {
        std::swap(first[0], first[1]);
    }
    const Index inner = new_cell();
    cell(inner).vertex = first;
    _openings.clear();
    ++_stamp;
    std::array<Index, 4> ghosts{};
    for (std::size_t k = 0; k < 4; ++k) {
        const auto &f = facet_of[k];
        const Index ghost = new_cell();
        ghosts[k] = ghost;
        // Seen from infinity the facet turns the other way.
        cell(ghost).vertex = {infinite, first[f[0]], first[f[2]], first[f[1]]};
        cell(ghost).neighbour[0] = 4 * inner + static_cast<Index>(k);
        cell(inner).neighbour[k] = 4 * ghost;
        for (Index m = 1; m < 4; ++m) {
            const auto &g = facet_of[static_cast<std::size_t>(m)];
            std::array<Index, 2> edge{};
            std::size_t count = 0;
            for (const std::size_t corner : g) {
                if (cell(ghost).vertex[corner] != infinite) {
                    edge[count++] = cell(ghost).vertex[corner];
                }
            }
            join(edge[0], edge[1], 4 * ghost + m);
        }
    }
    _hint = inner;
    return true;
}

// Links the two new cells that meet at edge (a, b); the first to come waits in a hash table.
void Triangulation::join(Index a, Index b, Index side) {
    if (a > b) {
        std::swap(a, b);
    }
    // Infinity is -1: shifted by one, both fit 32 bits.
    const std::uint64_t key =
        (static_cast<std::uint64_t>(static_cast<std::uint32_t>(a + 1)) << 32) |
        static_cast<std::uint32_t>(b + 1);
    std::size_t slot =
        static_cast<std::size_t>((key * 0x9E3779B97F4A7C15ull) >> 40) & (_edges.size() - 1);
    while (_edges[slot].stamp == _stamp) {
        if (_edges[slot].key == key) {
            const Index other = _edges[slot].side;
            cell(side >> 2).neighbour[static_cast<std::size_t>(side & 3)] = other;
            cell(other >> 2).neighbour[static_cast<std::size_t>(other & 3)] = side;
            return;
        }
        slot = (slot + 1) & (_edges.size() - 1);
    }
    _edges[slot] = {key, _stamp, side};
}

int Triangulation::side_of_sphere(const std::array<Index, 4> &v, Index point) const {
    const int sign = in_sphere(at(v[0]), at(v[1]), at(v[2]), at(v[3]), at(point));
    if (sign != 0) {
        return sign;
    }
    // On the sphere: the lift of the highest number decides. Raising the new point takes it out;
    // raising corner k takes it in where its barycentric weight k is positive.
    std::array<Index, 5> by_weight{v[0], v[1], v[2], v[3], point};
    std::sort(by_weight.begin(), by_weight.end(), std::greater<>());
    for (const Index heaviest : by_weight) {
        if (heaviest == point) {
            return -1;
        }
        std::array<Index, 4> w = v;
        for (Index &corner : w) {
            if (corner == heaviest) {
                corner = point;
            }
        }
        const int weight = orient3d(at(w[0]), at(w[1]), at(w[2]), at(w[3]));
        if (weight != 0) {
            return weight;
        }
    }
    return -1;
}

bool Triangulation::is_in_conflict(Index c, Index point) {
    const Cell &here = cell(c);
    std::size_t at_infinity = 4;
    for (std::size_t k = 0; k < 4; ++k) {
        if (here.vertex[k] == infinite) {
            at_infinity = k;
        }
    }
    if (at_infinity == 4) {
        return side_of_sphere(here.vertex, point) > 0;
    }
    std::array<Index, 4> v = here.vertex;
    v[at_infinity] = point;
    const int sign = orient3d(at(v[0]), at(v[1]), at(v[2]), at(v[3]));
    if (sign != 0) {
        return sign > 0;
    }
    return side_of_sphere(cell(here.neighbour[at_infinity] >> 2).vertex, point) > 0;
}

Triangulation::Index Triangulation::locate(const Point &point) {
    Index here = _hint;
    for (std::size_t k = 0; k < 4; ++k) {
        if (cell(here).vertex[k] == infinite) {
            here = cell(here).neighbour[k] >> 2;
            break;
        }
    }
    // A visibility walk in a regular triangulation never comes back to a cell.
    Index from = -1;
    for (;;) {
        const Cell &now = cell(here);
        Index next = -1;
        for (std::size_t k = 0; k < 4; ++k) {
            const Index beyond = now.neighbour[k];
            if ((beyond >> 2) == from) {
                continue;
            }
            const auto &f = facet_of[k];
            if (orient3d(at(now.vertex[f[0]]), at(now.vertex[f[1]]), at(now.vertex[f[2]]), point) >
                0) {
                next = beyond >> 2;
                break;
            }
        }
        if (next < 0) {
            return here;
        }
        from = here;
        here = next;
        const auto &v = cell(here).vertex;
        if (v[0] == infinite || v[1] == infinite || v[2] == infinite || v[3] == infinite) {
            return here;
        }
    }
}

// Finds all cells in conflict with a point, and the facets around them.
void Triangulation::dig(Index first, Index point) {
    ++_stamp;
    _cavity.clear();
    _openings.clear();
    _cavity.push_back(first);
    const std::uint32_t safe = 2 * _stamp;
    const std::uint32_t conflict = 2 * _stamp + 1;
    _mark[static_cast<std::size_t>(first)] = conflict;
    for (std::size_t i = 0; i < _cavity.size(); ++i) {
        const Index c = _cavity[i];
        for (std::size_t k = 0; k < 4; ++k) {
            const Index beyond = cell(c).neighbour[k];
            const Index n = beyond >> 2;
            std::uint32_t &mark = _mark[static_cast<std::size_t>(n)];
            if (mark < safe) {
                mark = is_in_conflict(n, point) ? conflict : safe;
                if (mark == conflict) {
                    _cavity.push_back(n);
                }
            }
            if (mark == safe) {
                const auto &f = facet_of[k];
                const auto &v = cell(c).vertex;
                _openings.push_back({beyond, {v[f[0]], v[f[1]], v[f[2]]}});
            }
        }
    }
}

// Replaces the cavity by the cells from the point to every facet around it.
void Triangulation::fill(Index point) {
    std::size_t wanted = 64;
    while (wanted < 4 * _openings.size()) {
        wanted *= 2;
    }
    if (_edges.size() < wanted) {
        _edges.assign(wanted, EdgeSlot{0, 0, 0});
    }
    _free_cells.insert(_free_cells.end(), _cavity.rbegin(), _cavity.rend());
    for (const Opening &opening : _openings) {
        const Index fresh = new_cell();
        const auto &[p, q, r] = opening.facet;
        // (point, outward facet) is positive.
        cell(fresh).vertex = {point, p, q, r};
        cell(fresh).neighbour[0] = opening.outside;
        cell(opening.outside >> 2).neighbour[static_cast<std::size_t>(opening.outside & 3)] =
            4 * fresh;
        _mark[static_cast<std::size_t>(fresh)] = 2 * _stamp;
        join(q, r, 4 * fresh + 1);
        join(p, r, 4 * fresh + 2);
        join(p, q, 4 * fresh + 3);
        _hint = fresh;
    }
}

DelaunayCells Triangulation::build() {
    DelaunayCells result;
    const std::vector<Index> order = insertion_order(_points);
    std::array<Index, 4> first{};
    _edges.assign(64, EdgeSlot{0, 0, 0});
    _cells.reserve(8 * _points.size() + 64);
    _mark.reserve(8 * _points.size() + 64);
    if (!start(order, first)) {
        result.is_flat = true;
        return result;
    }
    for (const Index p : order) {
        if (std::find(first.begin(), first.end(), p) != first.end()) {
            continue;
        }
        const Index c = locate(at(p));
        const auto &v = cell(c).vertex;
        // A point equal to a corner lies in that corner's cell, or on the hull beside it.
        const bool is_duplicate = std::any_of(v.begin(), v.end(), [&](Index corner) {
            return corner != infinite && at(corner) == at(p);
        });
        if (is_duplicate) {
            result.duplicates.push_back(p);
            continue;
        }
        dig(c, p);
        fill(p);
    }
    // Free slots may lie anywhere: mark them, keep the rest.
    for (const Index c : _free_cells) {
        cell(c).vertex[0] = infinite;
    }
    for (const Cell &c : _cells) {
        if (std::find(c.vertex.begin(), c.vertex.end(), infinite) == c.vertex.end()) {
            result.cells.push_back(c.vertex);
        }
    }
    std::sort(result.duplicates.begin(), result.duplicates.end());
    return result;
}

} // namespace fastsim
