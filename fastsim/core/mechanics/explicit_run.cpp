#include "mechanics/explicit_run.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
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

template <typename Real> void ExplicitRun<Real>::add_pressure(std::span<const double> factors) {
    Real *const total = _shares[0].force.data();
    Real *const pressed = _pressure_force.data();
    double work = 0.0;
    for (const std::size_t i : _pressed_entries) {
        // What pushes a moving support passes straight through it.
        if (_is_free[i] != 0)
            work += static_cast<double>(pressed[i]) * static_cast<double>(_increment[i]);
        pressed[i] = Real(0);
    }
    // Not into what was given: the other threads may still be reading that.
    _shares[0].pressure_work += std::abs(work);
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
        const double factor = factors[static_cast<std::size_t>(_pressure_histories[t])];
        const Real share = static_cast<Real>(factor * _pressures[t] / 6.0);
        const std::array<Real, 3> outward{p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2],
                                          p[0] * q[1] - p[1] * q[0]};
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t j = 0; j < 3; ++j)
                pressed[corner[k] + j] -= share * outward[j];
    }
    for (const std::size_t i : _pressed_entries)
        total[i] -= pressed[i];
}

/// Is the dead load another one than a step before, and by more than the watch's guess can bear?
template <typename Real>
std::pair<bool, bool> ExplicitRun<Real>::load_change(std::span<const double> before,
                                                     std::span<const double> now) const {
    bool is_new = false, is_jump = false;
    for (const std::size_t k : _loaded) {
        is_new = is_new || before[k] != now[k];
        const double size = std::max(std::abs(before[k]), std::abs(now[k]));
        is_jump = is_jump || std::abs(now[k] - before[k]) > 0.05 * size;
    }
    return {is_new, is_jump};
}

template <typename Real>
void ExplicitRun<Real>::combine_dead_loads(Share &share, std::span<const double> factors) {
    const std::size_t begin = 4 * share.first_owned, end = 4 * share.last_owned;
    if (_loaded.size() == 1) {
        const double factor = factors[_loaded[0]];
        const double *const load = _dead_loads[_loaded[0]].data();
        Real *const external = _external.data();
        for (std::size_t i = begin; i < end; ++i)
            external[i] = static_cast<Real>(factor * load[i]);
        return;
    }
    for (std::size_t i = begin; i < end; ++i) {
        double sum = 0.0;
        for (const std::size_t k : _loaded)
            sum += factors[k] * _dead_loads[k][i];
        _external[i] = static_cast<Real>(sum);
    }
}

/// What holds each moving support on its way: inner forces, inertia and damping.
template <typename Real> void ExplicitRun<Real>::pull_supports(Share &share, const Step &step) {
    const Real *const total = _shares[0].force.data();
    const double dt = _settings.time_step, damping = _settings.mass_damping;
    double work = 0.0;
    for (MovingSupport &support : share.moving) {
        const std::size_t i = support.entry;
        support.next = (step.next[support.history] - step.now[support.history]) * support.value;
        // It moved before the start as it does after: no blow at the first step.
        if (!_has_begun)
            _increment[i] = static_cast<Real>(support.next);
        const double last = static_cast<double>(_increment[i]);
        const double inertia =
            (support.next - last) / (dt * dt) + damping * (support.next + last) / (2.0 * dt);
        // Dead loads on it pass straight through to the support.
        double inner = static_cast<double>(total[i]);
        if (!_pressure_force.empty())
            inner += static_cast<double>(_pressure_force[i]);
        if (!_body_force.empty())
            inner += static_cast<double>(_body_force[i]);
        support.pull = inner + support.mass * inertia;
        // The watch looks at the free points alone: what moves the support's own mass is not
        // theirs.
        work += 0.5 * inner * (support.next + last);
    }
    share.given += std::abs(work);
}

