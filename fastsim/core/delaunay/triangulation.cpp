#include "delaunay/triangulation.hpp"

#include "delaunay/hilbert_order.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace fastsim {
namespace {

// Facet k lies opposite corner k; counter-clockwise seen from outside a positive cell.
constexpr std::array<std::array<std::size_t, 3>, 4> facet_of{
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

// Sets the facet of a cell that has a given corner at infinity; the cell stays positive.
std::array<std::int32_t, 4> with_infinity_last(std::array<std::int32_t, 4> v) {
    for (std::size_t k = 0; k < 3; ++k) {
        if (v[k] == 0) {
            std::swap(v[k], v[3]);
            std::swap(v[(k + 1) % 3], v[(k + 2) % 3]);
        }
    }
    return v;
}

// An entry of a determinant underflows by 2^-1074, and is then multiplied by up to three
// coordinates. Where those are huge, only the exact predicates are asked.
constexpr double smallest_trusted = 1e-250;
constexpr double largest_trusted = 1e20;
constexpr std::int32_t points_between_looks = 4096;

} // namespace

Triangulation::Triangulation(std::span<const Point> points) : _order(insertion_order(points)) {
    _vertices.reserve(points.size() + 1);
    _vertices.push_back({{}, 0, 0});
    _smallest_trusted = smallest_trusted;
    for (const std::int32_t p : _order) {
        _vertices.push_back({points[at(p)], 0, 0});
        for (const double x : points[at(p)]) {
            if (std::abs(x) > largest_trusted) {
                _smallest_trusted = std::numeric_limits<double>::infinity();
            }
        }
    }
}

Triangulation::Index Triangulation::new_cell() {
    if (!_free_cells.empty()) {
        const Index c = _free_cells.back();
        _free_cells.pop_back();
        return c;
    }
    _cells.emplace_back();
    _corners.emplace_back();
    return static_cast<Index>(_cells.size() - 1);
}

bool Triangulation::start(std::array<Index, 4> &first) {
    // Four points that span space, the first that do.
    const auto off_line = [&](Index p) {
        // Collinear exactly when flat with every direction off the line: three unit steps do.
        for (std::size_t axis = 0; axis < 3; ++axis) {
            Point off = place(first[0]);
            off[axis] = off[axis] == 0.0 ? 1.0 : 2.0 * off[axis];
            if (orient3d(place(first[0]), place(first[1]), place(p), off) != 0) {
                return true;
            }
        }
        return false;
    };
    std::size_t found = 0;
    for (Index p = 1; p < static_cast<Index>(_vertices.size()) && found < 4; ++p) {
        const bool fits = found == 0   ? true
                          : found == 1 ? place(p) != place(first[0])
                          : found == 2 ? off_line(p)
                                       : orient3d(place(first[0]), place(first[1]), place(first[2]),
                                                  place(p)) != 0;
        if (fits) {
            first[found++] = p;
        }
    }
    if (found < 4) {
        return false;
    }
    if (orient3d(place(first[0]), place(first[1]), place(first[2]), place(first[3])) < 0) {
        std::swap(first[0], first[1]);
    }
    // The cell, and one at infinity on each facet; all five share their facets pairwise.
    std::array<Corners, 5> corners{first, {}, {}, {}, {}};
    for (std::size_t k = 0; k < 4; ++k) {
        const auto &f = facet_of[k];
        // Seen from infinity the facet turns the other way.
        corners[k + 1] = with_infinity_last({infinite, first[f[0]], first[f[2]], first[f[1]]});
    }
    for (std::size_t c = 0; c < 5; ++c) {
        const Index fresh = new_cell();
        const Corners &v = corners[c];
        _corners[at(fresh)] = v;
        _cells[at(fresh)].origin = v[0];
        const Spoke p = spoke(v[1], place(v[0])), q = spoke(v[2], place(v[0]));
        if (v[3] == infinite) {
            set_plane(fresh, p, q);
        } else {
            set_sphere(fresh, p, q, spoke(v[3], place(v[0])));
        }
    }
    const auto facet_key = [&](std::size_t c, std::size_t k) {
        const auto &f = facet_of[k];
        std::array<Index, 3> key{corners[c][f[0]], corners[c][f[1]], corners[c][f[2]]};
        std::sort(key.begin(), key.end());
        return key;
    };
    for (std::size_t side = 0; side < 20; ++side) {
        for (std::size_t other = 0; other < 20; ++other) {
            if (side / 4 != other / 4 &&
                facet_key(side / 4, side % 4) == facet_key(other / 4, other % 4)) {
                _cells[side / 4].neighbour[side % 4] = static_cast<Index>(other);
            }
        }
    }
    _hint = 0;
    return true;
}

Triangulation::Index Triangulation::locate(const Point &point) {
    Index here = _hint;
    if (_corners[at(here)][3] == infinite) {
        here = _cells[at(here)].neighbour[3] >> 2;
    }
    // A visibility walk in a regular triangulation never comes back to a cell.
    Index from = -1;
    for (;;) {
        const Corners &v = _corners[at(here)];
        if (v[3] == infinite) {
            return here;
        }
        Index next = -1;
        for (std::size_t k = 0; k < 4; ++k) {
            const Index beyond = _cells[at(here)].neighbour[k] >> 2;
            if (beyond == from) {
                continue;
            }
            const auto &f = facet_of[k];
            if (orient3d(place(v[f[0]]), place(v[f[1]]), place(v[f[2]]), point) > 0) {
                next = beyond;
                break;
            }
        }
        if (next < 0) {
            return here;
        }
        from = here;
        here = next;
    }
}

DelaunayCells Triangulation::build(Watch &watch, bool with_neighbours) {
    DelaunayCells result;
    std::array<Index, 4> first{};
    // Random points have 6.77 cells each; what is not touched is not allocated.
    _cells.reserve(8 * _vertices.size() + 64);
    _corners.reserve(8 * _vertices.size() + 64);
    if (!start(first)) {
        result.is_flat = true;
        return result;
    }
    for (Index p = 1; p < static_cast<Index>(_vertices.size()); ++p) {
        if (std::find(first.begin(), first.end(), p) != first.end()) {
            continue;
        }
        if (p % points_between_looks == 0)
            watch.reach(static_cast<double>(p) / static_cast<double>(_vertices.size()));
        const Point here = place(p);
        const Index c = locate(here);
        const Corners &v = _corners[at(c)];
        // A point equal to a corner lies in that corner's cell, or on the hull beside it.
        const bool is_duplicate = std::any_of(v.begin(), v.end(), [&](Index corner) {
            return corner != infinite && place(corner) == here;
        });
        if (is_duplicate) {
            result.duplicates.push_back(_order[at(p - 1)]);
            continue;
        }
        dig(c, here);
        fill(p);
    }
    std::sort(result.duplicates.begin(), result.duplicates.end());
    collect(result, with_neighbours);
    return result;
}

// Hands over the corners' own memory, in the points' given numbers.
void Triangulation::collect(DelaunayCells &result, bool with_neighbours) {
    for (const Index c : _free_cells) {
        _corners[at(c)][3] = infinite;
    }
    if (with_neighbours) {
        list_neighbours(result.neighbours);
    }
    std::vector<Cell>().swap(_cells);
    std::vector<Vertex>().swap(_vertices);
    std::size_t kept = 0;
    for (const Corners &v : _corners) {
        if (v[3] == infinite) {
            continue;
        }
        Corners &out = _corners[kept++];
        out = {_order[at(v[0] - 1)], _order[at(v[1] - 1)], _order[at(v[2] - 1)],
               _order[at(v[3] - 1)]};
    }
    _corners.resize(kept);
    result.cells = std::move(_corners);
}

// Numbers the finite cells in their order, in their marks.
void Triangulation::list_neighbours(std::vector<std::array<Index, 4>> &out) {
    constexpr auto outside = static_cast<std::uint32_t>(-1);
    std::uint32_t kept = 0;
    for (std::size_t c = 0; c < _cells.size(); ++c) {
        _cells[c].mark = _corners[c][3] == infinite ? outside : kept++;
    }
    out.reserve(kept);
    for (const Cell &cell : _cells) {
        if (cell.mark == outside) {
            continue;
        }
        std::array<Index, 4> &row = out.emplace_back();
        for (std::size_t k = 0; k < 4; ++k) {
            row[k] = static_cast<Index>(_cells[at(cell.neighbour[k] >> 2)].mark);
        }
    }
}

} // namespace fastsim
