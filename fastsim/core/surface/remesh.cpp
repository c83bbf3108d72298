#include "surface/remesh.hpp"

#include "predicates/vector_algebra.hpp"
#include "surface/closest_point.hpp"

#include <algorithm>
#include <numbers>

namespace fastsim {

namespace {

using Index = EditableSurface::Index;
using Facet = EditableSurface::Facet;
using Corners = std::array<Point, 3>;

// Botsch, Kobbelt: an edge is split above 4/3 and collapsed below 4/5 of the wanted length.
constexpr double longest = 4.0 / 3.0;
constexpr double shortest = 4.0 / 5.0;
// Facets at an edge whose normals are further apart make it sharp, and it is kept.
const double sharp_cosine = std::cos(50.0 * std::numbers::pi / 180.0);
// A facet may not turn further than this in one step.
const double turn_cosine = std::cos(40.0 * std::numbers::pi / 180.0);
// Below this angle of a facet a step must not make the smallest angle around it smaller.
const double good_angle = 25.0 * std::numbers::pi / 180.0;

Point normal_of(const Corners &t) { return cross(minus(t[1], t[0]), minus(t[2], t[0])); }

double smallest_angle(const Corners &t) {
    double smallest = std::numbers::pi;
    for (std::size_t k = 0; k < 3; ++k) {
        const Point u = minus(t[(k + 1) % 3], t[k]), v = minus(t[(k + 2) % 3], t[k]);
        smallest = std::min(smallest, std::atan2(norm(cross(u, v)), dot(u, v)));
    }
    return smallest;
}

bool has_turned(const Corners &before, const Corners &after) {
    const Point a = normal_of(before), b = normal_of(after);
    return !(dot(a, b) > turn_cosine * norm(a) * norm(b));
}

Point middle(const Point &a, const Point &b) {
    return {0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])};
}

Point centre(const Corners &t) {
    return {(t[0][0] + t[1][0] + t[2][0]) / 3.0, (t[0][1] + t[1][1] + t[2][1]) / 3.0,
            (t[0][2] + t[1][2] + t[2][2]) / 3.0};
}

class Remesher {
  public:
    Remesher(std::span<const Point> points, std::span<const Facet> facets,
             const RemeshSettings &settings)
        : _surface(points, facets),
          _given({points.begin(), points.end()}, {facets.begin(), facets.end()}),
          _settings(settings) {
        find_sharp_edges();
    }

    RemeshedSurface run(const std::function<void(double)> &tell) {
        for (int pass = 0; pass < _settings.passes; ++pass) {
            tell(static_cast<double>(pass) / _settings.passes);
            split_long_edges();
            collapse_short_edges();
            for (int sweep = 0; sweep < 3; ++sweep) {
                flip_edges();
                move_points();
            }
            flip_edges();
        }
        _surface.compact(_out.points, _out.facets);
        return std::move(_out);
    }

  private:
    Corners corners(Index f) const {
        const Facet &v = _surface.facet(f);
        return {_surface.point(v[0]), _surface.point(v[1]), _surface.point(v[2])};
    }

    Corners corners_with(Index f, Index moved, const Point &place) const {
        Corners t = corners(f);
        for (std::size_t k = 0; k < 3; ++k)
            if (_surface.facet(f)[k] == moved)
                t[k] = place;
        return t;
    }

    bool is_near(const Corners &t) const {
        for (std::size_t k = 0; k < 3; ++k)
            if (!_given.is_within(middle(t[k], t[(k + 1) % 3]), _settings.distance))
                return false;
        return _given.is_within(centre(t), _settings.distance);
    }

    double length(Index a, Index b) const {
        return norm(minus(_surface.point(a), _surface.point(b)));
    }

    double wanted(Index a, Index b) const {
        return _settings.sizes.at(middle(_surface.point(a), _surface.point(b)));
    }

    /// A bend is sharp where both facets reach further than the distance allowed: smaller ones
    /// are noise by the user's own measure.
    void find_sharp_edges() {
        for (const auto &[a, b] : _surface.edges()) {
            const auto at_edge = _surface.flaps(a, b);
            const Point n = normal_of(corners(at_edge.left_facet)),
                        m = normal_of(corners(at_edge.right_facet));
            const double reach = _settings.distance * length(a, b);
            if (norm(n) > reach && norm(m) > reach && dot(n, m) < sharp_cosine * norm(n) * norm(m))
                _surface.make_sharp(a, b);
        }
    }

    bool is_free(Index v) const { return _surface.num_sharp(v) == 0; }

    void split_long_edges() {
        std::vector<std::pair<double, std::pair<Index, Index>>> chosen;
        for (const auto &e : _surface.edges())
            if (const double l = length(e.first, e.second); l > longest * wanted(e.first, e.second))
                chosen.push_back({-l, e});
        std::sort(chosen.begin(), chosen.end());
        for (const auto &[unused, e] : chosen) {
            // The middle lies on the surface as it is; later moves bring it to the given one.
            _surface.split(e.first, e.second,
                           middle(_surface.point(e.first), _surface.point(e.second)));
            ++_out.splits;
        }
    }

    void collapse_short_edges() {
        std::vector<std::pair<double, std::pair<Index, Index>>> chosen;
        for (const auto &e : _surface.edges())
            if (const double l = length(e.first, e.second);
                l < shortest * wanted(e.first, e.second))
                chosen.push_back({l, e});
        std::sort(chosen.begin(), chosen.end());
        for (const auto &[unused, e] : chosen) {
            const auto [a, b] = e;
            if (!_surface.is_alive(a) || !_surface.is_alive(b) || !_surface.has_edge(a, b))
                continue;
            if (length(a, b) < shortest * wanted(a, b))
                try_collapses(a, b);
        }
    }

