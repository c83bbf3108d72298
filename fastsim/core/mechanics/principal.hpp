#pragma once
// Energy, stress and tangent of an isotropic law by the principal values of Green's strain.
//
// With E = sum of e_i n_i n_i^T, stretches l_i^2 = 1 + 2 e_i, s_i = ln l_i, J = l_1 l_2 l_3,
// j = J - 1 and t_i = dW/ds_i (Kirchhoff's principal stresses; Ogden 1984, section 6.1.4),
//
//   S  = sum of S_i n_i n_i^T,  S_i = t_i / l_i^2
//   dS = sum of (sum over k of dS_i/de_k de_kk) n_i n_i^T
//        + sum over i != k of (S_i - S_k) / (e_i - e_k) de_ik n_i n_k^T,  de_ik = n_i . dE n_k
//
// and where e_i = e_k the quotient is its limit dS_i/de_i - dS_i/de_k. J is the root of det C, so
// that nothing here knows of cells turned inside out.

#include "mechanics/tet4.hpp"

namespace fastsim {

struct Principal {
    std::array<double, 3> values;
    Matrix3 axes; // in columns
};

/// Of a symmetric matrix, by Jacobi's rotations: right to rounding of the largest.
Principal principal_values(const Matrix3 &symmetric);

/// S_i and dS_i/de_k, row by row.
struct PrincipalStress {
    std::array<double, 3> stress;
    Matrix3 stiffness;
};

/// Of the body's law, one of stretches, with these moduli, at principal values of E above -1/2.
PrincipalStress principal_stress(const ElasticCells &body, const Moduli &moduli,
                                 const std::array<double, 3> &strains);

/// Of the sum of the stretches less 3 instead of an energy.
PrincipalStress stretch_sum_rate(const std::array<double, 3> &strains);

/// W [J/m3], 0 at rest.
double principal_energy(const ElasticCells &body, const Moduli &moduli,
                        const std::array<double, 3> &strains);

/// The sum of the stretches less 3.
double stretch_sum(const std::array<double, 3> &strains);

/// A symmetric tensor with E's axes, and its derivative along a change of E.
class CoaxialTensor {
  public:
    CoaxialTensor(const Principal &strain, const PrincipalStress &response);

    Matrix3 value() const;
    Matrix3 change(const Matrix3 &de) const;

  private:
    Principal _strain;
    PrincipalStress _response;
};

/// P = F S of such a law at a displacement gradient, and its derivative along another.
class StressByStretches {
  public:
    StressByStretches(const ElasticCells &body, const Moduli &moduli, const Matrix3 &h);

    double energy() const { return _energy; }
    Matrix3 stress() const { return _p; }
    /// dP = dH S + F dS, dE = sym(F^T dH).
    Matrix3 change(const Matrix3 &dh) const;

  private:
    StressByStretches(const ElasticCells &body, const Moduli &moduli, const Matrix3 &h,
                      const Principal &strain);

    double _energy;
    Matrix3 _f, _s, _p;
    CoaxialTensor _stress;
};

/// F S, and its derivative along dH, where S follows E.
Matrix3 pushed(const Matrix3 &f, const Matrix3 &s);
Matrix3 pushed_change(const Matrix3 &f, const CoaxialTensor &stress, const Matrix3 &s,
                      const Matrix3 &dh);

} // namespace fastsim
