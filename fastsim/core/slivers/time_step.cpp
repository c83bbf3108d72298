#include "slivers/time_step.hpp"

#include "slivers/cell_step.hpp"
#include "slivers/star.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>

namespace fastsim {

namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();
// Cells are worked on up to as many times the shortest step, and up to this part of the bound.
constexpr double band = 1.1, share_of_bound = 0.985;
constexpr int most_passes = 30;
// Passes that do not lengthen the shortest step by this part are in vain; as many end the work.
constexpr double least_progress = 5e-3;
constexpr int most_vain_passes = 3;
// Cells tried at most: so many, and one of so many of the mesh. A few per cent of the mesher's
// time.
constexpr std::size_t least_work = 500, cells_for_work = 250;
constexpr double least_gain = 1e-3;
// Steps of the search for a place, in parts of the longest edge at the point.
constexpr double first_step = 0.25, last_step = 0.008;
// An angle may fall to this part of its sine at a time, but not below 15 degrees, nor below the
// smallest of the mesh.
constexpr double share_of_sine = 0.9, small_sine = 0.2588190451025207;
// Of what is flat.
constexpr double flat_sine = 1e-12;
constexpr std::size_t largest_ring = 12;

// Ways to go from a place: along the axes, and the diagonals of a cube and of its sides.
constexpr std::array<Point, 26> ways = [] {
    std::array<Point, 26> result{};
    for (std::size_t n = 0; n < 26; ++n) {
        const int number = static_cast<int>(n < 13 ? n : n + 1);
        result[n] = {number % 3 - 1.0, number / 3 % 3 - 1.0, number / 9 - 1.0};
    }
    return result;
}();

class TimeStep {
  public:
    TimeStep(TetComplex &complex, Index num_fixed, CellRatings &ratings, double least_sine)
        : _complex(complex), _num_fixed(num_fixed),
          _most_work(least_work + complex.num_slots() / cells_for_work), _least_sine(least_sine),
          _ratings(ratings), _steps(ratings.steps) {
        for (std::size_t slot = 0; slot < _steps.size(); ++slot)
            if (complex.is_alive(static_cast<Index>(slot)))
                _smallest_sine = std::min(_smallest_sine, ratings.sines[slot]);
            else
                _steps[slot] = infinite;
        _tried.assign(_steps.size(), 0);
        _changed.assign(complex.points.size(), 1);
        _unmoved.assign(complex.points.size(), 0);
        _unremoved.assign(complex.points.size(), 0);
        _bound = share_of_bound * boundary_bound();
    }
    ~TimeStep() { _complex.least_sine = 0.0; }
    TimeStep(const TimeStep &) = delete;
    TimeStep &operator=(const TimeStep &) = delete;

    void run(Watch &watch) {
        double reached = 0.0;
        int vain = 0;
        for (int pass = 0; pass < most_passes && vain < most_vain_passes; ++pass) {
            watch.look();
            const double shortest = *std::min_element(_steps.begin(), _steps.end());
            vain = shortest > (1.0 + least_progress) * reached ? 0 : vain + 1;
            reached = std::max(reached, shortest);
            if (shortest >= _bound || !work_below(std::min(_bound, band * shortest)))
                break;
        }
    }

  private:
    double step_of(Index c) const { return _steps[TetComplex::at(c)]; }

    /// The longest step that a cell on the thinnest facet can have.
    double boundary_bound() const {
        double bound = infinite;
        for (std::size_t slot = 0; slot < _steps.size(); ++slot) {
            const auto c = static_cast<Index>(slot);
            for (int k = 0; _complex.is_alive(c) && k < 4; ++k)
                if (_complex.neighbour(c, k) == none)
                    bound = std::min(bound, facet_step(_complex, _complex.facet(c, k)));
        }
        return bound;
    }