    void try_collapses(Index a, Index b) {
        const bool along = _surface.is_sharp(a, b);
        const auto may_go = [&](Index v) {
            return is_free(v) || (along && _surface.num_sharp(v) == 2);
        };
        if (is_free(a) && is_free(b) &&
            collapse(a, b, _given.closest(middle(_surface.point(a), _surface.point(b))).point))
            return;
        if (may_go(b) && collapse(a, b, _surface.point(a)))
            return;
        if (may_go(a))
            collapse(b, a, _surface.point(b));
    }

    bool collapse(Index keep, Index gone, const Point &place) {
        if (!_surface.can_collapse(keep, gone))
            return false;
        double before = good_angle, after = std::numbers::pi;
        std::vector<Corners> changed;
        for (const Index v : {keep, gone})
            for (const Index f : _surface.facets_around(v)) {
                const Corners old = corners(f);
                before = std::min(before, smallest_angle(old));
                const Facet &corner = _surface.facet(f);
                const bool has_both =
                    std::find(corner.begin(), corner.end(), keep) != corner.end() &&
                    std::find(corner.begin(), corner.end(), gone) != corner.end();
                if (has_both)
                    continue; // it goes
                const Corners now = corners_with(f, v, place);
                after = std::min(after, smallest_angle(now));
                // A needle's normal says nothing; its new shape is judged by the distance alone.
                const bool is_needle = norm(normal_of(old)) < _needle * dot_of_longest(old);
                if (after < before || (!is_needle && has_turned(old, now)))
                    return false;
                for (std::size_t k = 0; k < 3; ++k)
                    if (norm(minus(now[k], now[(k + 1) % 3])) >
                        longest * _settings.sizes.at(middle(now[k], now[(k + 1) % 3])))
                        return false;
                changed.push_back(now);
            }
        // The way back: the place that goes must stay near what replaces it.
        const Point left = _surface.point(gone);
        bool is_covered = false;
        for (const Corners &t : changed) {
            const Point gap = minus(closest_on_triangle(left, t[0], t[1], t[2]), left);
            is_covered = is_covered || dot(gap, gap) <= _settings.distance * _settings.distance;
        }
        if (!is_covered || !std::all_of(changed.begin(), changed.end(),
                                        [&](const Corners &t) { return is_near(t); }))
            return false;
        _surface.collapse(keep, gone, place);
        ++_out.collapses;
        return true;
    }

    static double dot_of_longest(const Corners &t) {
        double longest_squared = 0.0;
        for (std::size_t k = 0; k < 3; ++k) {
            const Point e = minus(t[(k + 1) % 3], t[k]);
            longest_squared = std::max(longest_squared, dot(e, e));
        }
        return longest_squared;
    }

    void flip_edges() {
        for (const auto &[a, b] : _surface.edges()) {
            if (!_surface.has_edge(a, b) || !_surface.can_flip(a, b))
                continue;
            const auto at_edge = _surface.flaps(a, b);
            const Point pa = _surface.point(a), pb = _surface.point(b),
                        pl = _surface.point(at_edge.left), pr = _surface.point(at_edge.right);
            const Corners left{pa, pb, pl}, right{pb, pa, pr}, one{pa, pr, pl}, other{pb, pl, pr};
            const double before = std::min(smallest_angle(left), smallest_angle(right));
            const double after = std::min(smallest_angle(one), smallest_angle(other));
            if (after <= before * (1.0 + 1e-9))
                continue;
            // Compared with both together: one of them may be a needle.
            const Point n = normal_of(left), m = normal_of(right);
            const Point sum{n[0] + m[0], n[1] + m[1], n[2] + m[2]};
            const auto faces_away = [&](const Corners &t) {
                const Point k = normal_of(t);
                return !(dot(k, sum) > turn_cosine * norm(k) * norm(sum));
            };
            if (faces_away(one) || faces_away(other) || !is_near(one) || !is_near(other))
                continue;
            _surface.flip(a, b);
            ++_out.flips;
        }
    }

    void move_points() {
        for (Index v = 0; v < static_cast<Index>(_surface.num_points()); ++v) {
            if (!_surface.is_alive(v) || !is_free(v))
                continue;
            // Towards the centre of the facets around, each by its area.
            Point target{0.0, 0.0, 0.0};
            double weight = 0.0, before = good_angle;
            for (const Index f : _surface.facets_around(v)) {
                const Corners t = corners(f);
                const double area = norm(normal_of(t));
                target = along(target, centre(t), area);
                weight += area;
                before = std::min(before, smallest_angle(t));
            }
            if (!(weight > 0.0))
                continue;
            for (double &x : target)
                x /= weight;
            const Point place = _given.closest(target).point;
            bool is_good = true;
            for (const Index f : _surface.facets_around(v)) {
                const Corners old = corners(f), now = corners_with(f, v, place);
                const bool is_needle = norm(normal_of(old)) < _needle * dot_of_longest(old);
                is_good = is_good && smallest_angle(now) >= before &&
                          (is_needle || !has_turned(old, now)) && is_near(now);
            }
            if (is_good) {
                _surface.move(v, place);
                ++_out.moves;
            }
        }
    }

    // Height over length below which a facet's normal is not to be trusted.
    static constexpr double _needle = 0.05;

    EditableSurface _surface;
    SurfaceDistance _given;
    RemeshSettings _settings;
    RemeshedSurface _out;
};

} // namespace

RemeshedSurface remesh_surface(std::span<const Point> points, std::span<const Facet> facets,
                               const RemeshSettings &settings,
                               const std::function<void(double)> &tell) {
    return Remesher(points, facets, settings).run(tell);
}

} // namespace fastsim
