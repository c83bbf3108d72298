#include "slivers/point_insertion.hpp"

#include "slivers/cell_quality.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr std::size_t largest_cavity = 30, largest_thorough_cavity = 60;
// Growing without getting better is given up after as many cells.
constexpr int most_vain_steps = 6, most_thorough_vain_steps = 25;
// A point costs cells: it must be worth more than a flip.
constexpr double least_gain = 0.01;
// Steps of the search for a place, in parts of the cavity's reach: coarse while it grows.
constexpr double first_step = 0.3, coarse_step = 0.14, fine_step = 0.02;
constexpr double nothing = -std::numeric_limits<double>::infinity();

} // namespace

bool PointInsertion::insert_at(Index bad_cell, const std::vector<double> &quality) {
    if (_point == none) {
        _point = static_cast<Index>(_complex.points.size());
        _complex.add_point({});
    }
    const Cell v = _complex.cell(bad_cell);
    bool is_done = attempt({bad_cell}, quality);
    // The rings of its edges; outer edges have no closed ring, and are only grown into.
    for (std::size_t i = 0; i < 4 && !is_done; ++i)
        for (std::size_t j = i + 1; j < 4 && !is_done; ++j) {
            bool is_closed = false;
            _complex.edge_ring_from(bad_cell, v[i], v[j], _ring_cells, _ring, is_closed);
            if (is_closed)
                is_done = attempt(_ring_cells, quality);
        }
    if (is_done)
        _point = none;
    return is_done;
}

/// Tries one set of cells to start from.
bool PointInsertion::attempt(const std::vector<Index> &seeds, const std::vector<double> &quality) {
    _cavity.clear();
    _walls.clear();
    _before = std::numeric_limits<double>::infinity();
    for (const Index c : seeds)
        take_in(c, quality);
    place_at_centre();
    double best = nothing;
    int vain_steps = 0;
    // Grow over facets that the point sees badly, placing it anew each time.
    while (_cavity.size() <= (_is_thorough ? largest_thorough_cavity : largest_cavity)) {
        fill_star();
        const double worst = optimise(first_step, _is_thorough ? fine_step : coarse_step);
        if (worst > _before + least_gain && is_valid()) {
            const Point start = place();
            optimise(coarse_step / 2.0, fine_step);
            if (!is_valid())
                place() = start;
            _fresh.clear();
            for (const Wall &w : _walls)
                _fresh.push_back(fresh_cell(w.facet, _point));
            _complex.replace(_cavity, _fresh);
            return true;
        }
        vain_steps = worst > best ? 0 : vain_steps + 1;
        best = std::max(best, worst);
        const int patience = _is_thorough ? most_thorough_vain_steps : most_vain_steps;
        const Index next = vain_steps < patience ? next_cell() : none;
        if (next == none)
            return false;
        take_in(next, quality);
    }
    return false;
}

bool PointInsertion::holds(Index cell) const {
    return std::find(_cavity.begin(), _cavity.end(), cell) != _cavity.end();
}

void PointInsertion::take_in(Index cell, const std::vector<double> &quality) {
    std::erase_if(_walls, [&](const Wall &w) { return w.beyond == cell; });
    _cavity.push_back(cell);
    for (int k = 0; k < 4; ++k) {
        const Index beyond = _complex.neighbour(cell, k);
        if (beyond == none || !holds(beyond))
            _walls.push_back({_complex.facet(cell, k), beyond});
    }
    _before = std::min(_before, quality[TetComplex::at(cell)]);
}

void PointInsertion::place_at_centre() {
    Point sum{};
    for (const Index c : _cavity)
        for (const Index v : _complex.cell(c))
            for (std::size_t i = 0; i < 3; ++i)
                sum[i] += _complex.points[TetComplex::at(v)][i];
    for (std::size_t i = 0; i < 3; ++i)
        place()[i] = sum[i] / (4.0 * static_cast<double>(_cavity.size()));
    _reach = 0.0;
}

void PointInsertion::fill_star() {
    for (const Wall &w : _walls)
        for (std::size_t i = 0; i < 3; ++i)
            _reach = std::max(
                _reach, std::abs(_complex.points[TetComplex::at(w.facet[0])][i] - place()[i]));
    _star.clear(_reach, _complex.wanted_altitude / quality_at_wanted_altitude);
    for (const Wall &w : _walls)
        _star.add(_complex, w.facet);
}

/// Pattern search for the place; the worst quality there.
double PointInsertion::optimise(double first, double last) {
    double best = _star.worst(place(), nothing);
    std::array<std::size_t, 6> culprits{}; // by direction
    for (double step = first * _reach; step > last * _reach; step *= 0.5)
        for (std::size_t axis = 0; axis < 3; ++axis)
            for (const std::size_t back : {0, 1}) {
                const double old = place()[axis];
                place()[axis] = old + (back == 0 ? step : -step);
                const double now = _star.worst(place(), best, culprits[2 * axis + back]);
                if (now > best)
                    best = now;
                else
                    place()[axis] = old;
            }
    return best;
}

/// The cell beyond the facet seen worst; none when all bad ones are outer facets.
Index PointInsertion::next_cell() {
    _star.list_qualities(place(), _qualities);
    double lowest = _before + least_gain;
    Index next = none;
    for (std::size_t i = 0; i < _walls.size(); ++i)
        if (_walls[i].beyond != none && _qualities[i] < std::max(lowest, 0.0)) {
            lowest = _qualities[i];
            next = _walls[i].beyond;
        }
    return next;
}

/// Every new cell is positive, and no corner of the old cells is lost: surface points have to stay.
bool PointInsertion::is_valid() const {
    for (const Wall &w : _walls)
        if (_complex.orientation(fresh_cell(w.facet, _point)) <= 0)
            return false;
    for (const Index c : _cavity)
        for (const Index v : _complex.cell(c))
            if (std::none_of(_walls.begin(), _walls.end(), [&](const Wall &w) {
                    return w.facet[0] == v || w.facet[1] == v || w.facet[2] == v;
                }))
                return false;
    return true;
}

} // namespace fastsim
