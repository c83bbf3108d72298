#include "recovery/steiner_removal.hpp"

#include "recovery/polygon_triangulation.hpp"
#include "slivers/flat_cells.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr double nothing = -std::numeric_limits<double>::infinity();
constexpr int most_passes = 6;

Point cross(const Point &a, const Point &b, const Point &c) {
    const Point u{b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v{c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    return {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
}
double length(const Point &a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

class Removal {
  public:
    Removal(TetComplex &complex, RefinedSurface &surface, std::span<const Triple> given)
        : _complex(complex), _surface(surface), _given(given) {}

    bool remove(Index s) {
        if (!find_new_facets(s))
            return false;
        list_walls(s);
        const Point old = place(s);
        double quality = move_in(s);
        // Another point of the star may see all its walls: then this one is not needed at all.
        Index apex = s;
        for (const Index w : corners()) {
            const double other = worst(w, quality);
            if (other > quality && is_positive(w)) {
                quality = other;
                apex = w;
            }
        }
        if (quality == nothing) {
            place(s) = old;
            return false;
        }
        commit(apex);
        return true;
    }

  private:
    Point &place(Index i) { return _complex.points[TetComplex::at(i)]; }
    const Point &place(Index i) const { return _complex.points[TetComplex::at(i)]; }
    static Cell cell_on(const Triple &f, Index apex) { return {f[1], f[0], f[2], apex}; }
    static bool has(const Triple &f, Index v) { return f[0] == v || f[1] == v || f[2] == v; }

    /// The triangles that take the place of those at s: of one given facet, or of two where s
    /// lies on a given edge.
    bool find_new_facets(Index s) {
        std::vector<Index> link;
        _fan = _surface.fan(s, link);
        const std::size_t n = _fan.size();
        if (n < 3)
            return false;
        // Triangle i lies between link[i] and link[i + 1]; cuts are where the facet changes.
        std::vector<std::size_t> cuts;
        for (std::size_t i = 0; i < n; ++i)
            if (_surface.parent(_fan[i]) != _surface.parent(_fan[(i + n - 1) % n]))
                cuts.push_back(i);
        if (cuts.size() != 0 && cuts.size() != 2)
            return false;
        _fresh.clear();
        _parents.clear();
        const std::size_t pieces = cuts.empty() ? 1 : 2;
        for (std::size_t piece = 0; piece < pieces; ++piece) {
            const std::size_t from = cuts.empty() ? 0 : cuts[piece];
            const std::size_t to = cuts.empty() ? n - 1 : cuts[1 - piece] + (piece ? n : 0);
            std::vector<Index> polygon;
            for (std::size_t i = from; i <= to; ++i)
                polygon.push_back(link[i % n]);
            const Index parent = _surface.parent(_fan[from]);
            const Triple &f = _given[TetComplex::at(parent)];
            const std::vector<Triple> part = triangulate_polygon(
                _complex.points, polygon, cross(place(f[0]), place(f[1]), place(f[2])));
            if (part.empty())
                return false;
            _fresh.insert(_fresh.end(), part.begin(), part.end());
            _parents.insert(_parents.end(), part.size(), parent);
        }
        // The new edges may not be edges of the surface elsewhere.
        for (const Triple &f : _fresh)
            for (std::size_t k = 0; k < 3; ++k) {
                const Index a = f[k], b = f[(k + 1) % 3];
                for (std::size_t i = 0; i < link.size(); ++i)
                    if (link[i] == a && link[(i + 1) % n] != b && link[(i + n - 1) % n] != b &&
                        _surface.has_edge(a, b))
                        return false;
            }
        return true;
    }

    /// All triangles of the region that its new apex must see: the cells' far sides and the new
    /// facets, outward. A far side that is itself a new facet leaves no room between: both go.
    void list_walls(Index s) {
        _complex.cells_around(s, _cells);
        _walls = _fresh;
        for (const Index c : _cells) {
            const Triple f = _complex.facet(c, _complex.corner_of(c, s));
            const Triple key = sorted_triple(f[0], f[1], f[2]);
            const auto same = std::find_if(_walls.begin(), _walls.end(), [&](const Triple &w) {
                return sorted_triple(w[0], w[1], w[2]) == key;
            });
            if (same != _walls.end())
                _walls.erase(same);
            else
                _walls.push_back(f);
        }
    }

    std::vector<Index> corners() const {
        std::vector<Index> result;
        for (const Triple &w : _walls)
            result.insert(result.end(), w.begin(), w.end());
        std::sort(result.begin(), result.end());
        result.erase(std::unique(result.begin(), result.end()), result.end());
        return result;
    }

    /// Worst quality of the cells from an apex; any value not above `floor` once that is known.
    double worst(Index apex, double floor) const {
        double result = std::numeric_limits<double>::infinity();
        for (const Triple &w : _walls)
            if (!has(w, apex)) {
                result = std::min(result, cell_quality(_complex, cell_on(w, apex)));
                if (!(result > floor))
                    break;
            }
        return result;
    }

    bool is_positive(Index apex) const {
        return std::all_of(_walls.begin(), _walls.end(), [&](const Triple &w) {
            return has(w, apex) || _complex.orientation(cell_on(w, apex)) > 0;
        });
    }

    /// Looks for a place of s inside the region; its quality, or `nothing` when there is none.
    double move_in(Index s) {
        if (_walls.empty())
            return 0.0;
        Point inwards{}, centre{};
        for (const Triple &f : _fresh) {
            const Point normal = cross(place(f[0]), place(f[1]), place(f[2]));
            for (std::size_t i = 0; i < 3; ++i)
                inwards[i] -= normal[i] / std::max(length(normal), 1e-300);
        }
        const Point start = place(s);
        const std::vector<Index> around = corners();
        double reach = 0.0;
        for (const Index v : around) {
            double squared = 0.0;
            for (std::size_t i = 0; i < 3; ++i) {
                const double x = place(v)[i] - start[i];
                squared += x * x;
                centre[i] += x / static_cast<double>(around.size());
            }
            reach = std::max(reach, std::sqrt(squared));
        }
        double best = nothing;
        Point best_place = start;
        const auto attempt = [&](const Point &direction, double step) {
            const double size = length(direction);
            if (!(size > 0.0))
                return;
            for (std::size_t i = 0; i < 3; ++i)
                place(s)[i] = start[i] + step * direction[i] / size;
            const double quality = worst(s, best);
            if (quality > best && is_positive(s)) {
                best = quality;
                best_place = place(s);
            }
        };
        for (double step = reach; step > 1e-15 * reach; step *= 0.5) {
            attempt(inwards, step);
            attempt(centre, step);
        }
        place(s) = best_place;
        if (best == nothing)
            return best;
        double step = 0.0;
        for (std::size_t i = 0; i < 3; ++i)
            step = std::max(step, std::abs(best_place[i] - start[i]));
        for (int k = 0; k < 12; ++k, step *= 0.6)
            for (std::size_t axis = 0; axis < 3; ++axis)
                for (const double way : {1.0, -1.0}) {
                    place(s) = best_place;
                    place(s)[axis] += way * step;
                    const double quality = worst(s, best);
                    if (quality > best && is_positive(s)) {
                        best = quality;
                        best_place = place(s);
                    }
                }
        place(s) = best_place;
        return best;
    }

    void commit(Index apex) {
        std::vector<Cell> cells;
        for (const Triple &w : _walls)
            if (!has(w, apex))
                cells.push_back(cell_on(w, apex));
        _complex.replace(_cells, cells, true);
        _surface.replace(_fan, _fresh, _parents);
    }

    TetComplex &_complex;
    RefinedSurface &_surface;
    std::span<const Triple> _given;
    std::vector<Index> _fan;     // triangles at the point
    std::vector<Triple> _fresh;  // those that replace them
    std::vector<Index> _parents; // and the facets they are parts of
    std::vector<Index> _cells;   // at the point
    std::vector<Triple> _walls;
};

} // namespace

std::vector<Index> remove_steiner_points(TetComplex &complex, RefinedSurface &surface,
                                         std::span<const Triple> given, std::vector<Index> steiner,
                                         Watch &watch) {
    Removal removal(complex, surface, given);
    std::erase_if(steiner, [&](Index s) { return !surface.has_point(s); });
    // Last in, first out; one that is stuck may come free once its neighbours are gone.
    std::reverse(steiner.begin(), steiner.end());
    for (int pass = 0; pass < most_passes && !steiner.empty(); ++pass)
        if (std::erase_if(steiner, [&](Index s) {
                watch.look();
                const bool is_gone = removal.remove(s);
                if (is_gone)
                    watch.count();
                return is_gone;
            }) == 0)
            // Flat cells at the point leave it no room: they go, and it is tried again.
            if (remove_flat_cells(complex, {}, true) > 0 && pass > 0)
                break;
    return steiner;
}

} // namespace fastsim
