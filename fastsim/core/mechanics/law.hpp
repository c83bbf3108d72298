#pragma once
// The laws a body may follow under finite strain. No library templates here: step_kernel.hpp
// includes it.
//
// With F = I + H, C = F^T F, J = det F, E Green's strain, t = tr E, q = E : E. lmbda and mu are
// Lamé's at rest for every law, so all agree on small strains.
//
//   saint_venant_kirchhoff  W = lmbda/2 t^2 + mu q                                        (eq. 2)
//   neo_hookean_stable      W = mu/2 (I_C - 3) + L/2 (J - 1 - mu/L)^2 - mu^2/(2 L),  L = lmbda + mu
//                           (Smith, De Goes and Kim, ACM Trans. Graph. 37, 2018, section 3)  (L1)
//   neo_hookean             W = mu/2 (I_C - 3) - mu ln J + lmbda/2 (ln J)^2
//                           (Bonet and Wood 2008, section 6.4.3)                             (L2)
//   mooney_rivlin           W = c10 (I_C J^(-2/3) - 3) + c01 (II_C J^(-4/3) - 3)
//                               + kappa/2 (J - 1)^2,  c10 = mu/2 - c01, kappa = lmbda + 2/3 mu;
//                           for c01 = 0 neo-Hookean with shape and volume apart              (L3)

namespace fastsim {

enum class Law { saint_venant_kirchhoff, neo_hookean_stable, neo_hookean, mooney_rivlin };

} // namespace fastsim
