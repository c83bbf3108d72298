#include "recovery/plane_recovery.hpp"

#include "predicates/vector_algebra.hpp"
#include "recovery/flip_recovery.hpp"
#include "recovery/plane_groups.hpp"
#include "recovery/plane_start.hpp"
#include "recovery/plane_triangulation.hpp"
#include "recovery/steiner_insertion.hpp"
#include "slivers/flat_cells.hpp"

#include <algorithm>

namespace fastsim {

namespace {

using Edge = PlaneTriangulation::Edge;

// Fewer missing edges of a plane are left to flips that know nothing of it.
constexpr std::ptrdiff_t fewest_missing = 8;
constexpr std::size_t most_flips = 100;
constexpr std::size_t largest_ring = 24;
constexpr double any_quality = 1e-9;
// Points beside an edge: the best cells first, each at these many halvings of the distance.
constexpr std::array<double, 4> qualities{1e-2, 1e-4, 1e-6, any_quality};
constexpr int most_halvings = 24;

class PlaneRecovery {
  public:
    PlaneRecovery(TetComplex &complex, Protection &protection, Watch &watch,
                  std::span<const Point> surface, const PlaneGroup &plane)
        : _complex(complex), _protection(protection), _watch(watch), _flips(complex, protection),
          _facets(plane.facets), _normal(plane.normal),
          _wanted(surface, plane.normal, plane.facets), _plane(_wanted) {}

    /// Whether enough of it is missing to be worth the points that this may cost.
    bool is_worth_it() const {
        const std::vector<Edge> edges = _wanted.inner_edges();
        return _wanted.is_proper() && std::count_if(edges.begin(), edges.end(), [&](const Edge &e) {
                                          return !_complex.has_edge(e[0], e[1]);
                                      }) >= fewest_missing;
    }

    /// Brings a triangulation of the facets' points in that is near to what is there.
    bool begin() {
        // Given facets under it would be in the way, where points lie in the plane but for
        // roundings.
        for (const Edge &e : _wanted.inner_edges())
            _protection.edges.erase(edge_key(e[0], e[1]));
        for (const Triple &f : _facets)
            _protection.facets.erase(sorted_triple(f[0], f[1], f[2]));
        _plane = follow_complex(_complex, _wanted, _normal);
        return bring_in();
    }

    /// Turns it into the given one, as far as can be.
    void finish() {
        flip_directly();
        for (const Edge &e : _wanted.inner_edges())
            _plane.bring_in(e[0], e[1], [&](Index p, Index q) { return flip(p, q); });
        release();
    }

  private:
    const Point &place(Index i) const { return _complex.points[TetComplex::at(i)]; }

    /// Brings the chosen triangulation in, and protects it.
    bool bring_in() {
        const std::vector<Triple> chosen = _plane.triangles();
        for (const Triple &t : chosen)
            for (std::size_t k = 0; k < 3; ++k) {
                _watch.look();
                if (!_flips.recover_edge(t[k], t[(k + 1) % 3], most_flips))
                    return give_up();
                _protection.edges.insert(edge_key(t[k], t[(k + 1) % 3]));
            }
        for (const Triple &t : chosen) {
            _watch.look();
            if (!_flips.recover_facet(t, most_flips))
                return give_up();
            _protection.facets.insert(sorted_triple(t[0], t[1], t[2]));
        }
        return true;
    }

    bool give_up() {
        release();
        return false;
    }

    /// Lets go of what is not wanted for good.
    void release() {
        for (const Edge &e : _plane.inner_edges())
            if (!_wanted.has_edge(e[0], e[1]))
                _protection.edges.erase(edge_key(e[0], e[1]));
        for (const Triple &t : _plane.triangles())
            if (_wanted.far_corners(t[0], t[1])[0] != t[2])
                _protection.facets.erase(sorted_triple(t[0], t[1], t[2]));
    }

    /// Flips that make a wanted edge each, as long as there are any.
    void flip_directly() {
        std::vector<Edge> edges = _plane.inner_edges();
        for (std::size_t i = 0; i < edges.size(); ++i) {
            const auto [p, q] = edges[i];
            const auto [r, s] = _plane.far_corners(p, q);
            if (r == none || s == none || _wanted.has_edge(p, q) || !_wanted.has_edge(r, s) ||
                !_plane.can_flip(p, q) || !flip(p, q))
                continue;
            edges.insert(edges.end(), {{p, r}, {r, q}, {q, s}, {s, p}});
        }
    }

    /// One flip in the plane, made in space.
    bool flip(Index p, Index q) {
        _watch.look();
        const auto [r, s] = _plane.far_corners(p, q);
        const bool is_done =
            flip_in_space(p, q, r, s) || (clear_sides(p, q, r, s) && flip_in_space(p, q, r, s));
        if (!is_done)
            return false;
        _protection.facets.erase(sorted_triple(p, q, r));
        _protection.facets.erase(sorted_triple(p, q, s));
        _protection.edges.insert(edge_key(r, s));
        _protection.facets.insert(sorted_triple(p, r, s));
        _protection.facets.insert(sorted_triple(q, r, s));
        _plane.flip(p, q);
        return true;
    }

