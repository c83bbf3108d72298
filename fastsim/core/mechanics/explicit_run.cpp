#include "mechanics/explicit_run.hpp"

#include "mechanics/renumber.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numeric>
#include <thread>

namespace fastsim {

namespace {

/// All threads wait here for the last one; spins, since a step lasts less than a millisecond.
class Barrier {
  public:
    explicit Barrier(std::size_t num_threads) : _num_threads(num_threads) {}

    void wait() {
        if (_num_threads == 1)
            return;
        const std::size_t round = _round.load(std::memory_order_relaxed);
        if (_arrived.fetch_add(1, std::memory_order_acq_rel) + 1 == _num_threads) {
            _arrived.store(0, std::memory_order_relaxed);
            _round.store(round + 1, std::memory_order_release);
            return;
        }
        for (int spins = 0; _round.load(std::memory_order_acquire) == round; ++spins)
            if (spins > 20000)
                std::this_thread::yield(); // more threads than processors
    }

  private:
    std::size_t _num_threads;
    alignas(64) std::atomic<std::size_t> _arrived{0};
    alignas(64) std::atomic<std::size_t> _round{0};
};

} // namespace

template <typename Real>
ExplicitRun<Real>::ExplicitRun(std::span<const double> points, std::span<const Index> cells,
                               std::span<const double> lumped_mass,
                               std::span<const std::uint8_t> is_free,
                               const ExplicitSettings &settings)
    : _settings(settings), _kernel(choose_kernel<Real>(settings.at_most)),
      _num_points(points.size() / 3), _record_of(_num_points) {
    const std::vector<Index> order = reverse_cuthill_mckee(_num_points, cells);
    for (std::size_t k = 0; k < order.size(); ++k)
        _record_of[static_cast<std::size_t>(order[k])] = k;
    // One more record than points: the corners of the cells that fill up the last batch.
    for (auto *array : {&_displacement, &_increment, &_external, &_mobility})
        array->assign(4 * (_num_points + 1), Real(0));
    _mass.assign(_num_points, 0.0);
    for (std::size_t i = 0; i < _num_points; ++i)
        _mass[_record_of[i]] = lumped_mass[i];
    _points.assign(4 * _num_points, Real(0));
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            _points[4 * _record_of[i] + j] = static_cast<Real>(points[3 * i + j]);
    const double half_damping = 0.5 * settings.mass_damping * settings.time_step;
    _keep = static_cast<Real>((1.0 - half_damping) / (1.0 + half_damping));
    _limit = static_cast<Real>(settings.displacement_limit);
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            if (is_free[3 * i + j] != 0)
                _mobility[4 * _record_of[i] + j] =
                    static_cast<Real>(settings.time_step * settings.time_step /
                                      (lumped_mass[i] * (1.0 + half_damping)));
    lay_out_cells(points, cells);
    share_out();
}

template <typename Real>
void ExplicitRun<Real>::lay_out_cells(std::span<const double> points,
                                      std::span<const Index> cells) {
    const std::size_t num_cells = cells.size() / 4;
    const std::size_t width = _kernel.width;
    const RestCells rest = make_rest_cells(points, cells);
    std::vector<std::size_t> first(num_cells), sorted(num_cells);
    for (std::size_t c = 0; c < num_cells; ++c) {
        std::size_t sum = 0;
        for (std::size_t a = 0; a < 4; ++a)
            sum += _record_of[static_cast<std::size_t>(cells[4 * c + a])];
        first[c] = sum;
    }
    std::iota(sorted.begin(), sorted.end(), std::size_t{0});
    std::stable_sort(sorted.begin(), sorted.end(),
                     [&](std::size_t a, std::size_t b) { return first[a] < first[b]; });
    _num_batches = (num_cells + width - 1) / width;
    _records.assign(4 * width * _num_batches, static_cast<std::int32_t>(4 * _num_points));
    _rest.assign(10 * width * _num_batches, Real(0));
    for (std::size_t k = 0; k < num_cells; ++k) {
        const std::size_t c = sorted[k], batch = k / width, lane = k % width;
        for (std::size_t a = 0; a < 4; ++a)
            _records[(4 * batch + a) * width + lane] = static_cast<std::int32_t>(
                4 * _record_of[static_cast<std::size_t>(cells[4 * c + a])]);
        for (std::size_t e = 0; e < 9; ++e)
            _rest[(10 * batch + e) * width + lane] = static_cast<Real>(rest.gradients[c][e]);
        _rest[(10 * batch + 9) * width + lane] = static_cast<Real>(rest.volumes[c]);
    }
}

template <typename Real> void ExplicitRun<Real>::share_out() {
    const std::size_t num_threads =
        std::max<std::size_t>(1, std::min(_settings.num_threads, _num_batches));
    const std::size_t per_batch = 4 * _kernel.width;
    _shares.resize(num_threads);
    for (std::size_t t = 0; t < num_threads; ++t) {
        Share &share = _shares[t];
        share.first_batch = _num_batches * t / num_threads;
        share.last_batch = _num_batches * (t + 1) / num_threads;
        const auto begin =
            _records.begin() + static_cast<std::ptrdiff_t>(per_batch * share.first_batch);
        const auto end =
            _records.begin() + static_cast<std::ptrdiff_t>(per_batch * share.last_batch);
        share.first_touched = _num_points;
        share.last_touched = 0;
        for (auto it = begin; it != end; ++it) {
            const auto point = static_cast<std::size_t>(*it) / 4;
            if (point == _num_points)
                continue;
            share.first_touched = std::min(share.first_touched, point);
            share.last_touched = std::max(share.last_touched, point + 1);
        }
        share.force.assign(4 * (_num_points + 1), Real(0));
        share.first_owned = _num_points * t / num_threads;
        share.last_owned = _num_points * (t + 1) / num_threads;
    }
}

template <typename Real>
void ExplicitRun<Real>::set_state(std::span<const double> displacement,
                                  std::span<const double> increment) {
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            const std::size_t at = 4 * _record_of[i] + j;
            _displacement[at] = static_cast<Real>(displacement[3 * i + j]);
            // A held component does not move, whatever its start-up value says.
            _increment[at] =
                _mobility[at] > Real(0) ? static_cast<Real>(increment[3 * i + j]) : Real(0);
        }
}

