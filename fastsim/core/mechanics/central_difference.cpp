#include "mechanics/central_difference.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fastsim {

StepOutcome central_difference(const RestCells &rest, std::span<const Index> cells, Lame lame,
                               StrainMeasure strain, std::span<const double> lumped_mass,
                               std::span<const double> external_force,
                               std::span<const std::uint8_t> is_free, StepSettings settings,
                               std::int64_t num_steps, std::span<double> displacement,
                               std::span<double> previous) {
    const std::size_t n = displacement.size();
    const double dt = settings.time_step;
    // All of eq. 12 divided by M / dt^2.
    const double half_damping = 0.5 * settings.mass_damping * dt;
    const double ahead = 1.0 / (1.0 + half_damping);
    const double behind = 1.0 - half_damping;
    std::vector<double> force(n), next(n);
    for (std::int64_t step = 0; step < num_steps; ++step) {
        std::fill(force.begin(), force.end(), 0.0);
        add_internal_force(rest, cells, displacement, lame, strain, force);
        bool is_good = true;
        for (std::size_t i = 0; i < n; ++i) {
            if (!is_free[i]) {
                next[i] = displacement[i];
                continue;
            }
            const double acceleration = (external_force[i] - force[i]) / lumped_mass[i / 3];
            next[i] =
                ahead * (dt * dt * acceleration + 2.0 * displacement[i] - behind * previous[i]);
            // Written so that NaN counts as bad.
            is_good = is_good && std::abs(next[i]) <= settings.displacement_limit;
        }
        if (!is_good)
            return {step, true};
        std::copy(displacement.begin(), displacement.end(), previous.begin());
        std::copy(next.begin(), next.end(), displacement.begin());
    }
    return {num_steps, false};
}

} // namespace fastsim
