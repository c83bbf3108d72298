#include "surface/closest_point.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <limits>

namespace fastsim {

namespace {

double distance_squared_to(const Box &box, const Point &p) {
    double sum = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
        const double gap = std::max({box.low[i] - p[i], p[i] - box.high[i], 0.0});
        sum += gap * gap;
    }
    return sum;
}

// The deepest tree of 2^31 facets, one sibling left open on each level.
constexpr std::size_t deepest = 64;
// Halvings of a triangle until its bound is taken as it is.
constexpr std::size_t most_halvings = 2000;

} // namespace

Point closest_on_triangle(const Point &place, const Point &a, const Point &b, const Point &c) {
    const Point ab = minus(b, a), ac = minus(c, a), ap = minus(place, a);
    const double ab_ap = dot(ab, ap), ac_ap = dot(ac, ap);
    if (ab_ap <= 0.0 && ac_ap <= 0.0)
        return a;
    const Point bp = minus(place, b);
    const double ab_bp = dot(ab, bp), ac_bp = dot(ac, bp);
    if (ab_bp >= 0.0 && ac_bp <= ab_bp)
        return b;
    const double of_c = ab_ap * ac_bp - ab_bp * ac_ap;
    if (of_c <= 0.0 && ab_ap >= 0.0 && ab_bp <= 0.0)
        return along(a, ab, ab_ap / (ab_ap - ab_bp));
    const Point cp = minus(place, c);
    const double ab_cp = dot(ab, cp), ac_cp = dot(ac, cp);
    if (ac_cp >= 0.0 && ab_cp <= ac_cp)
        return c;
    const double of_b = ab_cp * ac_ap - ab_ap * ac_cp;
    if (of_b <= 0.0 && ac_ap >= 0.0 && ac_cp <= 0.0)
        return along(a, ac, ac_ap / (ac_ap - ac_cp));
    const double of_a = ab_bp * ac_cp - ab_cp * ac_bp;
    if (of_a <= 0.0 && ac_bp - ab_bp >= 0.0 && ab_cp - ac_cp >= 0.0)
        return along(b, minus(c, b), (ac_bp - ab_bp) / ((ac_bp - ab_bp) + (ab_cp - ac_cp)));
    const double sum = of_a + of_b + of_c;
    return along(along(a, ab, of_b / sum), ac, of_c / sum);
}

SurfaceDistance::SurfaceDistance(std::vector<Point> points,
                                 std::vector<std::array<std::int32_t, 3>> facets)
    : _points(std::move(points)), _facets(std::move(facets)), _tree(_points, _facets) {}

ClosestPoint SurfaceDistance::closest(const Point &place) const {
    return search(place, std::numeric_limits<double>::infinity(), false);
}

// The distance from one facet is convex, so that over a triangle it is largest at a corner: the
// smallest such maximum over some facets bounds the distance from all of them. The piece with the
// largest bound is halved until that is near what was found at corners.
double SurfaceDistance::farthest(const std::array<Point, 3> &triangle, double accuracy) const {
    struct Piece {
        std::array<Point, 3> corners;
        std::array<ClosestPoint, 3> near;
        double bound; // squared

        bool operator<(const Piece &other) const { return bound < other.bound; }
    };
    double found = 0.0; // squared, at corners
    const auto bounded = [&](Piece piece) {
        piece.bound = std::numeric_limits<double>::infinity();
        for (const ClosestPoint &near : piece.near) {
            found = std::max(found, near.distance_squared);
            const auto &f = _facets[static_cast<std::size_t>(near.facet)];
            double most = 0.0;
            for (const Point &p : piece.corners) {
                const Point gap =
                    minus(closest_on_triangle(p, _points[static_cast<std::size_t>(f[0])],
                                              _points[static_cast<std::size_t>(f[1])],
                                              _points[static_cast<std::size_t>(f[2])]),
                          p);
                most = std::max(most, dot(gap, gap));
            }
            piece.bound = std::min(piece.bound, most);
        }
        return piece;
    };
    std::vector<Piece> open{bounded(
        {triangle, {closest(triangle[0]), closest(triangle[1]), closest(triangle[2])}, 0.0})};
    for (std::size_t halvings = 0; halvings < most_halvings; ++halvings) {
        const double enough = accuracy + 1.01 * std::sqrt(found);
        if (open.front().bound <= enough * enough)
            break;
        std::pop_heap(open.begin(), open.end());
        const Piece piece = open.back();
        open.pop_back();
        std::size_t k = 0;
        double longest = -1.0;
        for (std::size_t i = 0; i < 3; ++i) {
            const Point side = minus(piece.corners[(i + 1) % 3], piece.corners[i]);
            if (dot(side, side) > longest) {
                longest = dot(side, side);
                k = i;
            }
        }
        const std::size_t next = (k + 1) % 3;
        const Point middle =
            along(piece.corners[k], minus(piece.corners[next], piece.corners[k]), 0.5);
        const ClosestPoint near = closest(middle);
        Piece one = piece, other = piece;
        one.corners[next] = other.corners[k] = middle;
        one.near[next] = other.near[k] = near;
        for (const Piece &half : {one, other}) {
            open.push_back(bounded(half));
            std::push_heap(open.begin(), open.end());
        }
    }
    return std::sqrt(open.front().bound);
}

bool SurfaceDistance::is_within(const Point &place, double distance) const {
    return search(place, distance * distance, true).facet >= 0;
}

ClosestPoint SurfaceDistance::search(const Point &place, double reach_squared, bool any) const {
    ClosestPoint best{place, reach_squared, -1};
    struct Open {
        std::int32_t node;
        double distance_squared;
    };
    std::array<Open, deepest> open;
    std::size_t num_open = 0;
    const auto nodes = _tree.nodes();
    open[num_open++] = {0, distance_squared_to(nodes[0].box, place)};
    while (num_open > 0) {
        const Open next = open[--num_open];
        if (next.distance_squared > best.distance_squared)
            continue;
        const BoxTree::Node &node = nodes[static_cast<std::size_t>(next.node)];
        if (node.right < 0) {
            const auto &f = _facets[static_cast<std::size_t>(node.left)];
            const Point found = closest_on_triangle(place, _points[static_cast<std::size_t>(f[0])],
                                                    _points[static_cast<std::size_t>(f[1])],
                                                    _points[static_cast<std::size_t>(f[2])]);
            const Point gap = minus(found, place);
            const double distance_squared = dot(gap, gap);
            if (distance_squared <= best.distance_squared) {
                best = {found, distance_squared, node.left};
                if (any)
                    return best;
            }
            continue;
        }
        Open a{node.left,
               distance_squared_to(nodes[static_cast<std::size_t>(node.left)].box, place)};
        Open b{node.right,
               distance_squared_to(nodes[static_cast<std::size_t>(node.right)].box, place)};
        if (a.distance_squared < b.distance_squared)
            std::swap(a, b);
        open[num_open++] = a; // the nearer one is taken first
        open[num_open++] = b;
    }
    return best;
}

} // namespace fastsim
