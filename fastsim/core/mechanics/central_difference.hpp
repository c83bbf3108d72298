#pragma once
// Explicit central differences (eq. 11-13) with lumped M and D = mass_damping M:
//   (M/dt^2 + D/(2 dt)) a(t+dt) = F - R(a) + (2/dt^2) M a - (M/dt^2 - D/(2 dt)) a(t-dt).
// The paper's eq. 12 is misprinted: R(a) stands there inside a bracket multiplied by a.

#include "mechanics/tet4.hpp"

#include <cstdint>
#include <span>

namespace fastsim {

struct StepSettings {
    double time_step;
    double mass_damping;
    double displacement_limit; // beyond it the run counts as blown up
};

struct StepOutcome {
    std::int64_t steps_done;
    bool is_blown_up; // the next step held NaN or went beyond the limit
};

/// Advances `displacement` and `previous` (state at t and t - dt) by up to `num_steps`.
/// Held components (is_free 0) keep their value. On blow-up both stay at the last good step.
StepOutcome central_difference(const RestCells &rest, std::span<const Index> cells, Lame lame,
                               StrainMeasure strain, std::span<const double> lumped_mass,
                               std::span<const double> external_force,
                               std::span<const std::uint8_t> is_free, StepSettings settings,
                               std::int64_t num_steps, std::span<double> displacement,
                               std::span<double> previous);

} // namespace fastsim
