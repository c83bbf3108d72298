#pragma once
// Smoothed tetrahedra (smoothed_tet4.hpp) of the laws other than Saint-Venant-Kirchhoff's.
//
// Every law of law.hpp is W = W_0 + lmbda/2 g^2, with W_0 what is left at lmbda = 0 and g a
// function of a measure m of volume: J - 1, but ln J = ln(1 + m) for neo_hookean and
// mooney_rivlin_log, and m = tr U - 3 for corotational. W_0 goes over edges, as a function of C_e =
// I + 2 E_e all of it, J_e = root of det C_e where it has J; g goes over nodes:
//
//   m_n = (1 / V_n) sum over c at n of (V_c / 4) m_c                                        (S6)
//   W   = sum of V_e W_0(C_e) + sum of V_n lmbda/2 g(m_n)^2                                 (S7)
//   P_c = F_c (1/6) sum over e of c of S_0(C_e) + p_c dm/dF,                                (S8)
//         p_c = (1/4) sum over n of c of lmbda g g'(m_n)
//
// So the terms mu ln J and mu (J - 1) go over edges with tr C, without which they leave stress at
// rest, and of kappa/2 (J - 1)^2 the part mu/3 goes over edges. At rest S_0 = 0 and g = 0; for
// small strains (S7) is (S3), whatever the law; a constant F is reproduced; E_e and m_n are the
// same in a turned body. J_e is positive always: it is the node's m that a cell turned inside out
// lowers.

#include "mechanics/principal.hpp"
#include "mechanics/smoothing_patches.hpp"

#include <optional>

namespace fastsim {

/// m of a cell with its derivatives.
class VolumeMeasure {
  public:
    VolumeMeasure(Law law, const Matrix3 &h);

    double value;
    Matrix3 rate; // dm/dF: the cofactors of F, or R
    /// Of the rate along dH.
    Matrix3 rate_change(const Matrix3 &dh) const;

  private:
    Matrix3 _f;
    std::optional<CoaxialTensor> _inverse; // of U, where m is made of stretches
};

/// Symmetric tensors in Mandel's components: xx, yy, zz, then root 2 times yz, xz, xy.
using Mandel6 = std::array<double, 36>;

/// What (S8) is made of at a displacement.
struct SmoothedLaw {
    std::vector<Matrix3> stresses;    // S of each cell
    std::vector<double> pressures;    // p of each cell
    std::vector<Mandel6> edge_moduli; // dS_0/dE of each edge; where asked for
    std::vector<double> node_moduli;  // lmbda (g'^2 + g g'') of each node
    double energy = 0.0;

    SmoothedLaw(const ElasticCells &body, const SmoothingPatches &patches,
                std::span<const double> displacement, bool has_moduli);
};

/// P of (S8) of each cell.
void smoothed_piola_stresses(const ElasticCells &body, const SmoothingPatches &patches,
                             std::span<const double> displacement, std::span<Matrix3> out);

} // namespace fastsim
