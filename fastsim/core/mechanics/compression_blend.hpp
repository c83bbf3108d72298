#pragma once
// Where Saint-Venant-Kirchhoff is compressed, smoothed tetrahedra go over to the plain ones, edge
// by edge: under pressure a cell gains energy as it turns and shears, and what is averaged over
// edges does not resist it. With V_e and E_e of smoothed_tet4.hpp, q = -tr E_e min(lmbda/mu + 2,
// 6),
//
//   W += sum of V_e mu beta(q) v_e,  v_e = (1 / V_e) sum over c at e of (V_c / 6) |E_c|^2 - |E_e|^2
//
// v_e is the variance of the strain at the edge, 0 where it is the same in all cells: the patch
// test holds, and so does force = dW/du. beta is 0 up to q = 0.2, rises as x^2 (3 - 2 x), x from 0
// to 1, and is 1 from q = 0.7, where W_e is that of the plain cells.
//
// No library is included here, because the kernels include this file.

namespace fastsim {

inline constexpr double blend_onset = 0.2, blend_width = 0.5;

/// dx/d(tr E_e) of an edge.
inline double blend_rate(double lmbda, double mu) {
    const double ratio = lmbda / mu + 2.0;
    return -(ratio < 6.0 ? ratio : 6.0) / blend_width;
}

/// beta, and its first two derivatives by x.
template <typename Real> struct CompressionBlend {
    Real beta = 0, slope = 0, bend = 0;

    explicit CompressionBlend(Real x) {
        if (x >= Real(1))
            beta = 1;
        else if (x > Real(0)) {
            beta = x * x * (Real(3) - Real(2) * x);
            slope = Real(6) * x * (Real(1) - x);
            bend = Real(6) - Real(12) * x;
        }
    }
};

} // namespace fastsim
