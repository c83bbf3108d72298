// 1. Cubes that facets pass are the seeds.
// 2. A cube whose corners lie on both sides is cut into six tetrahedra (Kuhn), alike in all cubes,
//    and its neighbours across faces with corners on both sides follow: so holes are bridged.
// 3. A tetrahedron's edges between inside and outside have a point where a facet cuts them, or in
//    a hole where the winding number is a half; three or four of them make its facets.
#include "surface/wrap.hpp"

#include "predicates/vector_algebra.hpp"
#include "surface/winding.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <unordered_set>

namespace fastsim {

namespace {

using Index = std::int32_t;
using Facet = std::array<Index, 3>;
using Place = std::array<Index, 3>; // of a corner or cube in the grid

constexpr Index largest_place = (1 << 20) - 1;
constexpr double half = 0.5;
constexpr std::size_t cubes_between_calls = 4096;
// Points keep this part of an edge away from its ends: no facet is flat.
constexpr double margin = 0.06;
// Of the spacing, where the grid begins before the box: no plane of a model lies on a grid plane.
constexpr Point offset{1.531, 1.613, 1.477};
// Kuhn: from corner 0 along the axes in each order; corners are numbered by bits x, y, z.
constexpr std::array<std::array<unsigned, 4>, 6> kuhn{
    {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}}};

std::uint64_t key(const Place &p) {
    return static_cast<std::uint64_t>(p[0]) << 40 | static_cast<std::uint64_t>(p[1]) << 20 |
           static_cast<std::uint64_t>(p[2]);
}

Place corner_of(const Place &cube, unsigned corner) {
    return {cube[0] + static_cast<Index>(corner & 1U),
            cube[1] + static_cast<Index>(corner >> 1 & 1U),
            cube[2] + static_cast<Index>(corner >> 2 & 1U)};
}

class Wrapper {
  public:
    Wrapper(std::span<const Point> points, std::span<const Facet> facets, double spacing,
            std::size_t most_cubes)
        : _points(points), _facets(facets), _tree(points, facets), _winding(points, facets, _tree),
          _spacing(spacing), _most_cubes(most_cubes) {
        for (std::size_t i = 0; i < 3; ++i)
            _origin[i] = _tree.nodes()[0].box.low[i] - offset[i] * spacing;
    }

    WrappedSurface run(const std::function<void(std::size_t)> &tell) {
        const Box &box = _tree.nodes()[0].box;
        for (std::size_t i = 0; i < 3; ++i)
            // Places in the grid have 20 bits, with room beyond for holes that bulge.
            if (!((box.high[i] - box.low[i]) / _spacing < (1 << 18)))
                return {{}, {}, true};
        for (const Facet &f : _facets)
            seed(at(f[0]), at(f[1]), at(f[2]));
        for (std::size_t cubes = 0; !_open.empty() && _known.size() <= _most_cubes; ++cubes) {
            if (cubes % cubes_between_calls == 0)
                tell(cubes);
            const Place cube = _open.back();
            _open.pop_back();
            cut(cube);
        }
        if (_known.size() > _most_cubes)
            return {{}, {}, true};
        return std::move(_out);
    }

  private:
    [[nodiscard]] const Point &at(Index v) const { return _points[static_cast<std::size_t>(v)]; }

    [[nodiscard]] Point position(const Place &p) const {
        Point x;
        for (std::size_t i = 0; i < 3; ++i)
            x[i] = _origin[i] + _spacing * p[i];
        return x;
    }

    void add(const Place &cube) {
        if (*std::min_element(cube.begin(), cube.end()) < 0 ||
            *std::max_element(cube.begin(), cube.end()) >= largest_place)
            return;
        if (_known.insert(key(cube)).second)
            _open.push_back(cube);
    }

    /// Cubes around a triangle, halved along its longest side until it is as small as a cube.
    void seed(const Point &a, const Point &b, const Point &c) {
        if (_known.size() > _most_cubes)
            return;
        const std::array<const Point *, 3> t{&a, &b, &c};
        std::size_t longest = 0;
        double length = -1.0;
        for (std::size_t k = 0; k < 3; ++k)
            if (const double l = norm(minus(*t[(k + 1) % 3], *t[k])); l > length) {
                length = l;
                longest = k;
            }
        if (length > _spacing) {
            const Point &p = *t[longest], &q = *t[(longest + 1) % 3], &r = *t[(longest + 2) % 3];
            const Point middle = along(p, minus(q, p), half);
            seed(p, middle, r);
            seed(middle, q, r);
            return;
        }
        Place low{}, high{};
        for (std::size_t i = 0; i < 3; ++i) {
            const auto [smallest, largest] = std::minmax({a[i], b[i], c[i]});
            low[i] = static_cast<Index>(std::floor((smallest - _origin[i]) / _spacing));
            high[i] = static_cast<Index>(std::floor((largest - _origin[i]) / _spacing));
        }
        for (Index i = low[0]; i <= high[0]; ++i)
            for (Index j = low[1]; j <= high[1]; ++j)
                for (Index k = low[2]; k <= high[2]; ++k)
                    add({i, j, k});
    }

    double winding_at(const Place &corner) {
        const auto [found, is_new] = _windings.try_emplace(key(corner), 0.0);
        if (is_new)
            found->second = _winding.at(position(corner));
        return found->second;
    }

