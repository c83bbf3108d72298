// One insertion: the cells in conflict with a point are dug out and the hole is filled from it.
#include "delaunay/triangulation.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {
namespace {

constexpr std::array<std::array<std::size_t, 3>, 4> facet_of{
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

constexpr double half_ulp = std::numeric_limits<double>::epsilon() / 2.0; // 2^-53
// With corners at most w and the point at most d from the origin along each axis: entries of the
// normal have at most three terms 3 w^2 (2 w^2), each off by 13 roundings, so the scalar product
// is off by 3 * 18 * 17 w^4 d; the lift 6 w^3 (3 d^2) by 13 roundings; one more for the sum.
// Squares of roundings are in the reserve.
constexpr double normal_bound = 1000.0 * half_ulp;
constexpr double lift_bound = 300.0 * half_ulp;

// The search waits for memory more than for anything else.
inline void prefetch([[maybe_unused]] const void *address) {
#if defined(__GNUC__)
    __builtin_prefetch(address);
#endif
}

// Not below the value, so that a bound stays one.
float rounded_up(double width) { return static_cast<float>(width * (1.0 + 1e-6)); }

} // namespace

Triangulation::Spoke Triangulation::spoke(Index vertex, const Point &centre) const {
    const Point &p = place(vertex);
    const double x = p[0] - centre[0], y = p[1] - centre[1], z = p[2] - centre[2];
    return {{x, y, z},
            x * x + y * y + z * z,
            std::max(std::max(std::abs(x), std::abs(y)), std::abs(z))};
}

// With offsets from the origin, and (origin, p, q, r) positive, a point at offset x is inside the
// sphere exactly when  x . (p^2 q x r + q^2 r x p + r^2 p x q) - x^2 p . (q x r)  is positive.
void Triangulation::set_sphere(Index c, const Spoke &p, const Spoke &q, const Spoke &r) {
    Cell &cell = _cells[at(c)];
    const Point qr = cross(q.offset, r.offset), rp = cross(r.offset, p.offset),
                pq = cross(p.offset, q.offset);
    for (std::size_t i = 0; i < 3; ++i) {
        cell.normal[i] = p.squared * qr[i] + q.squared * rp[i] + r.squared * pq[i];
    }
    cell.lift = p.offset[0] * qr[0] + p.offset[1] * qr[1] + p.offset[2] * qr[2];
    cell.width = rounded_up(std::max(std::max(p.reach, q.reach), r.reach));
}

// A cell at infinity is in conflict with what lies beyond its facet (origin, p, q). The normal
// is scaled so that the bound of spheres holds.
void Triangulation::set_plane(Index c, const Spoke &p, const Spoke &q) {
    Cell &cell = _cells[at(c)];
    const double width = std::max(p.reach, q.reach);
    const Point pq = cross(p.offset, q.offset);
    for (std::size_t i = 0; i < 3; ++i) {
        cell.normal[i] = width * width * pq[i];
    }
    cell.lift = 0.0;
    cell.width = rounded_up(width);
}

inline bool Triangulation::is_in_conflict(Index c, const Point &point) const {
    const Cell &cell = _cells[at(c)];
    const Point &origin = place(cell.origin);
    const double x = point[0] - origin[0], y = point[1] - origin[1], z = point[2] - origin[2];
    const double value = (cell.normal[0] * x + cell.normal[1] * y + cell.normal[2] * z) -
                         cell.lift * (x * x + y * y + z * z);
    const double reach = std::max(std::max(std::abs(x), std::abs(y)), std::abs(z));
    const double width = static_cast<double>(cell.width);
    const double bound =
        width * width * width * reach * (normal_bound * width + lift_bound * reach) +
        _smallest_trusted;
    if (value > bound) {
        return true;
    }
    if (value < -bound) {
        return false;
    }
    return is_in_conflict_exactly(c, point);
}

bool Triangulation::is_in_conflict_exactly(Index c, const Point &point) const {
    const Corners *v = &_corners[at(c)];
    if ((*v)[3] == infinite) {
        const int sign = orient3d(place((*v)[0]), place((*v)[1]), place((*v)[2]), point);
        if (sign != 0) {
            return sign > 0;
        }
        v = &_corners[at(_cells[at(c)].neighbour[3] >> 2)];
    }
    // On the sphere: the newest point is lifted above it.
    return in_sphere(place((*v)[0]), place((*v)[1]), place((*v)[2]), place((*v)[3]), point) > 0;
}

// Finds all cells in conflict with a point, and the facets around them.
void Triangulation::dig(Index first, const Point &point) {
    ++_stamp;
    _cavity.clear();
    _openings.clear();
    _cavity.push_back(first);
    const std::uint32_t safe = 2 * _stamp;
    const std::uint32_t conflict = 2 * _stamp + 1;
    _cells[at(first)].mark = conflict;
    for (std::size_t i = 0; i < _cavity.size(); ++i) {
        const Index c = _cavity[i];
        for (std::size_t k = 0; k < 4; ++k) {
            const Index beyond = _cells[at(c)].neighbour[k];
            const Index n = beyond >> 2;
            std::uint32_t &mark = _cells[at(n)].mark;
            if (mark < safe) {
                mark = is_in_conflict(n, point) ? conflict : safe;
                if (mark == conflict) {
                    _cavity.push_back(n);
                    for (const Index next : _cells[at(n)].neighbour) {
                        prefetch(&_cells[at(next >> 2)]);
                    }
                    prefetch(&_corners[at(n)]);
                }
            }
            if (mark == safe) {
                const auto &f = facet_of[k];
                const Corners &v = _corners[at(c)];
                _openings.push_back({beyond, {v[f[0]], v[f[1]], v[f[2]]}});
            }
        }
    }
}

inline std::uint32_t Triangulation::local_number(Index vertex, const Point &centre) {
    Vertex &v = _vertices[at(vertex)];
    if (v.stamp != _stamp) {
        v.stamp = _stamp;
        v.local = static_cast<std::uint32_t>(_spokes.size());
        _spokes.push_back(spoke(vertex, centre));
    }
    return v.local;
}

// Replaces the cavity by the cells from the point to every facet around it.
void Triangulation::fill(Index point) {
    const Point centre = place(point);
    _spokes.clear();
    // A sphere of f triangles has f / 2 + 2 corners; each directed edge is met once.
    _sides.start(_openings.size() / 2 + 2, 3 * _openings.size());
    _fresh.clear();
    std::size_t reused = 0;
    for (const Opening &opening : _openings) {
        // Infinity comes last: a turn of the facet keeps its orientation.
        auto [p, q, r] = opening.facet;
        if (p == infinite) {
            p = q;
            q = r;
            r = infinite;
        } else if (q == infinite) {
            q = p;
            p = r;
            r = infinite;
        }
        const Index fresh = reused < _cavity.size() ? _cavity[reused++] : new_cell();
        const std::uint32_t lp = local_number(p, centre), lq = local_number(q, centre),
                            lr = local_number(r, centre);
        _corners[at(fresh)] = {point, p, q, r};
        Cell &cell = _cells[at(fresh)];
        cell.neighbour[0] = opening.outside;
        cell.origin = point;
        cell.mark = 0;
        _cells[at(opening.outside >> 2)].neighbour[at(opening.outside & 3)] = 4 * fresh;
        if (r == infinite) {
            set_plane(fresh, _spokes[lp], _spokes[lq]);
        } else {
            set_sphere(fresh, _spokes[lp], _spokes[lq], _spokes[lr]);
        }
        _sides(lq, lr) = 4 * fresh + 1;
        _sides(lr, lp) = 4 * fresh + 2;
        _sides(lp, lq) = 4 * fresh + 3;
        _fresh.push_back({fresh, lp, lq, lr});
    }
    for (const auto &[fresh, lp, lq, lr] : _fresh) {
        auto &neighbour = _cells[at(fresh)].neighbour;
        neighbour[1] = _sides(lr, lq);
        neighbour[2] = _sides(lp, lr);
        neighbour[3] = _sides(lq, lp);
    }
    _hint = _fresh.back().cell;
    for (; reused < _cavity.size(); ++reused) {
        _free_cells.push_back(_cavity[reused]);
    }
}

} // namespace fastsim
