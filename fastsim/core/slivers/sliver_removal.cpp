#include "slivers/sliver_removal.hpp"

#include "slivers/point_insertion.hpp"
#include "slivers/star.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr double sliver_sine = 0.17364817766693033; // of 10 degrees
constexpr std::size_t largest_ring = 9, largest_last_ring = 13;
// At the end, cells below about 27 degrees, and no more of them than that.
constexpr double finishing_share = 0.84;
constexpr std::size_t most_finished = 200;
constexpr int finishing_passes = 6;
// A change must be worth it, or passes never end.
constexpr double least_flip_gain = 1e-6;
constexpr double least_move_gain = 1e-3;
// Points are inserted for the worst cells only: below about 27 degrees for a target of 33.
constexpr double insertion_share = 0.84;
// An insertion that failed mostly fails again, and is the dearest thing to try.
constexpr int most_refusals = 2;
// A pass that takes away less of what is wanting is the last but for hopeless cases.
constexpr double least_progress = 0.05;
// Steps of the search for a place, in parts of the longest edge at the point.
constexpr double first_step = 0.2, last_step = 0.01;
// Cells tried that cost as much as one tried insertion.
constexpr std::size_t work_of_insertion = 8;
// Cells tried for each cell that is bad at first: 4.2 to 5.9 on organs. And the part of it that is
// said to be done at most.
constexpr double work_per_bad_cell = 5.5, most_reached = 0.99;

class SliverRemoval {
  public:
    SliverRemoval(TetComplex &complex, Index num_fixed, CellRatings &ratings, double target,
                  SliverBudget budget, Watch &watch)
        : _complex(complex), _num_fixed(num_fixed), _target(target), _insertion(complex),
          _most_insertions(complex.num_slots() / 10),
          _most_work(
              budget.least +
              static_cast<std::size_t>(budget.per_cell * static_cast<double>(complex.num_slots()))),
          _watch(watch), _ratings(ratings), _quality(ratings.qualities) {
        _tried.assign(complex.num_slots(), 0);
        _refusals.assign(complex.num_slots(), 0);
        _changed.assign(complex.points.size(), 1);
        _unmoved.assign(complex.points.size(), 0);
    }

    /// Works on every bad cell once, the worst first; false when little was gained by the last
    /// pass, or nothing could be changed.
    bool pass(SliverReport &report) {
        std::vector<std::pair<double, Index>> bad;
        double wanting = 0.0;
        for (std::size_t slot = 0; slot < _complex.num_slots(); ++slot) {
            const auto c = static_cast<Index>(slot);
            const bool is_good = _quality[slot] >= _target;
            if ((is_good && _ratings.is_uneven[slot] == 0) || !_complex.is_alive(c))
                continue;
            if (is_good) {
                if (has_changed_since(c, _last_pass) && is_uneven(c) && has_news(c))
                    bad.emplace_back(_quality[slot], c);
                continue;
            }
            // Squared: the worst weigh most.
            wanting += (_target - _quality[slot]) * (_target - _quality[slot]);
            if (has_news(c))
                bad.emplace_back(_quality[slot], c);
        }
        if (wanting > (1.0 - least_progress) * _wanting)
            return false;
        if (_last_pass == 0)
            _expected_work = std::min(static_cast<double>(_most_work),
                                      work_per_bad_cell * static_cast<double>(bad.size()) + 1.0);
        _wanting = wanting;
        _last_pass = _turn;
        std::sort(bad.begin(), bad.end());
        std::size_t changes = 0;
        for (const auto &[quality, c] : bad) {
            if (report.work > _most_work) {
                report.is_cut_short = true;
                return false;
            }
            // Bad by its edges, or still as bad as it was.
            if (_complex.is_alive(c) && has_news(c) &&
                (quality_of(c) < _target || quality_of(c) == quality))
                changes += improve(c, report) ? 1 : 0;
        }
        return changes > 0;
    }

