#include "mechanics/hyperelastic.hpp"

#include <cmath>
#include <stdexcept>

namespace fastsim {

namespace {

double dot(const Matrix3 &a, const Matrix3 &b) {
    double sum = 0.0;
    for (std::size_t k = 0; k < 9; ++k)
        sum += a[k] * b[k];
    return sum;
}

double trace(const Matrix3 &m) { return m[0] + m[4] + m[8]; }

Matrix3 product(const Matrix3 &a, const Matrix3 &b) {
    Matrix3 c{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t j = 0; j < 3; ++j)
                c[3 * i + j] += a[3 * i + k] * b[3 * k + j];
    return c;
}

/// tr(m) I - m^T + more.
Matrix3 turned(const Matrix3 &m, const Matrix3 &more) {
    Matrix3 r{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            r[3 * i + j] = more[3 * i + j] - m[3 * j + i] + (i == j ? trace(m) : 0.0);
    return r;
}

/// Functions of a law's formulas, for one number.
struct Math {
    using Real = double;
    static double log_of_one_plus(double x) { return std::log1p(x); }
    static double exp_less_one(double x) { return std::expm1(x); }
    static double inverse_cube_root(double x) { return 1.0 / std::cbrt(x); }
    /// x - ln(1 + x), by its series where the difference would lose digits.
    static double log_excess(double x) {
        if (std::abs(x) > 0.02)
            return x - std::log1p(x);
        double sum = 0.0;
        for (int n = 11; n >= 2; --n) // x^2/2 - x^3/3 + ..., the next term below eps of the first
            sum = 1.0 / n - x * sum;
        return x * x * sum;
    }
};

/// What `use` makes of a law's formulas. Pre-condition: it has formulas in invariants.
template <typename Use> auto by_formulas(Law law, Use &&use) {
    using Found = decltype(use(LawFormulas<Law::neo_hookean>{}));
    return with_formulas(law, use, []() -> Found { throw std::logic_error("a law of stretches"); });
}

StressCoefficients<double> coefficients_of(Law law, const Moduli &moduli, const Invariants &at) {
    return by_formulas(law, [&](auto formulas) {
        return formulas.template coefficients<Math>(moduli, at.j, at.t, at.q);
    });
}

CoefficientRates rates_of(Law law, const Moduli &moduli, const Invariants &at) {
    return by_formulas(law,
                       [&](auto formulas) { return formulas.template rates<Math>(moduli, at); });
}

double energy_of(Law law, const Moduli &moduli, const Invariants &at) {
    return by_formulas(law,
                       [&](auto formulas) { return formulas.template energy<Math>(moduli, at); });
}

} // namespace

Matrix3 cofactor(const Matrix3 &m) {
    return {m[4] * m[8] - m[5] * m[7], m[5] * m[6] - m[3] * m[8], m[3] * m[7] - m[4] * m[6],
            m[2] * m[7] - m[1] * m[8], m[0] * m[8] - m[2] * m[6], m[1] * m[6] - m[0] * m[7],
            m[1] * m[5] - m[2] * m[4], m[2] * m[3] - m[0] * m[5], m[0] * m[4] - m[1] * m[3]};
}

Matrix3 cofactor_change(const Matrix3 &m, const Matrix3 &dm) {
    Matrix3 r{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            const std::size_t k = 3 * ((i + 1) % 3), l = 3 * ((i + 2) % 3);
            const std::size_t p = (j + 1) % 3, q = (j + 2) % 3;
            r[3 * i + j] = dm[k + p] * m[l + q] + m[k + p] * dm[l + q] - dm[k + q] * m[l + p] -
                           m[k + q] * dm[l + p];
        }
    return r;
}

FiniteStress::FiniteStress(Law law, const Moduli &moduli, const Matrix3 &h)
    : _law(law), _moduli(moduli), _h(h), _f(deformation_gradient(h)),
      _e(strain_tensor(h, StrainMeasure::green)) {
    const Matrix3 cof = cofactor(h);
    _d = turned(h, cof);
    const double det = h[0] * cof[0] + h[1] * cof[1] + h[2] * cof[2];
    _at = {trace(h) + trace(cof) + det, trace(_e), dot(_e, _e), 0.5 * dot(h, h) - trace(cof) - det};
    _coefficients = coefficients_of(law, moduli, _at);
    _rates = rates_of(law, moduli, _at);
}

double FiniteStress::energy() const { return energy_of(_law, _moduli, _at); }

Matrix3 FiniteStress::stress() const {
    const auto [a, p, b] = _coefficients;
    Matrix3 s{};
    for (std::size_t k = 0; k < 9; ++k)
        s[k] = a * _h[k] + (p - a) * _d[k];
    for (std::size_t k = 0; k < 9; k += 4)
        s[k] += p;
    if (b != 0.0) {
        Matrix3 g = _e;
        for (std::size_t k = 0; k < 9; ++k)
            g[k] = (k % 4 == 0 ? _at.t : 0.0) - g[k];
        const Matrix3 fg = product(_f, g);
        for (std::size_t k = 0; k < 9; ++k)
            s[k] += b * fg[k];
    }
    return s;
}

Matrix3 FiniteStress::change(const Matrix3 &dh) const {
    const auto [a, p, b] = _coefficients;
    const auto [a_j, p_j, b_j, p_t, p_q, a_t] = _rates;
    Matrix3 cof = _d;
    for (std::size_t k = 0; k < 9; k += 4)
        cof[k] += 1.0;
    const Matrix3 fe = product(_f, _e);
    const double dj = dot(cof, dh), dt = dot(_f, dh), dq = 2.0 * dot(fe, dh);
    const double da = a_j * dj + a_t * dt, dp = p_j * dj + p_t * dt + p_q * dq;
    const Matrix3 dd = turned(dh, cofactor_change(_h, dh));
    Matrix3 ds{};
    for (std::size_t k = 0; k < 9; ++k)
        ds[k] = a * (dh[k] - dd[k]) + p * dd[k] + da * (_h[k] - _d[k]) + dp * cof[k];
    if (b != 0.0) {
        // F G = t F - F E, dE = sym(F^T dH).
        Matrix3 ft{};
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t j = 0; j < 3; ++j)
                ft[3 * i + j] = _f[3 * j + i];
        const Matrix3 half = product(ft, dh);
        Matrix3 de{};
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t j = 0; j < 3; ++j)
                de[3 * i + j] = 0.5 * (half[3 * i + j] + half[3 * j + i]);
        const Matrix3 dhe = product(dh, _e), fde = product(_f, de);
        const double db = b_j * dj;
        for (std::size_t k = 0; k < 9; ++k)
            ds[k] +=
                db * (_at.t * _f[k] - fe[k]) + b * (dt * _f[k] + _at.t * dh[k] - dhe[k] - fde[k]);
    }
    return ds;
}

