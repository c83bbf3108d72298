// Energy of an explicit run: the sums for its balance, and the watch over its growth.
//
// Along an increment d the work of a force f is the mean of f at both ends times d: half of it is
// added when f is known at the far end, the other half when the next increment is. The loss by
// damping, damping m v^2 with the central velocity v = (d + d_next) / (2 dt), likewise.
#include "mechanics/explicit_run.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace fastsim {

// Kinetic energy may pass what was given by the scheme's own error, a factor of three at 0.8 of
// the critical step, never by this one.
constexpr double growth_limit = 10.0;
// Nor may a body that only rests or turns be stopped for its rounding errors: increments of so
// many roundings of the displacement, gathered over a long run, are no growth.
constexpr double most_roundings = 1e4;

template <typename Real>
void ExplicitRun<Real>::track(Share &share, bool completes_half, bool begins_half) {
    const Real *const total = _shares[0].force.data();
    const double dt = _settings.time_step, damping = _settings.mass_damping;
    double work_behind = 0.0, work_ahead = 0.0, squared = 0.0;
    const auto add = [&](std::size_t i, double force, double next) {
        const double last = static_cast<double>(_increment[i]);
        work_behind += 0.5 * force * last;
        work_ahead += 0.5 * force * next;
        const double speed = (last + next) / (2.0 * dt);
        squared += _mass[i / 4] * speed * speed;
    };
    for (std::size_t point = share.first_owned; point < share.last_owned; ++point)
        for (std::size_t i = 4 * point; i < 4 * point + 3; ++i)
            if (_is_free[i] != 0) {
                // d_next by eq. 12, before the update does it.
                const Real next = _keep * _increment[i] + _mobility[i] * (_external[i] - total[i]);
                double load = static_cast<double>(_external[i]);
                if (!_pressure_force.empty())
                    load += static_cast<double>(_pressure_force[i]);
                if (!_body_force.empty())
                    load += static_cast<double>(_body_force[i]);
                if (!_contact_force.empty())
                    load += static_cast<double>(_contact_force[i]);
                add(i, load, static_cast<double>(next));
            }
    for (const MovingSupport &support : share.moving)
        add(support.entry, support.pull, support.next);
    const double half_loss = 0.5 * dt * damping * squared;
    if (completes_half) {
        share.work += work_behind;
        share.loss += half_loss;
    }
    share.work_halfway = share.work;
    share.loss_halfway = share.loss;
    share.kinetic = 0.5 * squared;
    if (begins_half) {
        share.work += work_ahead;
        share.loss += half_loss;
    }
}

template <typename Real> void ExplicitRun<Real>::sum_energies(std::span<double> row) const {
    for (const Share &share : _shares) {
        row[0] += share.kinetic;
        row[1] += share.work_halfway;
        row[2] += share.loss_halfway;
    }
}

/// Adds the work of the dead loads since the window opened; before they jump, and at every look.
/// Step for step, as with pressure and supports, its magnitude counts: what goes in and comes out
/// again has the scheme's error both times.
template <typename Real> void ExplicitRun<Real>::close_window(Share &share) {
    double work = 0.0;
    for (std::size_t i = 4 * share.first_owned; i < 4 * share.last_owned; ++i) {
        if (_is_free[i] != 0)
            work += static_cast<double>(_external[i]) *
                    static_cast<double>(_displacement[i] - _worked_displacement[i]);
        _worked_displacement[i] = _displacement[i];
    }
    share.given += std::abs(work) + share.pressure_work;
    share.pressure_work = 0.0;
}

template <typename Real> void ExplicitRun<Real>::watch(Share &share) {
    close_window(share);
    double squared = 0.0;
    share.fastest = -1.0;
    share.furthest = 0.0;
    for (std::size_t point = share.first_owned; point < share.last_owned; ++point) {
        double sum = 0.0;
        for (std::size_t i = 4 * point; i < 4 * point + 3; ++i)
            if (_is_free[i] != 0)
                sum += static_cast<double>(_increment[i]) * static_cast<double>(_increment[i]);
        squared += _mass[point] * sum;
        for (std::size_t i = 4 * point; i < 4 * point + 3; ++i)
            share.furthest =
                std::max(share.furthest, std::abs(static_cast<double>(_displacement[i])));
        // The first NaN counts as fastest.
        if (!std::isnan(share.fastest) && !(sum <= share.fastest)) {
            share.fastest = sum;
            share.fastest_point = point;
        }
    }
    share.watched_kinetic = 0.5 * squared / (_settings.time_step * _settings.time_step);
}

template <typename Real> bool ExplicitRun<Real>::is_growing() const {
    double kinetic = 0.0, given = _energy_at_start, furthest = 0.0;
    for (const Share &share : _shares) {
        kinetic += share.watched_kinetic;
        given += share.given;
        furthest = std::max(furthest, share.furthest);
    }
    const double eps = static_cast<double>(std::numeric_limits<Real>::epsilon());
    const double speed = most_roundings * eps * furthest / _settings.time_step;
    // NaN counts as growth: the comparison is false for it.
    return !(kinetic <= growth_limit * given + 0.5 * _total_mass * speed * speed);
}

template <typename Real> void ExplicitRun<Real>::keep_good(const Share &share) {
    const auto begin = static_cast<std::ptrdiff_t>(4 * share.first_owned);
    const auto end = static_cast<std::ptrdiff_t>(4 * share.last_owned);
    std::copy(_displacement.begin() + begin, _displacement.begin() + end,
              _good_displacement.begin() + begin);
    std::copy(_increment.begin() + begin, _increment.begin() + end,
              _good_increment.begin() + begin);
}

template <typename Real> std::int64_t ExplicitRun<Real>::fastest_point() const {
    const Share *worst = &_shares[0];
    for (const Share &share : _shares)
        if (!std::isnan(worst->fastest) && !(share.fastest <= worst->fastest))
            worst = &share;
    return static_cast<std::int64_t>(_point_of[worst->fastest_point]);
}

/// Leaves the last good state: one step back from an inverted cell, else that of the last look.
template <typename Real>
void ExplicitRun<Real>::go_back(StopReason reason, ExplicitOutcome &outcome) {
    outcome.reason = reason;
    if (reason != StopReason::inverted_cell) {
        for (Share &share : _shares)
            watch(share);
        outcome.point = fastest_point();
        _displacement = _good_displacement;
        _increment = _good_increment;
        outcome.steps_done -= _steps_since_good;
    } else if (_has_begun) {
        for (std::size_t i = 0; i < 4 * _num_points; ++i)
            _displacement[i] -= _increment[i];
        outcome.steps_done -= 1;
    }
    for (Share &share : _shares)
        std::fill(share.force.begin(), share.force.end(), Real(0));
}

template class ExplicitRun<float>;
template class ExplicitRun<double>;

} // namespace fastsim
