#include "surface/self_intersection.hpp"

#include "surface/box_tree.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {
namespace {

using Index = std::int32_t;
using Facet = std::array<Index, 3>;

class PairTest {
  public:
    explicit PairTest(std::span<const Point> points) : _points(points) {}

    // On which side of a facet's plane a point lies.
    [[nodiscard]] int side(const Facet &f, Index p) const {
        return orient3d(at(f[0]), at(f[1]), at(f[2]), at(p));
    }

    // Segment (p, q) and closed facet (a, b, c), no corner in common.
    [[nodiscard]] bool segment_meets(Index p, Index q, const Facet &f) const {
        return segment_meets(p, q, f, side(f, p), side(f, q));
    }

    // The same where the sides of its ends are known.
    [[nodiscard]] bool segment_meets(Index p, Index q, const Facet &f, int of_p, int of_q) const {
        const Point &a = at(f[0]), &b = at(f[1]), &c = at(f[2]);
        if (of_p * of_q > 0) {
            return false;
        }
        if (of_p == 0 && of_q == 0) {
            return meets_in_plane(p, q, f);
        }
        return is_one_sided(orient3d(at(p), at(q), a, b), orient3d(at(p), at(q), b, c),
                            orient3d(at(p), at(q), c, a));
    }

    // Facets (u, v, a) and (u, v, b): folded onto each other.
    [[nodiscard]] bool is_folded(Index u, Index v, Index a, Index b) const {
        if (orient3d(at(u), at(v), at(a), at(b)) != 0) {
            return false;
        }
        const Point off = off_plane(at(u), at(v), at(a));
        return orient3d(at(u), at(v), off, at(a)) == orient3d(at(u), at(v), off, at(b));
    }

    // Facets (v, a, b) and (v, c, d), surely on different sides of a plane through v: most are that
    // lie around one point, and it takes less than exact tests.
    [[nodiscard]] bool is_apart(Index v, Index a, Index b, Index c, Index d) const {
        const auto offset = [&](Index i) {
            const Point &p = at(i), &from = at(v);
            return Point{p[0] - from[0], p[1] - from[1], p[2] - from[2]};
        };
        const std::array<Point, 4> corners{offset(a), offset(b), offset(c), offset(d)};
        Point way;
        for (std::size_t i = 0; i < 3; ++i) {
            way[i] = corners[0][i] + corners[1][i] - corners[2][i] - corners[3][i];
        }
        for (std::size_t k = 0; k < 4; ++k) {
            double along = 0.0, sum = 0.0;
            for (std::size_t i = 0; i < 3; ++i) {
                along += corners[k][i] * way[i];
                sum += std::abs(corners[k][i] * way[i]);
            }
            // The plane is whatever `way` came out as; of offsets and products a few roundings are
            // feared, and underflow.
            if (!((k < 2 ? along : -along) > 1e-14 * sum + smallest_safe)) {
                return false;
            }
        }
        return true;
    }

  private:
    // Below this a product may have underflowed.
    static constexpr double smallest_safe = 1e-290;

    [[nodiscard]] const Point &at(Index i) const { return _points[static_cast<std::size_t>(i)]; }

    static bool is_one_sided(int a, int b, int c) {
        return (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
    }

    // Any point surely off the plane: in-plane turns become exact orientations about it.
    static Point off_plane(const Point &a, const Point &b, const Point &c) {
        Point best = a;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            Point off = a;
            off[axis] += std::abs(b[0] - a[0]) + std::abs(b[1] - a[1]) + std::abs(b[2] - a[2]);
            if (orient3d(a, b, c, off) != 0) {
                return off;
            }
            best = off;
        }
        return best;
    }

    [[nodiscard]] bool meets_in_plane(Index p, Index q, const Facet &f) const {
        const Point off = off_plane(at(f[0]), at(f[1]), at(f[2]));
        const auto turn = [&](Index a, Index b, Index c) {
            return orient3d(at(a), at(b), at(c), off);
        };
        if (is_one_sided(turn(f[0], f[1], p), turn(f[1], f[2], p), turn(f[2], f[0], p)) ||
            is_one_sided(turn(f[0], f[1], q), turn(f[1], f[2], q), turn(f[2], f[0], q))) {
            return true;
        }
        // Neither end is inside: the segment has to cross a side. Touching at an end is seen above.
        for (std::size_t k = 0; k < 3; ++k) {
            const Index a = f[k], b = f[(k + 1) % 3];
            const int ends = turn(a, b, p) * turn(a, b, q);
            const int sides = turn(p, q, a) * turn(p, q, b);
            if (ends < 0 && sides <= 0) {
                return true;
            }
        }
        return false;
    }

    std::span<const Point> _points;
};

} // namespace

