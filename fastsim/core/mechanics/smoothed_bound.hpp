#pragma once
// An upper bound on the largest eigenvalue of M^-1 K of smoothed tetrahedra at rest, for which
// critical time steps are sure: dt = 2 / root(bound).
//
// K is a sum over patches p, of edges and of nodes. If each point's mass is divided among the
// patches that it is in, sum over p of M_ip <= m_i I with symmetric M_ip >= 0 (3 x 3), then
// x . K x <= max_p lambda_p x . M x, where lambda_p is the largest eigenvalue of a patch with its
// own part of the mass (Irons and Treharne 1971; Fried 1972, there with numbers for M_ip). That
// holds for any division, so it may be chosen well. With t_ip the mean gradient of a point's shape
// function in a patch and D_ip the strain rates that it makes (3 x 6),
//
//   nodes: strain along t_ip alone, so M_ip = c_i w_ip t t^T / |t|^2,
//          lambda_p = lmbda V_n sum over i of |t_ip|^2 / (c_i w_ip)
//   edges: M_ip = c_i w_ip I + (m_i I - c_i N_i) / (edges at i), with N_i the sum of all w_ip I and
//          w_ip t t^T / |t|^2 of a point, and c_i = m_i over a bound on the largest eigenvalue of
//          N_i, lambda_p = largest eigenvalue of  A = 2 mu V_e sum over i of D_ip^T M_ip^-1 D_ip (6
//          x 6)
//
// Rounds give more weight to patches whose lambda_p is large. For symmetric A >= 0 of size d,
// lambda_max(A) <= (tr A^64)^(1/64), at most d^(1/64) times as large: 1.03 for d = 6. Node patches
// of a negative lmbda only lower K, and are left out.

#include "mechanics/smoothing_patches.hpp"

#include <span>

namespace fastsim {

/// The best bound [1/s2] of so many rounds. Pre-condition: positive masses.
double bound_on_squared_frequency(const ElasticCells &body, const SmoothingPatches &patches,
                                  std::span<const double> lumped_mass, int rounds);

} // namespace fastsim
