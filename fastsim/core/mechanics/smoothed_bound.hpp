#pragma once
// An upper bound on the largest eigenvalue of M^-1 K of smoothed tetrahedra at rest, for which
// critical time steps are sure: dt = 2 / root(bound).
//
// K is a sum over patches p, of edges and of nodes. If each point's mass is divided among the
// patches that it is in, m_i = sum over p of m_ip, then x . K x <= max_p lambda_p x . M x, where
// lambda_p is the largest eigenvalue of a patch with its own part of the mass (Irons and Treharne
// 1971; Fried 1972). That holds for any division, so it may be chosen well: rounds give more mass
// to patches whose lambda_p is large. With D_i the strain rates of point i in a patch,
//
//   edges: lambda_p = largest eigenvalue of  A = 2 mu V_e sum over i of D_i D_i^T / m_ip   (6 x 6)
//   nodes: lambda_p = lmbda V_n sum over i of |t_i|^2 / m_ip
//
// and lambda_max(A) <= (tr A^16)^(1/16), at most 6^(1/16) = 1.12 times as large. Node patches of
// a negative lmbda only lower K, and are left out.

#include "mechanics/smoothing_patches.hpp"

#include <span>

namespace fastsim {

/// The best bound [1/s2] of so many rounds. Pre-condition: positive masses.
double bound_on_squared_frequency(const ElasticCells &body, const SmoothingPatches &patches,
                                  std::span<const double> lumped_mass, int rounds);

} // namespace fastsim