template <typename Real>
void ExplicitRun<Real>::get_state(std::span<double> displacement,
                                  std::span<double> increment) const {
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            const std::size_t at = 4 * _record_of[i] + j;
            displacement[3 * i + j] = static_cast<double>(_displacement[at]);
            increment[3 * i + j] = static_cast<double>(_increment[at]);
        }
}

template <typename Real> void ExplicitRun<Real>::set_external_force(std::span<const double> force) {
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            _external[4 * _record_of[i] + j] = static_cast<Real>(force[3 * i + j]);
}

template <typename Real>
void ExplicitRun<Real>::set_pressure(std::span<const Index> facets,
                                     std::span<const double> pressures) {
    _pressed.clear();
    _pressures.clear();
    for (const Index i : facets)
        _pressed.push_back(4 * _record_of[static_cast<std::size_t>(i)]);
    for (const double p : pressures)
        _pressures.push_back(static_cast<Real>(p));
}

template <typename Real> void ExplicitRun<Real>::add_pressure(Real amplitude) {
    Real *const total = _shares[0].force.data();
    for (std::size_t t = 0; t < _pressures.size(); ++t) {
        const std::size_t *corner = &_pressed[3 * t];
        std::array<Real, 3> p{}, q{};
        for (std::size_t j = 0; j < 3; ++j) {
            // Rest edges and displacement differences apart: a small motion keeps its digits.
            p[j] = (_points[corner[1] + j] - _points[corner[0] + j]) +
                   (_displacement[corner[1] + j] - _displacement[corner[0] + j]);
            q[j] = (_points[corner[2] + j] - _points[corner[0] + j]) +
                   (_displacement[corner[2] + j] - _displacement[corner[0] + j]);
        }
        const Real share = amplitude * _pressures[t] / Real(6);
        const std::array<Real, 3> outward{p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2],
                                          p[0] * q[1] - p[1] * q[0]};
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t j = 0; j < 3; ++j)
                total[corner[k] + j] += share * outward[j];
    }
}

template <typename Real> void ExplicitRun<Real>::track(std::size_t thread, Real amplitude) {
    Share &share = _shares[thread];
    const auto sum_of = [&](std::size_t i) {
        // d + d_next, before the update: d_next from eq. 12.
        const Real next =
            _keep * _increment[i] + _mobility[i] * (amplitude * _external[i] - _shares[0].force[i]);
        return static_cast<double>(_increment[i]) + static_cast<double>(next);
    };
    const double rate = _settings.mass_damping / (4.0 * _settings.time_step);
    for (std::size_t point = share.first_owned; point < share.last_owned; ++point)
        for (std::size_t i = 4 * point; i < 4 * point + 3; ++i) {
            const double sum = sum_of(i);
            share.work += 0.5 * static_cast<double>(amplitude * _external[i]) * sum;
            share.loss += rate * _mass[point] * sum * sum;
        }
}

template <typename Real> double ExplicitRun<Real>::external_work() const {
    double sum = 0.0;
    for (const Share &share : _shares)
        sum += share.work;
    return sum;
}

template <typename Real> double ExplicitRun<Real>::damping_loss() const {
    double sum = 0.0;
    for (const Share &share : _shares)
        sum += share.loss;
    return sum;
}

