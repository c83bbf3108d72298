#pragma once
// What decides the critical time step of linear tetrahedra at rest, cell by cell.

#include "predicates/predicates.hpp"

#include <array>
#include <cstdint>
#include <span>

namespace fastsim {

/// Bounds of the largest eigenvalue of each cell's stiffness over its volume, for Lamé's parameters
/// lmbda and mu: see fastsim/critical_cells.py. Returns the cosine of the smallest dihedral angle
/// of all cells. Pre-condition: their volumes are positive.
double bound_cell_stiffness(std::span<const Point> points,
                            std::span<const std::array<std::int32_t, 4>> cells, double lmbda,
                            double mu, std::span<double> upper, std::span<double> lower);

} // namespace fastsim
