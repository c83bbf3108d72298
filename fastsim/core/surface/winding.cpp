#include "surface/winding.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fastsim {

namespace {

// A node further away than so many of its radii acts as a dipole: an error of some percent at most.
constexpr double far_away = 2.5;

// Van Oosterom, Strackee 1983; twice the arc tangent is the solid angle.
double half_solid_angle(const Point &a, const Point &b, const Point &c) {
    const double la = norm(a), lb = norm(b), lc = norm(c);
    const double flat = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
    return std::atan2(dot(a, cross(b, c)), flat);
}

} // namespace

WindingTree::WindingTree(std::span<const Point> points,
                         std::span<const std::array<std::int32_t, 3>> facets, const BoxTree &tree)
    : _points(points), _facets(facets), _tree(tree), _dipoles(tree.nodes().size()) {
    const auto nodes = tree.nodes();
    // Children come after their parents.
    for (std::size_t n = nodes.size(); n-- > 0;) {
        Dipole &made = _dipoles[n];
        if (nodes[n].right < 0) {
            const auto &f = facets[static_cast<std::size_t>(nodes[n].left)];
            const Point &a = points[static_cast<std::size_t>(f[0])],
                        &b = points[static_cast<std::size_t>(f[1])],
                        &c = points[static_cast<std::size_t>(f[2])];
            made.area = cross(minus(b, a), minus(c, a));
            for (std::size_t i = 0; i < 3; ++i) {
                made.area[i] *= 0.5;
                made.centre[i] = (a[i] + b[i] + c[i]) / 3.0;
            }
            made.weight = norm(made.area);
        } else {
            const Dipole &left = _dipoles[static_cast<std::size_t>(nodes[n].left)],
                         &right = _dipoles[static_cast<std::size_t>(nodes[n].right)];
            made.weight = left.weight + right.weight;
            const double share = made.weight > 0.0 ? right.weight / made.weight : 0.5;
            made.centre = along(left.centre, minus(right.centre, left.centre), share);
            made.area = along(left.area, right.area, 1.0);
        }
        Point reach{};
        for (std::size_t i = 0; i < 3; ++i)
            reach[i] = std::max(nodes[n].box.high[i] - made.centre[i],
                                made.centre[i] - nodes[n].box.low[i]);
        made.radius = norm(reach);
    }
}

double WindingTree::at(const Point &place) const {
    const auto nodes = _tree.nodes();
    // The deepest tree of 2^31 facets, one sibling left open on each level.
    std::array<std::int32_t, 64> open;
    std::size_t num_open = 0;
    open[num_open++] = 0;
    double sum = 0.0;
    while (num_open > 0) {
        const auto n = static_cast<std::size_t>(open[--num_open]);
        const Dipole &dipole = _dipoles[n];
        const Point gap = minus(dipole.centre, place);
        const double distance = norm(gap);
        if (distance > far_away * dipole.radius) {
            sum += dot(gap, dipole.area) / (2.0 * distance * distance * distance);
            continue;
        }
        const BoxTree::Node &node = nodes[n];
        if (node.right >= 0) {
            open[num_open++] = node.left;
            open[num_open++] = node.right;
            continue;
        }
        const auto &f = _facets[static_cast<std::size_t>(node.left)];
        sum += half_solid_angle(minus(_points[static_cast<std::size_t>(f[0])], place),
                                minus(_points[static_cast<std::size_t>(f[1])], place),
                                minus(_points[static_cast<std::size_t>(f[2])], place));
    }
    return sum / (2.0 * std::numbers::pi);
}

} // namespace fastsim