template <typename Real> ForceJob<Real> ExplicitRun<Real>::job_of(Share &share) const {
    return {_displacement.data(),
            share.force.data(),
            _records.data(),
            _rest.data(),
            share.first_batch,
            share.last_batch,
            static_cast<Real>(_settings.lame.lmbda),
            static_cast<Real>(_settings.lame.mu),
            _settings.strain == StrainMeasure::green};
}

template <typename Real> bool ExplicitRun<Real>::update(std::size_t thread, Real amplitude) {
    const std::size_t begin = _shares[thread].first_owned, end = _shares[thread].last_owned;
    Real *total = _shares[0].force.data();
    for (std::size_t t = 1; t < _shares.size(); ++t) {
        Share &other = _shares[t];
        Real *part = other.force.data();
        const std::size_t last = 4 * std::min(end, other.last_touched);
        for (std::size_t i = 4 * std::max(begin, other.first_touched); i < last; ++i) {
            total[i] += part[i];
            part[i] = Real(0);
        }
    }
    if (_settings.tracks_energy)
        track(thread, amplitude);
    Real *const u = _displacement.data();
    Real *const d = _increment.data();
    const Real *const external = _external.data();
    const Real *const mobility = _mobility.data();
    const Real keep = _keep;
    Real out = Real(0);
    for (std::size_t i = 4 * begin; i < 4 * end; ++i) {
        const Real increment = keep * d[i] + mobility[i] * (amplitude * external[i] - total[i]);
        const Real next = u[i] + increment;
        total[i] = Real(0);
        d[i] = increment;
        u[i] = next;
        // NaN counts as out of bounds: the comparison is false for it.
        out += std::abs(next) <= _limit ? Real(0) : Real(1);
    }
    return out == Real(0);
}

template <typename Real>
ExplicitOutcome ExplicitRun<Real>::advance(std::span<const double> amplitudes) {
    const std::size_t num_threads = _shares.size();
    Barrier barrier(num_threads);
    // Two slots for each thread, used in turn: a fast thread never overwrites what is being read.
    struct alignas(64) Flags {
        std::array<StopReason, 2> reason{};
    };
    std::vector<Flags> flags(num_threads), late(num_threads);
    const auto any = [&](const std::vector<Flags> &all, std::size_t slot) {
        for (const Flags &flag : all)
            if (flag.reason[slot] != StopReason::none)
                return flag.reason[slot];
        return StopReason::none;
    };
    ExplicitOutcome outcome{static_cast<std::int64_t>(amplitudes.size()), StopReason::none};
    const auto work = [&](std::size_t thread) {
        const ForceJob<Real> job = job_of(_shares[thread]);
        for (std::size_t step = 0; step < amplitudes.size(); ++step) {
            const std::size_t slot = step % 2;
            const Real smallest = _kernel.add_forces(job);
            flags[thread].reason[slot] =
                smallest > Real(0) ? StopReason::none : StopReason::inverted_cell;
            if (thread == 0)
                add_pressure(static_cast<Real>(amplitudes[step]));
            barrier.wait();
            StopReason reason = any(flags, slot);
            if (reason == StopReason::none) {
                const bool is_good = update(thread, static_cast<Real>(amplitudes[step]));
                late[thread].reason[slot] = is_good ? StopReason::none : StopReason::out_of_bounds;
                barrier.wait();
                reason = any(late, slot);
            }
            if (reason != StopReason::none) {
                if (thread == 0)
                    outcome = {static_cast<std::int64_t>(step), reason};
                return;
            }
        }
    };
    std::vector<std::thread> others;
    for (std::size_t t = 1; t < num_threads; ++t)
        others.emplace_back(work, t);
    work(0);
    for (std::thread &other : others)
        other.join();
    if (outcome.reason != StopReason::none) {
        // Back by one increment: the state before the one that was found bad.
        for (std::size_t i = 0; i < _displacement.size(); ++i)
            _displacement[i] -= _increment[i];
        for (Share &share : _shares)
            std::fill(share.force.begin(), share.force.end(), Real(0));
    }
    return outcome;
}

template <typename Real> void ExplicitRun<Real>::internal_force(std::span<double> force) {
    for (Share &share : _shares)
        static_cast<void>(_kernel.add_forces(job_of(share)));
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            Real sum = Real(0);
            for (const Share &share : _shares)
                sum += share.force[4 * _record_of[i] + j];
            force[3 * i + j] = static_cast<double>(sum);
        }
    for (Share &share : _shares)
        std::fill(share.force.begin(), share.force.end(), Real(0));
}

template class ExplicitRun<float>;
template class ExplicitRun<double>;

} // namespace fastsim
