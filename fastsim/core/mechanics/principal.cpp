#include "mechanics/principal.hpp"

#include <cmath>

namespace fastsim {

namespace {

// Principal values this near to each other have the limit of the quotient of differences: what
// that leaves out is of the square of it, what rounding adds is eps over it.
constexpr double same = 1e-5;

/// ln l of 2 e = l^2 - 1.
double log_stretch(double strain) { return 0.5 * std::log1p(2.0 * strain); }

/// l - 1.
double stretch_less_one(double strain) {
    return 2.0 * strain / (1.0 + std::sqrt(1.0 + 2.0 * strain));
}

/// exp(x) - 1 - x, by its series where the difference would lose digits.
double exp_excess(double x) {
    if (std::abs(x) > 0.1)
        return std::expm1(x) - x;
    double sum = 1.0;
    for (int n = 12; n >= 3; --n)
        sum = 1.0 + x * sum / n;
    return 0.5 * x * x * sum;
}

/// Kirchhoff's principal stresses t_i and dt_i/ds_k.
PrincipalStress kirchhoff(const ElasticCells &body, const Moduli &moduli,
                          const std::array<double, 3> &e) {
    const double mu = moduli.mu, lmbda = moduli.lmbda;
    std::array<double, 3> s{};
    for (std::size_t i = 0; i < 3; ++i)
        s[i] = log_stretch(e[i]);
    const double log_j = s[0] + s[1] + s[2], j = std::expm1(log_j), J = 1.0 + j;
    PrincipalStress found{};
    auto &[t, slope] = found;
    // A function of J alone has the same t for all i, and the same slopes.
    const auto add_volume = [&](double stress, double change) {
        for (double &of : t)
            of += stress;
        for (double &of : slope)
            of += change;
    };
    if (body.law == Law::corotational) {
        std::array<double, 3> less{};
        for (std::size_t i = 0; i < 3; ++i)
            less[i] = stretch_less_one(e[i]);
        const double sum = less[0] + less[1] + less[2];
        for (std::size_t i = 0; i < 3; ++i) {
            const double l = 1.0 + less[i], rate = 2.0 * mu * less[i] + lmbda * sum;
            t[i] = l * rate;
            for (std::size_t k = 0; k < 3; ++k)
                slope[3 * i + k] = lmbda * l * (1.0 + less[k]);
            slope[4 * i] += l * (rate + 2.0 * mu * l);
        }
        return found;
    }
    for (const auto &[share, alpha] : body.ogden_terms) {
        const double own = 2.0 * mu * share / alpha;
        std::array<double, 3> less{};
        for (std::size_t i = 0; i < 3; ++i)
            less[i] = std::expm1(alpha * (s[i] - log_j / 3.0));
        const double mean = (less[0] + less[1] + less[2]) / 3.0;
        for (std::size_t i = 0; i < 3; ++i) {
            t[i] += own * (less[i] - mean);
            slope[4 * i] += own * alpha * (1.0 + less[i]);
            for (std::size_t k = 0; k < 3; ++k)
                slope[3 * i + k] -= own * alpha / 3.0 * (1.0 + less[i] + less[k] - mean);
        }
    }
    const double kappa = lmbda + 2.0 / 3.0 * mu;
    add_volume(kappa * j * J, kappa * J * (J + j));
    return found;
}

/// S_i of t_i: dt_i/de_k = dt_i/ds_k / l_k^2.
PrincipalStress pulled_back(const PrincipalStress &kirchhoff_of, const std::array<double, 3> &e) {
    PrincipalStress found{};
    for (std::size_t i = 0; i < 3; ++i) {
        const double squared = 1.0 + 2.0 * e[i];
        found.stress[i] = kirchhoff_of.stress[i] / squared;
        for (std::size_t k = 0; k < 3; ++k)
            found.stiffness[3 * i + k] =
                kirchhoff_of.stiffness[3 * i + k] / (squared * (1.0 + 2.0 * e[k]));
        found.stiffness[4 * i] -= 2.0 * found.stress[i] / squared;
    }
    return found;
}

} // namespace

Principal principal_values(const Matrix3 &symmetric) {
    Matrix3 m = symmetric, q{1, 0, 0, 0, 1, 0, 0, 0, 1};
    double size = 0.0;
    for (const double component : m)
        size += component * component;
    for (int sweep = 0; sweep < 20; ++sweep) {
        const double off = m[1] * m[1] + m[2] * m[2] + m[5] * m[5];
        if (off <= 1e-36 * size)
            break;
        for (std::size_t a = 0; a < 2; ++a)
            for (std::size_t b = a + 1; b < 3; ++b) {
                const double beside = m[3 * a + b];
                if (beside == 0.0)
                    continue;
                const double ratio = 0.5 * (m[4 * b] - m[4 * a]) / beside;
                const double tangent =
                    (ratio < 0.0 ? -1.0 : 1.0) / (std::abs(ratio) + std::sqrt(1.0 + ratio * ratio));
                const double cosine = 1.0 / std::sqrt(1.0 + tangent * tangent);
                const double sine = tangent * cosine;
                const std::size_t c = 3 - a - b;
                m[4 * a] -= tangent * beside;
                m[4 * b] += tangent * beside;
                m[3 * a + b] = m[3 * b + a] = 0.0;
                const double ca = m[3 * c + a], cb = m[3 * c + b];
                m[3 * c + a] = m[3 * a + c] = cosine * ca - sine * cb;
                m[3 * c + b] = m[3 * b + c] = sine * ca + cosine * cb;
                for (std::size_t i = 0; i < 3; ++i) {
                    const double qa = q[3 * i + a], qb = q[3 * i + b];
                    q[3 * i + a] = cosine * qa - sine * qb;
                    q[3 * i + b] = sine * qa + cosine * qb;
                }
            }
    }
    return {{m[0], m[4], m[8]}, q};
}

PrincipalStress principal_stress(const ElasticCells &body, const Moduli &moduli,
                                 const std::array<double, 3> &strains) {
    return pulled_back(kirchhoff(body, moduli, strains), strains);
}

PrincipalStress stretch_sum_rate(const std::array<double, 3> &strains) {
    PrincipalStress found{};
    for (std::size_t i = 0; i < 3; ++i) {
        const double squared = 1.0 + 2.0 * strains[i];
        found.stress[i] = 1.0 / std::sqrt(squared);
        found.stiffness[4 * i] = -found.stress[i] / squared;
    }
    return found;
}

double stretch_sum(const std::array<double, 3> &strains) {
    return stretch_less_one(strains[0]) + stretch_less_one(strains[1]) +
           stretch_less_one(strains[2]);
}

double principal_energy(const ElasticCells &body, const Moduli &moduli,
                        const std::array<double, 3> &e) {
    const double mu = moduli.mu, lmbda = moduli.lmbda;
    if (body.law == Law::corotational) {
        const double sum = stretch_sum(e);
        double squares = 0.0;
        for (const double of : e)
            squares += stretch_less_one(of) * stretch_less_one(of);
        return mu * squares + 0.5 * lmbda * sum * sum;
    }
    const std::array<double, 3> s{log_stretch(e[0]), log_stretch(e[1]), log_stretch(e[2])};
    const double log_j = s[0] + s[1] + s[2], j = std::expm1(log_j);
    double energy = 0.5 * (lmbda + 2.0 / 3.0 * mu) * j * j;
    // The stretches without change of volume have a product of 1.
    for (const auto &[share, alpha] : body.ogden_terms)
        for (const double of : s)
            energy += 2.0 * mu * share / (alpha * alpha) * exp_excess(alpha * (of - log_j / 3.0));
    return energy;
}

CoaxialTensor::CoaxialTensor(const Principal &strain, const PrincipalStress &response)
    : _strain(strain), _response(response) {}

Matrix3 CoaxialTensor::value() const {
    const Matrix3 &q = _strain.axes;
    Matrix3 found{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t a = 0; a < 3; ++a)
                found[3 * i + k] += _response.stress[a] * q[3 * i + a] * q[3 * k + a];
    return found;
}

Matrix3 CoaxialTensor::change(const Matrix3 &de) const {
    const Matrix3 &q = _strain.axes;
    const auto &[e, axes] = _strain;
    const auto &[s, slope] = _response;
    Matrix3 own{}, inside{}, half{}, found{};
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t k = 0; k < 3; ++k)
            half[3 * a + k] = q[a] * de[k] + q[3 + a] * de[3 + k] + q[6 + a] * de[6 + k];
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t b = 0; b < 3; ++b)
            own[3 * a + b] =
                half[3 * a] * q[b] + half[3 * a + 1] * q[3 + b] + half[3 * a + 2] * q[6 + b];
    for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t b = 0; b < 3; ++b) {
            inside[4 * a] += slope[3 * a + b] * own[4 * b];
            if (b == a)
                continue;
            const double between = e[a] - e[b];
            const double quotient =
                std::abs(between) > same * (1.0 + std::abs(e[a]) + std::abs(e[b]))
                    ? (s[a] - s[b]) / between
                    : 0.5 * (slope[4 * a] - slope[3 * a + b] + slope[4 * b] - slope[3 * b + a]);
            inside[3 * a + b] = quotient * own[3 * a + b];
        }
    }
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t k = 0; k < 3; ++k)
            half[3 * a + k] = inside[3 * a] * q[3 * k] + inside[3 * a + 1] * q[3 * k + 1] +
                              inside[3 * a + 2] * q[3 * k + 2];
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t k = 0; k < 3; ++k)
            found[3 * i + k] =
                q[3 * i] * half[k] + q[3 * i + 1] * half[3 + k] + q[3 * i + 2] * half[6 + k];
    return found;
}

