#pragma once
// Energy, stress and tangent of the laws of law.hpp other than Saint-Venant-Kirchhoff's.
//
// All of them are functions of j = J - 1, t = tr E and q = E : E, and with cof F = I + d,
// d = tr(H) I - H^T + cof H,
//
//   P = a (F - cof F) + p cof F + b F (t I - E),        F - cof F = H - d                  (L4)
//
// a, p and b as `LawFormulas` has them. Nothing is a difference of large numbers where H is small:
// j = tr H + tr(cof H) + det H, and F - cof F is formed from H.
//
// Of a C = I + 2 E that is no cell's, J is the root of det C, and with K = J C^-1
//
//   S = a (I - K) + p K + b (t I - E),   K - I = (2 t I - 2 E + 4 cof E - j I) / J           (L9)

#include "mechanics/tet4.hpp"

namespace fastsim {

/// (L4) at a displacement gradient, and its derivative along another.
class FiniteStress {
  public:
    FiniteStress(Law law, const Moduli &moduli, const Matrix3 &h);

    double energy() const;
    Matrix3 stress() const;
    /// dP of a change dH of H.
    Matrix3 change(const Matrix3 &dh) const;

  private:
    Law _law;
    Moduli _moduli;
    Matrix3 _h, _f, _e, _d; // H, F, E, d
    Invariants _at;
    StressCoefficients<double> _coefficients;
    CoefficientRates _rates;
};

/// (L9) at a strain with a definite C, and its derivative along another.
class ShapeStress {
  public:
    ShapeStress(Law law, const Moduli &moduli, const Matrix3 &e);

    double energy() const;
    Matrix3 value() const;
    Matrix3 change(const Matrix3 &de) const;

  private:
    Law _law;
    Moduli _moduli;
    Matrix3 _e, _less; // E, K - I
    Invariants _at;
    StressCoefficients<double> _coefficients;
    CoefficientRates _rates;
};

Matrix3 cofactor(const Matrix3 &m);
/// Derivative of the cofactors of m along dm.
Matrix3 cofactor_change(const Matrix3 &m, const Matrix3 &dm);

} // namespace fastsim