    void cut(const Place &cube) {
        std::array<double, 8> winding;
        unsigned inside = 0;
        for (unsigned c = 0; c < 8; ++c) {
            winding[c] = winding_at(corner_of(cube, c));
            if (winding[c] > half)
                inside |= 1U << c;
        }
        if (inside == 0 || inside == 255)
            return;
        for (const auto &tet : kuhn)
            cut_tet(cube, tet, winding);
        for (std::size_t axis = 0; axis < 3; ++axis)
            for (unsigned side = 0; side < 2; ++side) {
                unsigned of_face = 0;
                for (unsigned c = 0; c < 8; ++c)
                    if ((c >> axis & 1U) == side)
                        of_face |= 1U << c;
                const unsigned there = inside & of_face;
                if (there == 0 || there == of_face)
                    continue;
                Place next = cube;
                next[axis] += side == 0 ? -1 : 1;
                add(next);
            }
    }

    void cut_tet(const Place &cube, const std::array<unsigned, 4> &tet,
                 const std::array<double, 8> &winding) {
        std::array<unsigned, 4> in{}, out{};
        std::size_t num_in = 0, num_out = 0;
        for (const unsigned c : tet)
            (winding[c] > half ? in[num_in++] : out[num_out++]) = c;
        if (num_in == 0 || num_out == 0)
            return;
        const auto between = [&](std::size_t i, std::size_t o) {
            return crossing(cube, in[i], out[o], winding);
        };
        Point outwards = minus(position(corner_of(cube, out[0])), position(corner_of(cube, in[0])));
        if (num_in == 1) {
            emit(between(0, 0), between(0, 1), between(0, 2), outwards);
        } else if (num_in == 3) {
            emit(between(0, 0), between(1, 0), between(2, 0), outwards);
        } else {
            const std::array<Index, 4> ring{between(0, 0), between(0, 1), between(1, 1),
                                            between(1, 0)};
            emit(ring[0], ring[1], ring[2], outwards);
            emit(ring[0], ring[2], ring[3], outwards);
        }
    }

    /// `outwards` runs from an inner corner of the tetrahedron to an outer one: it passes the
    /// facets' plane, for their points lie on edges between the two kinds.
    void emit(Index a, Index b, Index c, const Point &outwards) {
        const auto &p = _out.points;
        const Point &x = p[static_cast<std::size_t>(a)], &y = p[static_cast<std::size_t>(b)],
                    &z = p[static_cast<std::size_t>(c)];
        if (dot(cross(minus(y, x), minus(z, x)), outwards) > 0.0)
            _out.facets.push_back({a, b, c});
        else
            _out.facets.push_back({a, c, b});
    }

    Index crossing(const Place &cube, unsigned in, unsigned out,
                   const std::array<double, 8> &winding) {
        // Along an edge of Kuhn's corners only rise: the lower one and the bits that differ name
        // it.
        const unsigned lower = std::min(in, out), bits = in ^ out;
        const std::uint64_t name = key(corner_of(cube, lower)) << 3 | bits;
        const auto [found, is_new] =
            _crossings.try_emplace(name, static_cast<Index>(_out.points.size()));
        if (is_new) {
            const Point p = position(corner_of(cube, out)), q = position(corner_of(cube, in));
            double t = first_facet(p, q);
            if (t > 1.0)
                t = (half - winding[out]) / (winding[in] - winding[out]);
            _out.points.push_back(along(p, minus(q, p), std::clamp(t, margin, 1.0 - margin)));
        }
        return found->second;
    }

    /// Where a segment from p to q meets the first facet, from 0 to 1; 2 where it meets none.
    [[nodiscard]] double first_facet(const Point &p, const Point &q) const {
        Box reach;
        for (std::size_t i = 0; i < 3; ++i) {
            reach.low[i] = std::min(p[i], q[i]);
            reach.high[i] = std::max(p[i], q[i]);
        }
        const Point run = minus(q, p);
        double first = 2.0;
        std::array<Index, 64> open;
        std::size_t num_open = 0;
        open[num_open++] = 0;
        while (num_open > 0) {
            const BoxTree::Node &node = _tree.nodes()[static_cast<std::size_t>(open[--num_open])];
            if (!boxes_overlap(node.box, reach))
                continue;
            if (node.right >= 0) {
                open[num_open++] = node.left;
                open[num_open++] = node.right;
                continue;
            }
            // Moeller, Trumbore 1997.
            const Facet &f = _facets[static_cast<std::size_t>(node.left)];
            const Point u = minus(at(f[1]), at(f[0])), v = minus(at(f[2]), at(f[0]));
            const Point across = cross(run, v);
            const double det = dot(u, across);
            if (det == 0.0)
                continue;
            const Point gap = minus(p, at(f[0]));
            const Point turned = cross(gap, u);
            const double a = dot(gap, across) / det, b = dot(run, turned) / det,
                         t = dot(v, turned) / det;
            if (a >= 0.0 && b >= 0.0 && a + b <= 1.0 && t >= 0.0 && t <= 1.0)
                first = std::min(first, t);
        }
        return first;
    }

    std::span<const Point> _points;
    std::span<const Facet> _facets;
    BoxTree _tree;
    WindingTree _winding;
    Point _origin{};
    double _spacing;
    std::size_t _most_cubes;
    std::unordered_set<std::uint64_t> _known;
    std::vector<Place> _open;
    std::unordered_map<std::uint64_t, double> _windings;
    std::unordered_map<std::uint64_t, Index> _crossings;
    WrappedSurface _out;
};

} // namespace

WrappedSurface wrap_surface(std::span<const Point> points, std::span<const Facet> facets,
                            double spacing, std::size_t most_cubes,
                            const std::function<void(std::size_t)> &tell) {
    return Wrapper(points, facets, spacing, most_cubes).run(tell);
}

} // namespace fastsim
