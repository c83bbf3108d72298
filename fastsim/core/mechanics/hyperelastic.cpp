#include "mechanics/hyperelastic.hpp"

#include <cmath>

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

/// x - ln(1 + x), by its series where the difference would lose digits.
double log_excess(double x) {
    if (std::abs(x) > 0.02)
        return x - std::log1p(x);
    double sum = 0.0;
    for (int n = 11; n >= 2; --n) // x^2/2 - x^3/3 + ..., the next term below eps of the first
        sum = 1.0 / n - x * sum;
    return x * x * sum;
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

Response respond(Law law, const Moduli &moduli, const Invariants &at) {
    const double mu = moduli.mu, lmbda = moduli.lmbda, j = at.j, J = 1.0 + j;
    switch (law) {
    case Law::neo_hookean_stable:
        return {mu, (lmbda + mu) * j, 0.0, 0.0, lmbda + mu, 0.0, 0.0, 0.0};
    case Law::neo_hookean_stable_log: {
        const double own = lmbda + 5.0 / 6.0 * mu, two = 2.0 + at.t;
        return {2.0 / 3.0 * mu * (2.0 - 1.0 / two),
                own * j + mu / 3.0 * at.t / two,
                0.0,
                0.0,
                own,
                0.0,
                2.0 / 3.0 * mu / (two * two),
                0.0,
                2.0 / 3.0 * mu / (two * two)};
    }
    case Law::neo_hookean: {
        const double p = (mu * j + lmbda * std::log1p(j)) / J;
        return {mu, p, 0.0, 0.0, (mu + lmbda / J - p) / J, 0.0, 0.0, 0.0};
    }
    default: {
        const double root = 1.0 / std::cbrt(J), kappa = lmbda + 2.0 / 3.0 * mu;
        const double first = 2.0 * (0.5 * mu - moduli.c01) * root * root;
        const double second = 4.0 * moduli.c01 * root * root * root * root;
        const double q1 = 3.0 * j - 2.0 * at.t;
        const double q2 = 3.0 * j - 4.0 * at.t - 2.0 * (at.t * at.t - at.q);
        const double share = (first * q1 + second * q2) / (3.0 * J);
        const bool is_log = law == Law::mooney_rivlin_log;
        const double pressure = is_log ? kappa * std::log1p(j) / J : kappa * j;
        return {first + second,
                pressure + share,
                second,
                (-2.0 / 3.0 * first - 4.0 / 3.0 * second) / J,
                (is_log ? (kappa / J - pressure) / J : kappa) + (first + second) / J -
                    (5.0 / 3.0 * first * q1 + 7.0 / 3.0 * second * q2) / (3.0 * J * J),
                -4.0 / 3.0 * second / J,
                (-2.0 * first - 4.0 * second * (1.0 + at.t)) / (3.0 * J),
                2.0 * second / (3.0 * J)};
    }
    }
}

double energy_of(Law law, const Moduli &moduli, const Invariants &at) {
    const double mu = moduli.mu, lmbda = moduli.lmbda, j = at.j;
    switch (law) {
    case Law::neo_hookean_stable:
        return mu * at.t_less_j + 0.5 * (lmbda + mu) * j * j;
    case Law::neo_hookean_stable_log:
        return mu * at.t_less_j + 2.0 / 3.0 * mu * log_excess(0.5 * at.t) +
               0.5 * (lmbda + 5.0 / 6.0 * mu) * j * j;
    case Law::neo_hookean: {
        const double log_j = std::log1p(j);
        return mu * (at.t_less_j + log_excess(j)) + 0.5 * lmbda * log_j * log_j;
    }
    default: {
        const double log_j = std::log1p(j), kappa = lmbda + 2.0 / 3.0 * mu;
        const double less1 = std::expm1(-2.0 / 3.0 * log_j), less2 = std::expm1(-4.0 / 3.0 * log_j);
        const double first =
            2.0 * (1.0 + less1) * at.t_less_j + ((3.0 + 2.0 * j) * less1 + 2.0 * j);
        const double second = (1.0 + less2) * (4.0 * at.t_less_j + 2.0 * (at.t * at.t - at.q)) +
                              ((3.0 + 4.0 * j) * less2 + 4.0 * j);
        return (0.5 * mu - moduli.c01) * first + moduli.c01 * second +
               0.5 * kappa * (law == Law::mooney_rivlin_log ? log_j * log_j : j * j);
    }
    }
}

FiniteStress::FiniteStress(Law law, const Moduli &moduli, const Matrix3 &h)
    : _law(law), _moduli(moduli), _h(h), _f(deformation_gradient(h)),
      _e(strain_tensor(h, StrainMeasure::green)) {
    const Matrix3 cof = cofactor(h);
    _d = turned(h, cof);
    const double det = h[0] * cof[0] + h[1] * cof[1] + h[2] * cof[2];
    _at = {trace(h) + trace(cof) + det, trace(_e), dot(_e, _e), 0.5 * dot(h, h) - trace(cof) - det};
    _response = respond(law, moduli, _at);
}

double FiniteStress::energy() const { return energy_of(_law, _moduli, _at); }

Matrix3 FiniteStress::stress() const {
    const double a = _response.a, p = _response.p, b = _response.b;
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
    const auto [a, p, b, a_j, p_j, b_j, p_t, p_q, a_t] = _response;
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

ShapeStress::ShapeStress(Law law, const Moduli &moduli, const Matrix3 &e) : _e(e) {
    const Matrix3 cof = cofactor(e);
    const double t = trace(e), products = trace(cof);
    const double det = e[0] * cof[0] + e[1] * cof[1] + e[2] * cof[2];
    const double more = 2.0 * t + 4.0 * products + 8.0 * det; // det C - 1
    const double j = more / (1.0 + std::sqrt(1.0 + more));
    _at = {j, t, dot(e, e), 0.5 * j * more / (2.0 + j) - 2.0 * products - 4.0 * det};
    _response = respond(law, moduli, _at);
    _energy = energy_of(law, moduli, _at);
    for (std::size_t k = 0; k < 9; ++k)
        _less[k] = ((k % 4 == 0 ? 2.0 * t - j : 0.0) - 2.0 * e[k] + 4.0 * cof[k]) / (1.0 + j);
}

Matrix3 ShapeStress::value() const {
    const double a = _response.a, p = _response.p, b = _response.b;
    Matrix3 s{};
    for (std::size_t k = 0; k < 9; ++k)
        s[k] = (p - a) * _less[k] - b * _e[k] + (k % 4 == 0 ? p + b * _at.t : 0.0);
    return s;
}

Matrix3 ShapeStress::change(const Matrix3 &de) const {
    const auto [a, p, b, a_j, p_j, b_j, p_t, p_q, a_t] = _response;
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
