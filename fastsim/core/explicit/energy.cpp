#include "explicit/energy.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace fastsim {

// Kinetic energy may pass what was given by the scheme's own error, a factor of three at 0.8 of
// the critical step, never by this one.
constexpr double growth_limit = 10.0;
// Nor may a body that only rests or turns be stopped for its rounding errors: increments of so
// many roundings of the displacement, gathered over a long run, are no growth.
constexpr double most_roundings = 1e4;

template <typename Real>
void EnergyBalance<Real>::add(std::size_t thread, const Portion &portion,
                              const Motion<Real> &motion, const Pushes<Real> &pushes,
                              const MovingSupports<Real> &supports,
                              const SlidingSupports<Real> &slides, bool begins) {
    Sums &sums = _sums[thread];
    const double dt = motion.scheme.time_step;
    double behind = 0.0, ahead = 0.0, squared = 0.0;
    const auto add_entry = [&](std::size_t i, double force, double next) {
        const double last = static_cast<double>(motion.increment[i]);
        behind += 0.5 * force * last;
        ahead += 0.5 * force * next;
        const double speed = (last + next) / (2.0 * dt);
        squared += motion.mass[i / 4] * speed * speed;
    };
    for (std::size_t point = portion.first_owned; point < portion.last_owned; ++point)
        for (std::size_t i = 4 * point; i < 4 * point + 3; ++i)
            if (motion.is_free[i] != 0) {
                const double load = static_cast<double>(motion.external[i]) + pushes.total(i);
                add_entry(i, load, static_cast<double>(motion.increment_ahead(i)));
            }
    for (const auto &support : supports.of(thread))
        add_entry(support.entry, support.pull, support.next);
    // Their points' inertia has been counted among the free ones'.
    for (const auto &slide : slides.of(thread)) {
        behind += 0.5 * slide.pull * slide.last;
        ahead += 0.5 * slide.pull * slide.next;
    }
    const double half_loss = 0.5 * dt * motion.scheme.mass_damping * squared;
    double spent = 0.0;
    if (!motion.viscous.empty())
        for (std::size_t i = 4 * portion.first_owned; i < 4 * portion.last_owned; ++i) {
            const double forces =
                static_cast<double>(_viscous_behind[i]) + static_cast<double>(motion.viscous[i]);
            spent += 0.5 * forces * static_cast<double>(motion.increment[i]);
            _viscous_behind[i] = motion.viscous[i];
        }
    if (sums.is_begun) {
        sums.work += behind;
        sums.loss += half_loss + spent;
    }
    sums.halfway = {0.5 * squared, sums.work, sums.loss};
    sums.is_begun = begins;
    if (begins) {
        sums.work += ahead;
        sums.loss += half_loss;
    }
}

template <typename Real> EnergyRecord EnergyBalance<Real>::total() const {
    EnergyRecord total;
    for (const Sums &sums : _sums) {
        total.kinetic += sums.halfway.kinetic;
        total.external_work += sums.halfway.external_work;
        total.damping_loss += sums.halfway.damping_loss;
    }
    return total;
}

template <typename Real>
void EnergyMonitor<Real>::reset(std::size_t num_threads, const Motion<Real> &motion,
                                double energy) {
    _sums.assign(num_threads, {});
    _displacement = _counted = motion.displacement;
    _increment = motion.increment;
    _energy_at_start = energy;
    _total_mass = std::accumulate(motion.mass.begin(), motion.mass.end(), 0.0);
}

template <typename Real> void EnergyMonitor<Real>::give(std::size_t thread, double work) {
    _sums[thread].given += std::abs(work);
}

template <typename Real> void EnergyMonitor<Real>::give_later(double work) {
    _sums[0].later += std::abs(work);
}

template <typename Real>
void EnergyMonitor<Real>::count_dead_loads(std::size_t thread, const Portion &portion,
                                           const Motion<Real> &motion) {
    double work = 0.0;
    for (std::size_t i = 4 * portion.first_owned; i < 4 * portion.last_owned; ++i) {
        if (motion.is_free[i] != 0)
            work += static_cast<double>(motion.external[i]) *
                    static_cast<double>(motion.displacement[i] - _counted[i]);
        _counted[i] = motion.displacement[i];
    }
    _sums[thread].given += std::abs(work) + _sums[thread].later;
    _sums[thread].later = 0.0;
}

template <typename Real>
void EnergyMonitor<Real>::look(std::size_t thread, const Portion &portion,
                               const Motion<Real> &motion) {
    count_dead_loads(thread, portion, motion);
    Sums &sums = _sums[thread];
    double squared = 0.0;
    sums.fastest = -1.0;
    sums.furthest = 0.0;
    for (std::size_t point = portion.first_owned; point < portion.last_owned; ++point) {
        double sum = 0.0;
        for (std::size_t i = 4 * point; i < 4 * point + 3; ++i) {
            const double d = static_cast<double>(motion.increment[i]);
            if (motion.is_free[i] != 0)
                sum += d * d;
            sums.furthest =
                std::max(sums.furthest, std::abs(static_cast<double>(motion.displacement[i])));
        }
        squared += motion.mass[point] * sum;
        // The first NaN counts as fastest.
        if (!std::isnan(sums.fastest) && !(sum <= sums.fastest)) {
            sums.fastest = sum;
            sums.fastest_record = point;
        }
    }
    const double dt = motion.scheme.time_step;
    sums.kinetic = 0.5 * squared / (dt * dt);
}

template <typename Real> bool EnergyMonitor<Real>::is_growing(const Motion<Real> &motion) const {
    double kinetic = 0.0, given = _energy_at_start, furthest = 0.0;
    for (const Sums &sums : _sums) {
        kinetic += sums.kinetic;
        given += sums.given;
        furthest = std::max(furthest, sums.furthest);
    }
    const double eps = static_cast<double>(std::numeric_limits<Real>::epsilon());
    const double speed = most_roundings * eps * furthest / motion.scheme.time_step;
    // NaN counts as growth: the comparison is false for it.
    return !(kinetic <= growth_limit * given + 0.5 * _total_mass * speed * speed);
}

template <typename Real>
void EnergyMonitor<Real>::keep(const Portion &portion, const Motion<Real> &motion) {
    const auto copy = [&](const AlignedVector<Real> &from, AlignedVector<Real> &to) {
        std::copy(from.begin() + static_cast<std::ptrdiff_t>(4 * portion.first_owned),
                  from.begin() + static_cast<std::ptrdiff_t>(4 * portion.last_owned),
                  to.begin() + static_cast<std::ptrdiff_t>(4 * portion.first_owned));
    };
    copy(motion.displacement, _displacement);
    copy(motion.increment, _increment);
}

template <typename Real> void EnergyMonitor<Real>::restore(Motion<Real> &motion) const {
    motion.displacement = _displacement;
    motion.increment = _increment;
}

template <typename Real> std::size_t EnergyMonitor<Real>::fastest_record() const {
    const Sums *worst = &_sums[0];
    for (const Sums &sums : _sums)
        if (!std::isnan(worst->fastest) && !(sums.fastest <= worst->fastest))
            worst = &sums;
    return worst->fastest_record;
}

template class EnergyBalance<float>;
template class EnergyBalance<double>;
template class EnergyMonitor<float>;
template class EnergyMonitor<double>;

} // namespace fastsim
