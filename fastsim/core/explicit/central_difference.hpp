#pragma once
// Explicit central differences: eq. 11-13 of the paper, with lumped M and D = mass_damping M.
//
//   M a'' + D a' + R(a) = F                                                          (eq. 11)
//   a'' = (a(t+dt) - 2 a(t) + a(t-dt)) / dt^2,   a' = (a(t+dt) - a(t-dt)) / (2 dt)
//
//   (M/dt^2 + D/(2 dt)) a(t+dt)
//       = F - R(a(t)) + (2/dt^2) M a(t) - (M/dt^2 - D/(2 dt)) a(t-dt)                (eq. 12)
//
// The paper's eq. 12 is misprinted: R(a) stands there inside a bracket multiplied by a. Here it is
// divided by M/dt^2 and written in increments d(t) = a(t) - a(t-dt), which keep the digits that
// 2 a(t) - a(t-dt) loses in single precision. With c = mass_damping dt / 2:
//
//   (1 + c) d(t+dt) = (1 - c) d(t) + dt^2 M^-1 (F - R(a(t))),   a(t+dt) = a(t) + d(t+dt)
//
// Stiffness damping is a viscous stress besides, on the rate of strain, backwards in time so that
// no equations are solved:
//
//   S_v(t) = stiffness_damping C : (E(a(t)) - E(a(t-dt))) / dt,   C at rest
//
// R(a(t)) then has its forces too (InternalForce::make_viscous). For small strains it is K times
// the rate: a mode decays as by a ratio xi = stiffness_damping omega / 2, and the steps are stable
// for dt <= 2 / omega (sqrt(1 + xi^2) - xi).
//
// All that steps or looks a step ahead goes through `next_increment`. Included by the kernels: no
// library templates here, see step_kernel.hpp.

namespace fastsim {

struct CentralDifference {
    double time_step;
    double mass_damping;

    double half_damping() const { return 0.5 * mass_damping * time_step; }
    /// What is left of an increment without a force.
    double keep() const { return (1.0 - half_damping()) / (1.0 + half_damping()); }
    /// Increment by a unit force on a mass.
    double mobility(double mass) const {
        return time_step * time_step / (mass * (1.0 + half_damping()));
    }
};

/// d(t+dt) by eq. 12, for numbers or vectors of them; `force` is F - R(a).
template <typename Real, typename V>
[[gnu::always_inline]] inline V next_increment(Real keep, V increment, V mobility, V force) {
    return keep * increment + mobility * force;
}

} // namespace fastsim