    bool flip_in_space(Index p, Index q, Index r, Index s) {
        const std::uint64_t edge = edge_key(p, q);
        _protection.edges.erase(edge);
        const bool is_done =
            remove_edge(_complex, p, q, _protection, largest_ring, any_quality, r, s);
        if (!is_done)
            _protection.edges.insert(edge);
        return is_done;
    }

    /// Leaves one point at the edge on either side of the plane.
    bool clear_sides(Index p, Index q, Index r, Index s) {
        for (int side = 0; side < 2; ++side) {
            std::vector<Index> cells, ring;
            bool is_closed = false;
            _complex.edge_ring(p, q, cells, ring, is_closed);
            if (!is_closed)
                return false;
            // Cell i holds ring[i] and ring[i + 1]: from r on, those of one side come first.
            const auto start = std::find(ring.begin(), ring.end(), r) - ring.begin();
            if (start == static_cast<std::ptrdiff_t>(ring.size()))
                return false;
            std::rotate(ring.begin(), ring.begin() + start, ring.end());
            std::rotate(cells.begin(), cells.begin() + start, cells.end());
            const auto middle = std::find(ring.begin(), ring.end(), s) - ring.begin();
            if (middle == static_cast<std::ptrdiff_t>(ring.size()))
                return false;
            const std::vector<Index> one(cells.begin(), cells.begin() + middle);
            const std::vector<Index> other(cells.begin() + middle, cells.end());
            const auto is_clear = [&](const std::vector<Index> &half, Index beside) {
                return half.size() < 2 || (half.size() == 2 && is_cell({r, s, beside, p}) &&
                                           is_cell({r, s, beside, q}));
            };
            if (!is_clear(one, ring[1]) ? !insert_beside(p, q, r, s, one, ring[1])
                                        : !is_clear(other, ring.back()) &&
                                              !insert_beside(p, q, r, s, other, ring.back()))
                return false;
        }
        return true;
    }

    /// Whether four points make a cell that is not flat, either way round.
    bool is_cell(const Cell &c) const {
        return std::max(cell_quality(_complex, c),
                        cell_quality(_complex, {c[1], c[0], c[2], c[3]})) > any_quality;
    }

    /// A point above where the diagonals cross, on the side of `beside`.
    bool insert_beside(Index p, Index q, Index r, Index s, const std::vector<Index> &cells,
                       Index beside) {
        const Point pq = minus(place(q), place(p)), rs = minus(place(s), place(r));
        const Point across = cross(pq, _normal);
        const double t = -dot(across, minus(place(r), place(p))) / dot(across, rs);
        const Point foot = along(place(r), rs, t);
        // Products of very small lengths vanish.
        if (!std::isfinite(dot(foot, foot)))
            return false;
        const double sign = dot(_normal, minus(place(beside), foot)) > 0.0 ? 1.0 : -1.0;
        const double reach = 0.5 * std::min(norm(pq), norm(rs));
        const auto v = static_cast<Index>(_complex.points.size());
        _complex.add_point({});
        for (const double quality : qualities) {
            double height = sign * reach / norm(_normal);
            for (int k = 0; k < most_halvings; ++k, height *= 0.5) {
                _complex.points.back() = along(foot, _normal, height);
                if (insert_star(_complex, _protection, cells, v, quality))
                    return true;
            }
        }
        return false; // the point stays, in no cell
    }

    TetComplex &_complex;
    Protection &_protection;
    Watch &_watch;
    FlipRecovery _flips;
    std::span<const Triple> _facets;
    Point _normal;
    PlaneTriangulation _wanted, _plane;
};

} // namespace

void recover_planes(TetComplex &complex, std::span<const Triple> facets, Protection &protection,
                    Watch &watch) {
    const std::vector<PlaneGroup> planes = find_needle_planes(complex.points, facets);
    if (planes.empty())
        return;
    const std::vector<Point> surface = complex.points; // others come and go
    std::vector<PlaneRecovery> chosen;
    chosen.reserve(planes.size());
    for (const PlaneGroup &plane : planes) {
        chosen.emplace_back(complex, protection, watch, surface, plane);
        if (!chosen.back().is_worth_it())
            chosen.pop_back();
    }
    if (chosen.empty())
        return;
    for (const Triple &f : facets) {
        for (std::size_t k = 0; k < 3; ++k)
            if (complex.has_edge(f[k], f[(k + 1) % 3]))
                protection.edges.insert(edge_key(f[k], f[(k + 1) % 3]));
        if (complex.find_facet(f[0], f[1], f[2]).cell != none)
            protection.facets.insert(sorted_triple(f[0], f[1], f[2]));
    }
    watch.begin("bringing needles of plane faces in", chosen.size());
    // All are begun before any is finished: what is well-shaped is in nobody's way.
    std::vector<char> has_begun;
    for (PlaneRecovery &plane : chosen)
        has_begun.push_back(plane.begin());
    // Points in a plane but for roundings leave flat cells under it, which hinder what comes.
    remove_flat_cells(complex, protection, true);
    for (std::size_t i = 0; i < chosen.size(); ++i)
        if (has_begun[i])
            chosen[i].finish();
}

} // namespace fastsim
