#pragma once
// Conjugate gradients for K x = b on the free components: eq. 5, and the steps of eq. 9-10
// (Shewchuk 1994, section B3), preconditioned by multigrid where one is given, by the inverse
// diagonal blocks otherwise. Stops at a direction of negative curvature, which a tangent stiffness
// has beyond a limit point.

#include "mechanics/block_matrix.hpp"
#include "mechanics/multigrid.hpp"

#include <cstdint>
#include <span>

namespace fastsim {

enum class SolveStatus { converged, negative_curvature, iteration_limit };

struct SolveResult {
    SolveStatus status;
    std::int64_t iterations;
    double residual_norm; // Euclidean, on the free components
};

/// Solves on components where `is_free` is not 0; x is 0 on the others.
/// `multigrid` may be null, or made for another, similar matrix with the same free components.
/// Pre-conditions: all spans hold 3 num_points entries; x comes in as 0.
SolveResult conjugate_gradient(const BlockMatrix &matrix, std::span<const double> b,
                               std::span<const std::uint8_t> is_free, double absolute_tolerance,
                               std::int64_t max_iterations, const Multigrid *multigrid,
                               std::span<double> x);

} // namespace fastsim