bool facets_intersect(std::span<const Point> points, const Facet &first, const Facet &second) {
    const PairTest test(points);
    Facet f = first, g = second;
    // Shared corners first, in the same order in both.
    std::size_t shared = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const auto found =
            std::find(g.begin() + static_cast<std::ptrdiff_t>(shared), g.end(), f[i]);
        if (found != g.end()) {
            std::iter_swap(g.begin() + static_cast<std::ptrdiff_t>(shared), found);
            std::swap(f[shared], f[i]);
            ++shared;
        }
    }
    switch (shared) {
    case 3:
        return true;
    case 2:
        return test.is_folded(f[0], f[1], f[2], g[2]);
    case 1:
        return !test.is_apart(f[0], f[1], f[2], g[1], g[2]) &&
               (test.segment_meets(f[1], f[2], g) || test.segment_meets(g[1], g[2], f));
    default:
        std::array<int, 3> of_f{}, of_g{};
        for (std::size_t k = 0; k < 3; ++k) {
            of_f[k] = test.side(g, f[k]);
            of_g[k] = test.side(f, g[k]);
        }
        for (std::size_t k = 0; k < 3; ++k) {
            const std::size_t next = (k + 1) % 3;
            if (test.segment_meets(f[k], f[next], g, of_f[k], of_f[next]) ||
                test.segment_meets(g[k], g[next], f, of_g[k], of_g[next])) {
                return true;
            }
        }
        return false;
    }
}

namespace {

double width(const Box &box) {
    return (box.high[0] - box.low[0]) + (box.high[1] - box.low[1]) + (box.high[2] - box.low[2]);
}

// Whether any two facets meet: pairs of subtrees are halved together, which takes fewer boxes than
// to look for the partners of one facet after the other.
class PairsOfSubtrees {
  public:
    PairsOfSubtrees(std::span<const Point> points, std::span<const Facet> facets,
                    const BoxTree &tree)
        : _points(points), _facets(facets), _nodes(tree.nodes()) {}

    [[nodiscard]] bool has_pair(Index n) const {
        const BoxTree::Node &p = node(n);
        return p.right >= 0 && (has_pair(p.left) || has_pair(p.right) || has_pair(p.left, p.right));
    }

  private:
    [[nodiscard]] bool has_pair(Index a, Index b) const {
        const BoxTree::Node &p = node(a), &q = node(b);
        if (!boxes_overlap(p.box, q.box)) {
            return false;
        }
        if (p.right < 0 && q.right < 0) {
            return facets_intersect(_points, facet(p), facet(q));
        }
        if (q.right < 0 || (p.right >= 0 && width(p.box) > width(q.box))) {
            return has_pair(p.left, b) || has_pair(p.right, b);
        }
        return has_pair(a, q.left) || has_pair(a, q.right);
    }

    [[nodiscard]] const BoxTree::Node &node(Index n) const {
        return _nodes[static_cast<std::size_t>(n)];
    }
    [[nodiscard]] const Facet &facet(const BoxTree::Node &leaf) const {
        return _facets[static_cast<std::size_t>(leaf.left)];
    }

    std::span<const Point> _points;
    std::span<const Facet> _facets;
    std::span<const BoxTree::Node> _nodes;
};

} // namespace

std::vector<std::array<Index, 2>> find_self_intersections(std::span<const Point> points,
                                                          std::span<const Facet> facets,
                                                          std::size_t most) {
    std::vector<std::array<Index, 2>> pairs;
    if (facets.empty()) {
        return pairs;
    }
    const BoxTree tree(points, facets);
    if (!PairsOfSubtrees(points, facets, tree).has_pair(0)) {
        return pairs;
    }
    const std::span<const BoxTree::Node> nodes = tree.nodes();
    std::vector<Index> open;
    for (std::size_t f = 0; f < facets.size() && pairs.size() < most; ++f) {
        open.assign(1, 0);
        const std::size_t before = pairs.size();
        while (!open.empty()) {
            const BoxTree::Node &node = nodes[static_cast<std::size_t>(open.back())];
            open.pop_back();
            // Each pair is looked at from its first facet.
            if (static_cast<std::size_t>(node.last) <= f ||
                !boxes_overlap(node.box, tree.box_of(f))) {
                continue;
            }
            if (node.right >= 0) {
                open.push_back(node.right);
                open.push_back(node.left);
                continue;
            }
            const auto g = static_cast<std::size_t>(node.left);
            if (facets_intersect(points, facets[f], facets[g])) {
                pairs.push_back({static_cast<Index>(f), static_cast<Index>(g)});
            }
        }
        std::sort(pairs.begin() + static_cast<std::ptrdiff_t>(before), pairs.end());
    }
    if (pairs.size() > most) {
        pairs.resize(most);
    }
    return pairs;
}

} // namespace fastsim