    /// Once more for the few worst cells, with more patience; false when nothing was changed.
    bool finish(SliverReport &report) {
        _insertion.be_thorough();
        _largest_ring = largest_last_ring;
        std::vector<std::pair<double, Index>> worst;
        for (std::size_t slot = 0; slot < _complex.num_slots(); ++slot)
            if (_complex.is_alive(static_cast<Index>(slot)) &&
                _quality[slot] < finishing_share * _target)
                worst.emplace_back(_quality[slot], static_cast<Index>(slot));
        const std::size_t count = std::min(worst.size(), most_finished);
        std::partial_sort(worst.begin(), worst.begin() + static_cast<std::ptrdiff_t>(count),
                          worst.end());
        std::size_t changes = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const Index c = worst[i].second;
            if (!_complex.is_alive(c) || quality_of(c) != worst[i].first)
                continue;
            _refusals[TetComplex::at(c)] = 0;
            changes += improve(c, report) ? 1 : 0;
        }
        return changes > 0;
    }

  private:
    double quality_of(Index c) const { return _quality[TetComplex::at(c)]; }

    /// Whether a cell is bad by its edges.
    bool is_uneven(Index c) {
        char &may_be = _ratings.is_uneven[TetComplex::at(c)];
        if (may_be != 0 && !is_edge_length_deviation_above(_complex, c, largest_deviation))
            may_be = 0;
        return may_be != 0;
    }

    /// Whether something near a cell has changed since it was worked on in vain.
    bool has_news(Index c) const { return has_changed_since(c, _tried[TetComplex::at(c)]); }

    bool has_changed_since(Index c, std::uint64_t turn) const {
        for (const Index v : _complex.cell(c))
            if (_changed[TetComplex::at(v)] > turn)
                return true;
        return false;
    }

    bool improve(Index c, SliverReport &report) {
        _watch.reach(std::min(static_cast<double>(report.work) / _expected_work, most_reached));
        ++report.work;
        if (flip_around(c)) {
            ++report.flips;
            return true;
        }
        bool has_moved = false;
        const Cell corners = _complex.cell(c);
        for (const Index v : corners)
            if (v >= _num_fixed && _changed[TetComplex::at(v)] > _unmoved[TetComplex::at(v)]) {
                if (move_point(v)) {
                    ++report.moves;
                    has_moved = true;
                } else {
                    _unmoved[TetComplex::at(v)] = _turn;
                }
            }
        if (has_moved)
            return true;
        if (quality_of(c) < insertion_share * _target && report.insertions < _most_insertions &&
            _refusals[TetComplex::at(c)] < most_refusals) {
            report.work += work_of_insertion;
            if (_insertion.insert_at(c, _quality)) {
                note_fresh_cells();
                ++report.insertions;
                return true;
            }
            ++_refusals[TetComplex::at(c)];
        }
        _tried[TetComplex::at(c)] = _turn;
        return false;
    }

    bool flip_around(Index c) {
        const Cell v = _complex.cell(c);
        // What lies around an edge or at a facet is as it was when it was tried in vain, unless
        // there is news at all of its corners. Larger rings are tried at the end alone.
        std::array<bool, 4> has_news_at{};
        for (std::size_t i = 0; i < 4; ++i)
            has_news_at[i] = _largest_ring != largest_ring ||
                             _changed[TetComplex::at(v[i])] > _tried[TetComplex::at(c)];
        bool is_closed = false;
        for (std::size_t i = 0; i < 4; ++i)
            for (std::size_t j = i + 1; j < 4; ++j) {
                if (!has_news_at[i] || !has_news_at[j])
                    continue;
                _complex.edge_ring_from(c, v[i], v[j], _cells, _ring, is_closed);
                if (!is_closed || _ring.size() > _largest_ring)
                    continue;
                double before = std::numeric_limits<double>::infinity();
                for (const Index around : _cells)
                    before = std::min(before, quality_of(around));
                if (retriangulate_ring(_complex, v[i], v[j], _cells, _ring,
                                       before + least_flip_gain, none, none)) {
                    note_fresh_cells();
                    return true;
                }
            }
        for (int k = 0; k < 4; ++k) {
            const Index n = _complex.neighbour(c, k);
            const bool is_old = std::ranges::any_of(cell_facets[TetComplex::at(k)], [&](int m) {
                return !has_news_at[TetComplex::at(m)];
            });
            if (n != none && !is_old &&
                flip_facet(_complex, {c, k}, _nothing_more,
                           std::min(quality_of(c), quality_of(n)) + least_flip_gain)) {
                note_fresh_cells();
                return true;
            }
        }
        return false;
    }

    /// Moves a point to make the worst cell around it better: to its neighbours' centre, then by a
    /// pattern of steps along the axes, halved until they are small.
    bool move_point(Index point) {
        _complex.cells_around(point, _cells);
        if (_cells.empty())
            return false;
        Point &place = _complex.points[TetComplex::at(point)];
        const Point start = place;
        double before = std::numeric_limits<double>::infinity();
        Point centre{};
        double count = 0.0, reach = 0.0;
        for (const Index c : _cells) {
            before = std::min(before, quality_of(c));
            for (const Index v : _complex.cell(c)) {
                if (v == point)
                    continue;
                double squared = 0.0;
                for (std::size_t i = 0; i < 3; ++i) {
                    const double x = _complex.points[TetComplex::at(v)][i];
                    centre[i] += x;
                    squared += (x - start[i]) * (x - start[i]);
                }
                reach = std::max(reach, squared);
                count += 1.0;
            }
        }
        reach = std::sqrt(reach);
        _star.clear(reach, _complex.wanted_altitude / quality_at_wanted_altitude);
        for (const Index c : _cells)
            _star.add(_complex, _complex.facet(c, _complex.corner_of(c, point)));
        double best = before;
        Point best_place = start;
        const auto try_place = [&](const Point &candidate, std::size_t &culprit) {
            const double worst = _star.worst(candidate, best, culprit);
            if (worst > best) {
                best = worst;
                best_place = candidate;
            }
        };
        std::array<std::size_t, 6> culprits{}; // by direction
        try_place({centre[0] / count, centre[1] / count, centre[2] / count}, culprits[0]);
        for (double step = first_step * reach; step > last_step * reach; step *= 0.5)
            for (std::size_t axis = 0; axis < 3; ++axis)
                for (const std::size_t back : {0, 1}) {
                    Point candidate = best_place;
                    candidate[axis] += back == 0 ? step : -step;
                    try_place(candidate, culprits[2 * axis + back]);
                }
        if (!(best > before + least_move_gain))
            return false;
        // Quality is rounded; positivity is asked of the exact predicate.
        place = best_place;
        if (!std::all_of(_cells.begin(), _cells.end(),
                         [&](Index c) { return _complex.orientation(_complex.cell(c)) > 0; })) {
            place = start;
            return false;
        }
        note(_cells);
        return true;
    }

    void note_fresh_cells() {
        _tried.resize(_complex.num_slots());
        _changed.resize(_complex.points.size());
        _unmoved.resize(_complex.points.size());
        _refusals.resize(_complex.num_slots());
        for (const Index c : _complex.fresh_cells())
            _tried[TetComplex::at(c)] = 0, _refusals[TetComplex::at(c)] = 0;
        note(_complex.fresh_cells());
    }

    void note(const std::vector<Index> &cells) {
        ++_turn;
        rate_cells(_complex, cells, _ratings);
        for (const Index c : cells) {
            for (const Index v : _complex.cell(c))
                _changed[TetComplex::at(v)] = _turn;
        }
    }

    TetComplex &_complex;
    Index _num_fixed;
    double _target;
    PointInsertion _insertion;
    // Bounds the work and the growth of the mesh.
    std::size_t _most_insertions;
    std::size_t _most_work;
    Watch &_watch;
    CellRatings &_ratings;
    const std::vector<double> &_quality; // by slot
    std::vector<std::uint64_t> _tried;   // by slot: turn at which work on it was in vain
    std::vector<int> _refusals;          // by slot: insertions tried in vain
    std::vector<std::uint64_t> _changed; // by point: turn of the last change of a cell at it
    std::vector<std::uint64_t> _unmoved; // by point: turn at which a move of it was in vain
    std::uint64_t _turn = 1;
    std::uint64_t _last_pass = 0; // turn at which the last pass began
    double _expected_work = 1.0;
    double _wanting = std::numeric_limits<double>::infinity();
    std::size_t _largest_ring = largest_ring;
    std::vector<Index> _cells, _ring;
    Star _star;
    const Protection _nothing_more; // outer edges and facets have no ring or neighbour to flip
};

} // namespace

SliverReport remove_slivers(TetComplex &complex, Index num_fixed, CellRatings &ratings,
                            double target, int max_passes, SliverBudget budget, Watch &watch) {
    SliverReport report;
    SliverRemoval removal(complex, num_fixed, ratings, target, budget, watch);
    for (int pass = 0; pass < max_passes && removal.pass(report); ++pass) {
    }
    for (int pass = 0; pass < finishing_passes && max_passes > 0 && removal.finish(report);
         ++pass) {
    }
    return report;
}

std::size_t count_slivers(const TetComplex &complex, std::span<const double> sines) {
    std::size_t count = 0;
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot)
        if (complex.is_alive(static_cast<Index>(slot)) && sines[slot] < sliver_sine)
            ++count;
    return count;
}

} // namespace fastsim
