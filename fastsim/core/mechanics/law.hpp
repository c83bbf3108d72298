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
//   neo_hookean_stable_log  W = m/2 (I_C - 3) + l/2 ((J - a)^2 - (1 - a)^2) - m/2 ln((I_C + 1)/4),
//                           m = 4/3 mu, l = lmbda + 5/6 mu, a = 1 + 3/4 m/l
//                           (the same, section 3.4, their last form)                         (L7)
//   neo_hookean             W = mu/2 (I_C - 3) - mu ln J + lmbda/2 (ln J)^2
//                           (Bonet and Wood 2008, section 6.4.3)                             (L2)
//   mooney_rivlin           W = c10 (I_C J^(-2/3) - 3) + c01 (II_C J^(-4/3) - 3)
//                               + kappa/2 (J - 1)^2,  c10 = mu/2 - c01, kappa = lmbda + 2/3 mu;
//                           for c01 = 0 neo-Hookean with shape and volume apart              (L3)
//   mooney_rivlin_log       the same with kappa/2 (ln J)^2                                   (L8)
//   ogden                   W = sum over p of mu_p/a_p (sum over i of (l_i J^(-1/3))^a_p - 3)
//                               + kappa/2 (J - 1)^2,  mu_p = 2 mu share_p / a_p, the shares' sum 1
//                           (Ogden, Proc. R. Soc. A 328, 1972, with shape and volume apart)  (L5)
//   corotational            W = mu |F - R|^2 + lmbda/2 (tr(R^T F) - 3)^2,  F = R U
//                             = mu sum of (l_i - 1)^2 + lmbda/2 (l_1 + l_2 + l_3 - 3)^2
//                           (McAdams et al., ACM Trans. Graph. 30, 2011, section 3)          (L6)
// with l_i the principal stretches, the eigenvalues of U.

namespace fastsim {

enum class Law {
    saint_venant_kirchhoff,
    neo_hookean_stable,
    neo_hookean_stable_log,
    neo_hookean,
    mooney_rivlin,
    mooney_rivlin_log,
    ogden,
    corotational
};

/// Whether a law is written in principal stretches (mechanics/principal.hpp).
constexpr bool is_of_stretches(Law law) { return law == Law::ogden || law == Law::corotational; }

} // namespace fastsim
