#include "mesher/point_insertion.hpp"

#include "mesher/flips.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr std::size_t largest_cavity = 36;
// A point costs cells: it must be worth more than a flip.
constexpr double least_gain = 0.01;
constexpr double nothing = -std::numeric_limits<double>::infinity();

class Insertion {
  public:
    Insertion(TetComplex &complex, Index point) : _complex(complex), _point(point) {}

    /// Tries one place with one set of cells to start from.
    bool attempt(const std::vector<Index> &seeds) {
        _cavity = seeds;
        _before = std::numeric_limits<double>::infinity();
        for (const Index c : _cavity)
            _before = std::min(_before, cell_quality(_complex, _complex.cell(c)));
        place_at_centre();
        // Grow over facets that the point sees badly, placing it anew each time.
        while (_cavity.size() <= largest_cavity) {
            list_facets();
            optimise();
            if (worst(_before) > _before + least_gain && is_positive() && keeps_all_points())
                return commit();
            if (!grow())
                return false;
        }
        return false;
    }

  private:
    struct Wall {
        Triple facet;
        Index beyond;
    };

    Point &place() { return _complex.points[TetComplex::at(_point)]; }
    Cell fresh_cell(const Triple &f) const { return {f[1], f[0], f[2], _point}; }

    bool holds(Index c) const {
        return std::find(_cavity.begin(), _cavity.end(), c) != _cavity.end();
    }

    void place_at_centre() {
        Point sum{};
        for (const Index c : _cavity)
            for (const Index v : _complex.cell(c))
                for (std::size_t i = 0; i < 3; ++i)
                    sum[i] += _complex.points[TetComplex::at(v)][i];
        for (std::size_t i = 0; i < 3; ++i)
            place()[i] = sum[i] / (4.0 * static_cast<double>(_cavity.size()));
    }

    void list_facets() {
        _walls.clear();
        for (const Index c : _cavity)
            for (int k = 0; k < 4; ++k) {
                const Index n = _complex.neighbour(c, k);
                if (n == none || !holds(n))
                    _walls.push_back({_complex.facet(c, k), n});
            }
    }

    /// Worst quality of the new cells; any value not above `floor` once that is known.
    double worst(double floor) {
        double result = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < _walls.size(); ++i) {
            result = std::min(result, cell_quality(_complex, fresh_cell(_walls[i].facet)));
            if (!(result > floor)) {
                // The facet that spoils one place mostly spoils the next: ask it first.
                std::swap(_walls[0], _walls[i]);
                return result;
            }
        }
        return result;
    }

    /// Pattern search for the place.
    void optimise() {
        double reach = 0.0;
        for (const Wall &w : _walls)
            for (std::size_t i = 0; i < 3; ++i)
                reach = std::max(
                    reach, std::abs(_complex.points[TetComplex::at(w.facet[0])][i] - place()[i]));
        double best = worst(nothing);
        for (double step = 0.3 * reach; step > 0.02 * reach; step *= 0.5)
            for (std::size_t axis = 0; axis < 3; ++axis)
                for (const double way : {1.0, -1.0}) {
                    const double old = place()[axis];
                    place()[axis] = old + way * step;
                    const double now = worst(best);
                    if (now > best)
                        best = now;
                    else
                        place()[axis] = old;
                }
    }

    /// Takes in the cell beyond the facet seen worst; false when all bad ones are outer facets.
    bool grow() {
        double lowest = _before + least_gain;
        Index next = none;
        for (const Wall &w : _walls) {
            if (w.beyond == none)
                continue;
            const double quality = cell_quality(_complex, fresh_cell(w.facet));
            if (quality < lowest || quality < 0.0) {
                lowest = quality;
                next = w.beyond;
            }
        }
        if (next == none)
            return false;
        _cavity.push_back(next);
        _before = std::min(_before, cell_quality(_complex, _complex.cell(next)));
        return true;
    }

    bool is_positive() const {
        return std::all_of(_walls.begin(), _walls.end(), [&](const Wall &w) {
            return _complex.orientation(fresh_cell(w.facet)) > 0;
        });
    }

    /// No corner of the old cells may be lost: surface points have to stay.
    bool keeps_all_points() const {
        for (const Index c : _cavity)
            for (const Index v : _complex.cell(c))
                if (std::none_of(_walls.begin(), _walls.end(), [&](const Wall &w) {
                        return w.facet[0] == v || w.facet[1] == v || w.facet[2] == v;
                    }))
                    return false;
        return true;
    }

    bool commit() {
        std::vector<Cell> fresh;
        for (const Wall &w : _walls)
            fresh.push_back(fresh_cell(w.facet));
        _complex.replace(_cavity, fresh);
        return true;
    }

    TetComplex &_complex;
    Index _point;
    double _before = 0.0;
    std::vector<Index> _cavity;
    std::vector<Wall> _walls;
};

} // namespace

bool insert_point_at(TetComplex &complex, Index bad_cell, Index &spare) {
    if (spare == none) {
        spare = static_cast<Index>(complex.points.size());
        complex.add_point({});
    }
    const Cell v = complex.cell(bad_cell);
    Insertion insertion(complex, spare);
    bool is_done = insertion.attempt({bad_cell});
    // The rings of its edges; outer edges have no closed ring, and are only grown into.
    for (std::size_t i = 0; i < 4 && !is_done; ++i)
        for (std::size_t j = i + 1; j < 4 && !is_done; ++j) {
            std::vector<Index> cells, ring;
            bool is_closed = false;
            complex.edge_ring(v[i], v[j], cells, ring, is_closed);
            if (is_closed)
                is_done = insertion.attempt(cells);
        }
    if (is_done)
        spare = none;
    return is_done;
}

} // namespace fastsim