Matrix3 pushed(const Matrix3 &f, const Matrix3 &s) {
    Matrix3 p{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            p[3 * i + j] = f[3 * i] * s[j] + f[3 * i + 1] * s[3 + j] + f[3 * i + 2] * s[6 + j];
    return p;
}

Matrix3 pushed_change(const Matrix3 &f, const CoaxialTensor &stress, const Matrix3 &s,
                      const Matrix3 &dh) {
    Matrix3 de{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t k = 0; k < 3; ++k)
                de[3 * i + j] +=
                    0.5 * (f[3 * k + i] * dh[3 * k + j] + dh[3 * k + i] * f[3 * k + j]);
    Matrix3 dp = pushed(f, stress.change(de));
    const Matrix3 more = pushed(dh, s);
    for (std::size_t k = 0; k < 9; ++k)
        dp[k] += more[k];
    return dp;
}

StressByStretches::StressByStretches(const ElasticCells &body, const Moduli &moduli,
                                     const Matrix3 &h)
    : StressByStretches(body, moduli, h, principal_values(strain_tensor(h, StrainMeasure::green))) {
}

StressByStretches::StressByStretches(const ElasticCells &body, const Moduli &moduli,
                                     const Matrix3 &h, const Principal &strain)
    : _energy(principal_energy(body, moduli, strain.values)), _f(deformation_gradient(h)),
      _stress(strain, principal_stress(body, moduli, strain.values)) {
    _s = _stress.value();
    _p = pushed(_f, _s);
}

Matrix3 StressByStretches::change(const Matrix3 &dh) const {
    return pushed_change(_f, _stress, _s, dh);
}

} // namespace fastsim
