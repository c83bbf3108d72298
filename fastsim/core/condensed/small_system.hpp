#pragma once
// Small dense systems, by Gaussian elimination with partial pivoting.

#include <cstddef>
#include <span>

namespace fastsim {

/// Solves A X = B in place of B; A, n x n, and B, n x m, row by row. False where A is singular.
bool solve_small(std::span<double> a, std::span<double> b, std::size_t n, std::size_t m);

} // namespace fastsim