template <typename Real> void ExplicitRun<Real>::move_supports(Share &share, const Step &step) {
    for (const MovingSupport &support : share.moving) {
        _displacement[support.entry] =
            static_cast<Real>(step.next[support.history] * support.value);
        _increment[support.entry] = static_cast<Real>(support.next);
    }
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

/// All that acts on the points of a thread, when every thread has added the forces of its cells.
template <typename Real> void ExplicitRun<Real>::gather_forces(Share &share, const Step &step) {
    const std::size_t begin = share.first_owned, end = share.last_owned;
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
    if (step.is_jump)
        close_window(share);
    if (step.is_new_load)
        combine_dead_loads(share, step.now);
    pull_supports(share, step);
}

template <typename Real> bool ExplicitRun<Real>::update(Share &share) {
    // Owned points begin at whole packs; the last share ends in the padding.
    const std::size_t last =
        (4 * share.last_owned + longest_pack - 1) / longest_pack * longest_pack;
    return _kernel.move_points({_displacement.data(), _increment.data(), _shares[0].force.data(),
                                _external.data(), _mobility.data(), 4 * share.first_owned, last,
                                _keep, _limit});
}

template <typename Real>
void ExplicitRun<Real>::record(const Share &share, std::span<double> displacement) const {
    for (std::size_t k = share.first_owned; k < share.last_owned; ++k)
        for (std::size_t j = 0; j < 3; ++j)
            displacement[3 * _point_of[k] + j] = static_cast<double>(_displacement[4 * k + j]);
}

template <typename Real> ExplicitOutcome ExplicitRun<Real>::advance(const ExplicitPlan &plan) {
    const std::size_t num_threads = _shares.size();
    const auto num_steps = static_cast<std::size_t>(plan.num_steps);
    const auto every = static_cast<std::size_t>(plan.every);
    const auto step_of = [&](std::size_t step) {
        const auto row = [&](std::size_t r) {
            return plan.factors.subspan(r * plan.num_histories, plan.num_histories);
        };
        const auto poses = [&](std::size_t r) {
            const std::size_t size = pose_size * _tools.size();
            return plan.poses.subspan(r * size, size);
        };
        if (step == 0)
            return Step{row(0), row(1), true, true, poses(0), poses(1)};
        const auto [is_new, is_jump] = load_change(row(step - 1), row(step));
        return Step{row(step), row(step + 1), is_new, is_jump, poses(step), poses(step + 1)};
    };
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
    ExplicitOutcome outcome{plan.num_steps, StopReason::none, -1};
    const auto energies_at = [&](std::size_t row) { return plan.energies.subspan(3 * row, 3); };
    const auto work = [&](std::size_t thread) {
        Share &share = _shares[thread];
        const ForceJob<Real> job = job_of(share);
        const auto stop = [&](StopReason reason, std::size_t updates) {
            if (thread == 0) {
                outcome.reason = reason;
                outcome.steps_done = static_cast<std::int64_t>(updates);
            }
        };
        // With energies, once more at the end: forces there complete the sums.
        const bool has_tools = !_tools.empty();
        const std::size_t num_looks =
            num_steps + (_settings.tracks_energy || has_tools || _body_touch ? 1 : 0);
        for (std::size_t step = 0; step < num_looks; ++step) {
            const std::size_t slot = step % 2;
            const Step now = step_of(step);
            const Real smallest = _kernel.add_forces(job);
            flags[thread].reason[slot] =
                smallest > Real(0) ? StopReason::none : StopReason::inverted_cell;
            if (thread == 0 && !_pressures.empty())
                add_pressure(now.now);
            if (thread == 0 && _body_touch)
                touch_body();
            barrier.wait();
            if (const StopReason reason = any(flags, slot); reason != StopReason::none)
                return stop(reason, step);
            gather_forces(share, now);
            const bool is_clear = !has_tools || touch_tools(share, now);
            const bool is_last = step + 1 >= num_steps, looks = is_last || step % 16 == 15;
            if (_settings.tracks_energy)
                track(share, step > 0, step < num_steps);
            if (step == num_steps) {
                std::fill_n(_shares[0].force.begin() +
                                static_cast<std::ptrdiff_t>(4 * share.first_owned),
                            4 * (share.last_owned - share.first_owned), Real(0));
            } else {
                const bool is_good = update(share);
                move_supports(share, now);
                late[thread].reason[slot] = !is_good    ? StopReason::out_of_bounds
                                            : !is_clear ? StopReason::deep_in_tool
                                                        : StopReason::none;
                if (looks)
                    watch(share);
                if ((step + 1) % every == 0)
                    record(share, plan.displacements.subspan(
                                      3 * _num_points * ((step + 1) / every - 1), 3 * _num_points));
            }
            barrier.wait();
            if (thread == 0 && _settings.tracks_energy && step % every == 0)
                sum_energies(energies_at(step / every));
            if (thread == 0 && has_tools) {
                const std::size_t size = reaction_size * _tools.size();
                sum_reactions();
                if (step % every == 0)
                    record_tools(plan.reactions.subspan(size * (step / every), size));
                if (step < num_steps)
                    move_tools(now);
            }
            if (step == num_steps)
                return;
            StopReason reason = any(late, slot);
            if (reason == StopReason::none && looks && is_growing())
                reason = StopReason::energy_growth;
            if (thread == 0) {
                _has_begun = true;
                ++_steps_since_good;
            }
            if (reason != StopReason::none)
                return stop(reason, step + 1);
            if (looks)
                keep_good(share);
            if (looks && thread == 0)
                _steps_since_good = 0;
        }
    };
    std::vector<std::thread> others;
    for (std::size_t t = 1; t < num_threads; ++t)
        others.emplace_back(work, t);
    work(0);
    for (std::thread &other : others)
        other.join();
    if (outcome.reason != StopReason::none)
        go_back(outcome.reason, outcome);
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
