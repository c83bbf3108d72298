#include "condensed/response_columns.hpp"

#include "slivers/wide.hpp"

#include <algorithm>

namespace fastsim {

namespace {

// Columns that are kept: what several tools touch at a time, and touched a little before.
constexpr std::size_t most_slots = 64;
// Numbers of a sum that are made at a time, so that they stay in the nearest cache.
constexpr std::size_t stretch = 1024;

/// sum = the columns times their factors, over one stretch.
template <typename Real>
[[gnu::always_inline]] inline void add_up(std::span<const Real *const> columns,
                                          std::span<const double> factors, std::size_t begin,
                                          std::size_t count, double *sum) {
    std::fill_n(sum, count, 0.0);
    std::size_t k = 0;
    for (; k + 4 <= columns.size(); k += 4) {
        const Real *a = columns[k] + begin, *b = columns[k + 1] + begin;
        const Real *c = columns[k + 2] + begin, *d = columns[k + 3] + begin;
        const double fa = factors[k], fb = factors[k + 1], fc = factors[k + 2], fd = factors[k + 3];
        for (std::size_t i = 0; i < count; ++i)
            sum[i] += (fa * static_cast<double>(a[i]) + fb * static_cast<double>(b[i])) +
                      (fc * static_cast<double>(c[i]) + fd * static_cast<double>(d[i]));
    }
    for (; k < columns.size(); ++k) {
        const Real *a = columns[k] + begin;
        for (std::size_t i = 0; i < count; ++i)
            sum[i] += factors[k] * static_cast<double>(a[i]);
    }
}

PALPATE_WIDE void combine(std::span<const double *const> columns, std::span<const double> factors,
                          std::size_t begin, std::size_t count, double *sum) {
    add_up(columns, factors, begin, count, sum);
}
PALPATE_WIDE void combine(std::span<const float *const> columns, std::span<const double> factors,
                          std::size_t begin, std::size_t count, double *sum) {
    add_up(columns, factors, begin, count, sum);
}

} // namespace

template <typename Real>
ResponseColumns<Real>::ResponseColumns(const Compliance &compliance)
    : _compliance(compliance), _slot_of(compliance.num_touched(), -1) {}

template <typename Real>
void ResponseColumns<Real>::respond(std::span<const Point> forces, std::span<const std::int32_t> at,
                                    std::span<Point> seen) {
    ++_now;
    _columns.clear();
    _factors.clear();
    const std::size_t size = 3 * seen.size();
    for (const std::int32_t point : at) {
        const Point &force = forces[static_cast<std::size_t>(point)];
        if (force == Point{})
            continue;
        const Real *numbers = column(point);
        for (std::size_t b = 0; b < 3; ++b) {
            _columns.push_back(numbers + b * size);
            _factors.push_back(force[b]);
        }
    }
    double *sum = seen.empty() ? nullptr : seen[0].data();
    for (std::size_t begin = 0; begin < size; begin += stretch)
        combine(_columns, _factors, begin, std::min(stretch, size - begin), sum + begin);
}

/// Of a touched point, gathered now where it is not there; the one not used for longest goes.
template <typename Real> const Real *ResponseColumns<Real>::column(std::int32_t point) {
    std::int32_t &number = _slot_of[static_cast<std::size_t>(point)];
    if (number < 0) {
        const auto oldest = std::ranges::min_element(_slots, {}, &Slot::used);
        std::size_t place = _slots.size();
        if (_slots.size() >= most_slots && oldest->used < _now)
            place = static_cast<std::size_t>(oldest - _slots.begin());
        else
            _slots.emplace_back();
        Slot &slot = _slots[place];
        if (slot.point >= 0)
            _slot_of[static_cast<std::size_t>(slot.point)] = -1;
        slot.point = point;
        slot.numbers.resize(9 * _compliance.num_seen());
        _compliance.gather_column<Real>(static_cast<std::size_t>(point), slot.numbers);
        number = static_cast<std::int32_t>(place);
    }
    Slot &slot = _slots[static_cast<std::size_t>(number)];
    slot.used = _now;
    return slot.numbers.data();
}

template class ResponseColumns<float>;
template class ResponseColumns<double>;

} // namespace fastsim
