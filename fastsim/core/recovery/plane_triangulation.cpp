#include "recovery/plane_triangulation.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

// Of the sum of two cotangents: roundings do not decide.
constexpr double cotangent_rounding = 1e-9;

double cotangent(const Point &at, const Point &p, const Point &q) {
    const Point u = minus(p, at), v = minus(q, at);
    return dot(u, v) / std::max(norm(cross(u, v)), 1e-300);
}

} // namespace

PlaneTriangulation::PlaneTriangulation(std::span<const Point> points, const Point &normal,
                                       std::span<const Triple> triangles)
    : _points(points) {
    std::size_t axis = 0;
    for (std::size_t i = 1; i < 3; ++i)
        if (std::abs(normal[i]) > std::abs(normal[axis]))
            axis = i;
    _x = (axis + 1) % 3;
    _y = (axis + 2) % 3;
    if (normal[axis] < 0.0)
        std::swap(_x, _y);
    for (const Triple &t : triangles) {
        _is_proper = _is_proper && turn(t[0], t[1], t[2]) > 0;
        add(t[0], t[1], t[2]);
    }
}

/// +1 when c lies on the left of (a, b); exact.
int PlaneTriangulation::turn(Index a, Index b, Index c) const {
    const auto flat = [&](Index i) -> Point {
        const Point &p = _points[TetComplex::at(i)];
        return {p[_x], p[_y], 0.0};
    };
    const Point p = flat(a);
    return orient3d(p, flat(b), flat(c), {p[0], p[1], 1.0});
}

void PlaneTriangulation::add(Index a, Index b, Index c) {
    const Triple t{a, b, c};
    for (std::size_t k = 0; k < 3; ++k) {
        _third[directed(t[k], t[(k + 1) % 3])] = t[(k + 2) % 3];
        _ahead[t[k]].push_back(t[(k + 1) % 3]);
    }
}

void PlaneTriangulation::drop(Index a, Index b, Index c) {
    const Triple t{a, b, c};
    for (std::size_t k = 0; k < 3; ++k) {
        _third.erase(directed(t[k], t[(k + 1) % 3]));
        std::vector<Index> &ends = _ahead[t[k]];
        ends.erase(std::find(ends.begin(), ends.end(), t[(k + 1) % 3]));
    }
}

std::vector<PlaneTriangulation::Edge> PlaneTriangulation::inner_edges() const {
    std::vector<Edge> edges;
    for (const auto &[side, corner] : _third) {
        const auto a = static_cast<Index>(side >> 32), b = static_cast<Index>(side & 0xffffffffu);
        if (a < b && third(b, a) != none)
            edges.push_back({a, b});
    }
    std::sort(edges.begin(), edges.end());
    return edges;
}

std::vector<Triple> PlaneTriangulation::triangles() const {
    std::vector<Triple> all;
    for (const auto &[side, corner] : _third) {
        const auto a = static_cast<Index>(side >> 32), b = static_cast<Index>(side & 0xffffffffu);
        if (a < b && a < corner)
            all.push_back({a, b, corner});
    }
    std::sort(all.begin(), all.end());
    return all;
}

bool PlaneTriangulation::can_flip(Index a, Index b) const {
    const auto [left, right] = far_corners(a, b);
    return left != none && right != none && turn(right, left, a) > 0 && turn(left, right, b) > 0;
}

bool PlaneTriangulation::is_better_flipped(Index a, Index b) const {
    const auto [left, right] = far_corners(a, b);
    const auto place = [&](Index i) -> const Point & { return _points[TetComplex::at(i)]; };
    return cotangent(place(left), place(a), place(b)) +
               cotangent(place(right), place(a), place(b)) <
           -cotangent_rounding;
}

void PlaneTriangulation::flip(Index a, Index b) {
    const auto [left, right] = far_corners(a, b);
    drop(a, b, left);
    drop(b, a, right);
    add(a, right, left);
    add(right, b, left);
}

bool PlaneTriangulation::bring_in(Index a, Index b,
                                  const std::function<bool(Index, Index)> &flip_edge) {
    if (has_edge(a, b))
        return true;
    const auto crossing = crossed(a, b);
    if (!crossing)
        return false;
    std::vector<Edge> ahead = *crossing;
    // Sloan's loop ends; roundings can be no reason why it should not.
    const std::size_t most = 20 + 4 * ahead.size() * ahead.size();
    for (std::size_t i = 0; i < ahead.size() && i < most; ++i) {
        const auto [p, q] = ahead[i];
        if (!can_flip(p, q)) {
            ahead.push_back({p, q});
            continue;
        }
        const auto [r, s] = far_corners(p, q);
        if (!flip_edge(p, q))
            return false;
        if (turn(a, b, r) * turn(a, b, s) < 0)
            ahead.push_back({r, s});
    }
    return has_edge(a, b);
}

std::optional<std::vector<PlaneTriangulation::Edge>> PlaneTriangulation::crossed(Index a,
                                                                                 Index b) const {
    const auto around = _ahead.find(a);
    if (around == _ahead.end())
        return std::nullopt;
    Index right = none, left = none;
    for (const Index u : around->second) {
        const Index w = third(a, u);
        if (turn(a, u, b) > 0 && turn(a, w, b) < 0) {
            right = u;
            left = w;
            break;
        }
    }
    if (right == none)
        return std::nullopt;
    std::vector<Edge> edges;
    while (true) {
        edges.push_back({right, left});
        const Index ahead = third(left, right);
        if (ahead == b)
            return edges;
        const int side = ahead == none ? 0 : turn(a, b, ahead);
        if (side == 0)
            return std::nullopt;
        (side > 0 ? left : right) = ahead;
    }
}

} // namespace fastsim