    /// Works on all cells of a shorter step, the worst first; false when nothing was changed.
    bool work_below(double limit) {
        _limit = limit;
        _bad = {};
        for (std::size_t slot = 0; slot < _steps.size(); ++slot)
            if (_steps[slot] < limit && has_news(static_cast<Index>(slot)))
                _bad.emplace(_steps[slot], static_cast<Index>(slot));
        bool has_changed = false;
        while (!_bad.empty() && _work < _most_work) {
            const auto [step, c] = _bad.top();
            _bad.pop();
            if (step_of(c) != step || !has_news(c))
                continue;
            ++_work;
            if (improve(c))
                has_changed = true;
            else
                _tried[TetComplex::at(c)] = _turn;
        }
        return has_changed && _work < _most_work;
    }

    bool has_news(Index c) const {
        for (const Index v : _complex.cell(c))
            if (_changed[TetComplex::at(v)] > _tried[TetComplex::at(c)])
                return true;
        return false;
    }

    bool improve(Index c) {
        const Cell corners = _complex.cell(c);
        const auto any_inner = [&](std::vector<std::uint64_t> &in_vain, auto &&change) {
            for (const Index v : corners) {
                std::uint64_t &last = in_vain[TetComplex::at(v)];
                if (v < _num_fixed || _changed[TetComplex::at(v)] <= last)
                    continue;
                if (change(v))
                    return true;
                last = _turn;
            }
            return false;
        };
        return any_inner(_unmoved, [&](Index v) { return move_point(v); }) || flip_around(c) ||
               any_inner(_unremoved, [&](Index v) { return remove_point(v); });
    }

    /// Shortest step of cells that are to change. Their new ones have to keep the smallest sine.
    double bar_of(const std::vector<Index> &cells) {
        double shortest = infinite, sine = infinite;
        for (const Index c : cells) {
            shortest = std::min(shortest, step_of(c));
            sine = std::min(sine, _ratings.sines[TetComplex::at(c)]);
        }
        // Small angles stay as they are, and none gets smaller than that.
        const double small = std::max(small_sine, std::min(_smallest_sine, _least_sine));
        const double floor = std::max(small, share_of_sine * std::min(sine, _least_sine));
        _complex.least_sine = std::max(flat_sine, std::min({sine, _least_sine, floor}));
        return (1.0 + least_gain) * shortest;
    }

    bool flip_around(Index c) {
        const Cell v = _complex.cell(c);
        bool is_closed = false;
        for (std::size_t i = 0; i < 4; ++i)
            for (std::size_t j = i + 1; j < 4; ++j) {
                _complex.edge_ring_from(c, v[i], v[j], _cells, _ring, is_closed);
                if (is_closed && _ring.size() <= largest_ring &&
                    retriangulate_ring(_complex, v[i], v[j], _cells, _ring, bar_of(_cells), none,
                                       none)) {
                    note(_complex.fresh_cells());
                    return true;
                }
            }
        for (int k = 0; k < 4; ++k) {
            const Index n = _complex.neighbour(c, k);
            if (n == none)
                continue;
            _cells = {c, n};
            if (flip_facet(_complex, {c, k}, _nothing_more, bar_of(_cells))) {
                note(_complex.fresh_cells());
                return true;
            }
        }
        return false;
    }

    bool move_point(Index point) {
        take_star(point);
        Point &place = _complex.points[TetComplex::at(point)];
        const Point start = place;
        const double bar = bar_of(_cells);
        double reach = 0.0;
        for (const Triple &f : _facets)
            for (std::size_t i = 0; i < 3; ++i)
                reach =
                    std::max(reach, std::abs(_complex.points[TetComplex::at(f[0])][i] - start[i]));
        fill_star(reach, none);
        double best = bar;
        Point best_place = start;
        std::array<std::size_t, ways.size()> culprits{}; // by direction
        for (double step = first_step * reach; step > last_step * reach; step *= 0.5)
            for (std::size_t way = 0; way < ways.size(); ++way) {
                Point candidate = best_place;
                for (std::size_t i = 0; i < 3; ++i)
                    candidate[i] += step * ways[way][i];
                if (is_longer(candidate, best, culprits[way]))
                    best_place = candidate;
            }
        if (!(best > bar))
            return false;
        // Steps are rounded; positivity is asked of the exact predicate.
        place = best_place;
        if (!std::all_of(_cells.begin(), _cells.end(),
                         [&](Index c) { return _complex.orientation(_complex.cell(c)) > 0; })) {
            place = start;
            return false;
        }
        note(_cells);
        return true;
    }

