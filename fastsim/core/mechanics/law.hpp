#pragma once
// The laws a body may follow under finite strain: their names, and the formulas of those that are
// written in invariants. A new one is a name in FASTSIM_LAWS and a `LawFormulas`: statics, explicit
// steps and Python take it from here. (Laws of stretches: mechanics/principal.hpp.)
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
//
// No library is included here, because step_kernel.hpp includes this file. `Math` has the functions
// of numbers and is a type of the translation unit's own, so that an instance which was built for
// one instruction set is never linked for another.

namespace fastsim {

#define FASTSIM_LAWS(LAW)                                                                          \
    LAW(saint_venant_kirchhoff)                                                                    \
    LAW(neo_hookean_stable)                                                                        \
    LAW(neo_hookean_stable_log)                                                                    \
    LAW(neo_hookean)                                                                               \
    LAW(mooney_rivlin)                                                                             \
    LAW(mooney_rivlin_log)                                                                         \
    LAW(ogden)                                                                                     \
    LAW(corotational)

enum class Law {
#define FASTSIM_NAME(name) name,
    FASTSIM_LAWS(FASTSIM_NAME)
#undef FASTSIM_NAME
};

/// Whether a law is written in principal stretches (mechanics/principal.hpp).
constexpr bool is_of_stretches(Law law) { return law == Law::ogden || law == Law::corotational; }

/// Moduli at rest [Pa]: Lamé's, and the part c01 of mu/2 that goes with the second invariant
/// (mooney_rivlin alone). V is a number, or one for each of several cells.
template <typename V> struct ModuliOf {
    V lmbda, mu, c01;
};
template <typename V> ModuliOf(V, V, V) -> ModuliOf<V>;
using Moduli = ModuliOf<double>;

/// Coefficients of P = a (F - cof F) + p cof F + b F (t I - E) (L4): a and b are of shape, p is the
/// pressure.
template <typename V> struct StressCoefficients {
    V a, p, b;
};

/// What the coefficients change with: j = J - 1, t and q. Those that are not named here are 0.
struct CoefficientRates {
    double a_j = 0.0, p_j = 0.0, b_j = 0.0, p_t = 0.0, p_q = 0.0, a_t = 0.0;
};

/// Where a law is evaluated: t, q, j, and t - j, formed without cancellation.
struct Invariants {
    double j, t, q, t_less_j;
};

/// The formulas of one law: `coefficients` of (L4), their `rates`, and `energy` W, 0 at rest.
/// `reads_trace` says whether t is read, `reads_second` whether q is, and b may not be 0.
template <Law law> struct LawFormulas {
    static constexpr bool are_there = false;
};

template <> struct LawFormulas<Law::neo_hookean_stable> {
    static constexpr bool are_there = true, reads_trace = false, reads_second = false;

    template <typename Math, typename V>
    static StressCoefficients<V> coefficients(const ModuliOf<V> &m, V j, V, V) {
        return {m.mu, (m.lmbda + m.mu) * j, V{}};
    }
    template <typename Math> static CoefficientRates rates(const Moduli &m, const Invariants &) {
        return {.p_j = m.lmbda + m.mu};
    }
    template <typename Math> static double energy(const Moduli &m, const Invariants &at) {
        return m.mu * at.t_less_j + 0.5 * (m.lmbda + m.mu) * at.j * at.j;
    }
};

template <> struct LawFormulas<Law::neo_hookean_stable_log> {
    static constexpr bool are_there = true, reads_trace = true, reads_second = false;

    template <typename Math, typename V>
    static StressCoefficients<V> coefficients(const ModuliOf<V> &m, V j, V t, V) {
        using Real = typename Math::Real;
        const V over = Real(1) / (Real(2) + t);
        return {Real(2.0 / 3.0) * m.mu * (Real(2) - over),
                (m.lmbda + Real(5.0 / 6.0) * m.mu) * j + Real(1.0 / 3.0) * m.mu * t * over, V{}};
    }
    template <typename Math> static CoefficientRates rates(const Moduli &m, const Invariants &at) {
        const double by_trace = 2.0 / 3.0 * m.mu / ((2.0 + at.t) * (2.0 + at.t));
        return {.p_j = m.lmbda + 5.0 / 6.0 * m.mu, .p_t = by_trace, .a_t = by_trace};
    }
    template <typename Math> static double energy(const Moduli &m, const Invariants &at) {
        return m.mu * at.t_less_j + 2.0 / 3.0 * m.mu * Math::log_excess(0.5 * at.t) +
               0.5 * (m.lmbda + 5.0 / 6.0 * m.mu) * at.j * at.j;
    }
};

template <> struct LawFormulas<Law::neo_hookean> {
    static constexpr bool are_there = true, reads_trace = false, reads_second = false;

    template <typename Math, typename V>
    static StressCoefficients<V> coefficients(const ModuliOf<V> &m, V j, V, V) {
        using Real = typename Math::Real;
        return {m.mu, (m.mu * j + m.lmbda * Math::log_of_one_plus(j)) / (Real(1) + j), V{}};
    }
    template <typename Math> static CoefficientRates rates(const Moduli &m, const Invariants &at) {
        const double J = 1.0 + at.j, p = coefficients<Math>(m, at.j, at.t, at.q).p;
        return {.p_j = (m.mu + m.lmbda / J - p) / J};
    }
    template <typename Math> static double energy(const Moduli &m, const Invariants &at) {
        const double log_j = Math::log_of_one_plus(at.j);
        return m.mu * (at.t_less_j + Math::log_excess(at.j)) + 0.5 * m.lmbda * log_j * log_j;
    }
};

template <bool is_log> struct MooneyRivlinFormulas {
    static constexpr bool are_there = true, reads_trace = true, reads_second = true;

    template <typename Math, typename V>
    static StressCoefficients<V> coefficients(const ModuliOf<V> &m, V j, V t, V q) {
        using Real = typename Math::Real;
        const V root = Math::inverse_cube_root(Real(1) + j), squared = root * root;
        const V first = (m.mu - Real(2) * m.c01) * squared;
        const V second = Real(4) * m.c01 * squared * squared;
        const V of_shape = first * (Real(3) * j - Real(2) * t) +
                           second * (Real(3) * j - Real(4) * t - Real(2) * (t * t - q));
        // 1 / J is the root's cube.
        const V over = squared * root, kappa = m.lmbda + Real(2.0 / 3.0) * m.mu;
        V p;
        if constexpr (is_log)
            p = kappa * Math::log_of_one_plus(j) * over;
        else
            p = kappa * j;
        return {first + second, p + of_shape * over * Real(1.0 / 3.0), second};
    }
    template <typename Math> static CoefficientRates rates(const Moduli &m, const Invariants &at) {
        const double j = at.j, t = at.t, J = 1.0 + j, root = Math::inverse_cube_root(J);
        const double kappa = m.lmbda + 2.0 / 3.0 * m.mu;
        const double first = (m.mu - 2.0 * m.c01) * root * root;
        const double second = 4.0 * m.c01 * root * root * root * root;
        const double q1 = 3.0 * j - 2.0 * t, q2 = 3.0 * j - 4.0 * t - 2.0 * (t * t - at.q);
        const double by_volume =
            is_log ? kappa * (1.0 - Math::log_of_one_plus(j)) / (J * J) : kappa;
        return {.a_j = (-2.0 / 3.0 * first - 4.0 / 3.0 * second) / J,
                .p_j = by_volume + (first + second) / J -
                       (5.0 / 3.0 * first * q1 + 7.0 / 3.0 * second * q2) / (3.0 * J * J),
                .b_j = -4.0 / 3.0 * second / J,
                .p_t = (-2.0 * first - 4.0 * second * (1.0 + t)) / (3.0 * J),
                .p_q = 2.0 * second / (3.0 * J)};
    }
    template <typename Math> static double energy(const Moduli &m, const Invariants &at) {
        const double j = at.j, log_j = Math::log_of_one_plus(j);
        const double kappa = m.lmbda + 2.0 / 3.0 * m.mu;
        const double less1 = Math::exp_less_one(-2.0 / 3.0 * log_j);
        const double less2 = Math::exp_less_one(-4.0 / 3.0 * log_j);
        const double first =
            2.0 * (1.0 + less1) * at.t_less_j + ((3.0 + 2.0 * j) * less1 + 2.0 * j);
        const double second = (1.0 + less2) * (4.0 * at.t_less_j + 2.0 * (at.t * at.t - at.q)) +
                              ((3.0 + 4.0 * j) * less2 + 4.0 * j);
        return (0.5 * m.mu - m.c01) * first + m.c01 * second +
               0.5 * kappa * (is_log ? log_j * log_j : j * j);
    }
};
template <> struct LawFormulas<Law::mooney_rivlin> : MooneyRivlinFormulas<false> {};
template <> struct LawFormulas<Law::mooney_rivlin_log> : MooneyRivlinFormulas<true> {};

/// Whether lmbda's part of W is lmbda/2 (ln J)^2, and not of J - 1.
constexpr bool is_by_log_of_volume(Law law) {
    return law == Law::neo_hookean || law == Law::mooney_rivlin_log;
}

/// `use(LawFormulas<law>{})`, or `otherwise()` of a law that has none.
template <typename Use, typename Otherwise>
auto with_formulas(Law law, Use &&use, Otherwise &&otherwise) {
    switch (law) {
#define FASTSIM_CASE(name)                                                                         \
    case Law::name:                                                                                \
        if constexpr (LawFormulas<Law::name>::are_there)                                           \
            return use(LawFormulas<Law::name>{});                                                  \
        else                                                                                       \
            return otherwise();
        FASTSIM_LAWS(FASTSIM_CASE)
#undef FASTSIM_CASE
    }
    return otherwise();
}

} // namespace fastsim