ShapeStress::ShapeStress(Law law, const Moduli &moduli, const Matrix3 &e)
    : _law(law), _moduli(moduli), _e(e) {
    const Matrix3 cof = cofactor(e);
    const double t = trace(e), products = trace(cof);
    const double det = e[0] * cof[0] + e[1] * cof[1] + e[2] * cof[2];
    const double more = 2.0 * t + 4.0 * products + 8.0 * det; // det C - 1
    const double j = more / (1.0 + std::sqrt(1.0 + more));
    _at = {j, t, dot(e, e), 0.5 * j * more / (2.0 + j) - 2.0 * products - 4.0 * det};
    _coefficients = coefficients_of(law, moduli, _at);
    _rates = rates_of(law, moduli, _at);
    for (std::size_t k = 0; k < 9; ++k)
        _less[k] = ((k % 4 == 0 ? 2.0 * t - j : 0.0) - 2.0 * e[k] + 4.0 * cof[k]) / (1.0 + j);
}

double ShapeStress::energy() const { return energy_of(_law, _moduli, _at); }

Matrix3 ShapeStress::value() const {
    const auto [a, p, b] = _coefficients;
    Matrix3 s{};
    for (std::size_t k = 0; k < 9; ++k)
        s[k] = (p - a) * _less[k] - b * _e[k] + (k % 4 == 0 ? p + b * _at.t : 0.0);
    return s;
}

Matrix3 ShapeStress::change(const Matrix3 &de) const {
    const auto [a, p, b] = _coefficients;
    const auto [a_j, p_j, b_j, p_t, p_q, a_t] = _rates;
    const double dt = trace(de), dj = dot(_less, de) + dt, dq = 2.0 * dot(_e, de);
    const double da = a_j * dj + a_t * dt, dp = p_j * dj + p_t * dt + p_q * dq, db = b_j * dj;
    const Matrix3 dcof = cofactor_change(_e, de);
    Matrix3 ds{};
    for (std::size_t k = 0; k < 9; ++k) {
        const double one = k % 4 == 0 ? 1.0 : 0.0;
        const double dk =
            (2.0 * (one * dt - de[k] + 2.0 * dcof[k]) - (one + _less[k]) * dj) / (1.0 + _at.j);
        ds[k] = (dp - da) * _less[k] + (p - a) * dk + dp * one + db * (one * _at.t - _e[k]) +
                b * (one * dt - de[k]);
    }
    return ds;
}

} // namespace fastsim