    /// The star's facets, without those at one point of it.
    void fill_star(double reach, Index without) {
        _star.clear(reach, 0.0);
        for (const Triple &f : _facets)
            if (f[0] != without && f[1] != without && f[2] != without)
                _star.add(_complex, f);
    }

    /// Whether the star's cells at a place have longer steps than `best`, which is raised to them,
    /// and their angles.
    bool is_longer(const Point &place, double &best, std::size_t &culprit) {
        const double shortest = _star.shortest_step(place, best, culprit);
        if (!(shortest > best) || !(_star.worst(place, _complex.least_sine) > _complex.least_sine))
            return false;
        best = shortest;
        return true;
    }

    /// Cells around a point, and the facets opposite.
    void take_star(Index point) {
        _complex.cells_around(point, _cells);
        _facets.clear();
        for (const Index c : _cells)
            _facets.push_back(_complex.facet(c, _complex.corner_of(c, point)));
    }

    /// Draws an inner point into the neighbour that makes the best cells of those around it.
    bool remove_point(Index point) {
        take_star(point);
        const double bar = bar_of(_cells);
        _near.clear();
        for (const Triple &f : _facets)
            _near.insert(_near.end(), f.begin(), f.end());
        std::sort(_near.begin(), _near.end());
        _near.erase(std::unique(_near.begin(), _near.end()), _near.end());
        double best = bar;
        Index into = none;
        for (const Index v : _near) {
            fill_star(bar, v);
            std::size_t culprit = 0;
            if (is_longer(_complex.points[TetComplex::at(v)], best, culprit))
                into = v;
        }
        if (into == none)
            return false;
        _fresh.clear();
        for (const Triple &f : _facets)
            if (f[0] != into && f[1] != into && f[2] != into)
                _fresh.push_back({f[1], f[0], f[2], into});
        if (!std::all_of(_fresh.begin(), _fresh.end(),
                         [&](const Cell &c) { return _complex.orientation(c) > 0; }))
            return false;
        _complex.replace(_cells, _fresh);
        note(_complex.fresh_cells());
        return true;
    }

    void note(const std::vector<Index> &cells) {
        ++_turn;
        rate_cells(_complex, cells, _ratings);
        _tried.resize(_complex.num_slots(), 0);
        for (const Index c : cells) {
            if (step_of(c) < _limit)
                _bad.emplace(step_of(c), c);
            for (const Index v : _complex.cell(c))
                _changed[TetComplex::at(v)] = _turn;
        }
        for (const Index c : _cells)
            if (!_complex.is_alive(c))
                _steps[TetComplex::at(c)] = infinite;
    }

    TetComplex &_complex;
    Index _num_fixed;
    std::size_t _work = 0, _most_work;
    // The worst on top; also those that are gone or have changed since.
    using Rated = std::pair<double, Index>;
    std::priority_queue<Rated, std::vector<Rated>, std::greater<>> _bad;
    double _limit = 0.0;
    double _least_sine, _smallest_sine = infinite, _bound = 0.0;
    CellRatings &_ratings;
    std::vector<double> &_steps;         // by slot; infinite where no cell lives
    std::vector<std::uint64_t> _tried;   // by slot: turn at which work on it was in vain
    std::vector<std::uint64_t> _changed; // by point: turn of the last change of a cell at it
    std::vector<std::uint64_t> _unmoved, _unremoved; // by point: turn at which that was in vain
    std::uint64_t _turn = 1;
    Star _star;
    std::vector<Index> _cells, _ring, _near;
    std::vector<Triple> _facets;
    std::vector<Cell> _fresh;
    const Protection _nothing_more; // outer edges and facets have no ring or neighbour to flip
};

} // namespace

void lengthen_time_step(TetComplex &complex, Index num_fixed, CellRatings &ratings,
                        double least_sine, Watch &watch) {
    if (complex.num_slots() > 0)
        TimeStep(complex, num_fixed, ratings, least_sine).run(watch);
}

} // namespace fastsim
