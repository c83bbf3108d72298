// Forces of the laws of mechanics/law.hpp other than Saint-Venant-Kirchhoff's, over a Pack; the
// formulas are those of mechanics/law.hpp, the stress (L4) of mechanics/hyperelastic.hpp. Included
// between step_kernel.inl's parts.

/// Integers as wide as the numbers of a vector.
template <typename V> using IntegersOf = decltype(V{} < V{});

/// What a number's bits are made of.
template <typename Real> struct Bits;
template <> struct Bits<float> {
    using Integer = std::int32_t;
    static constexpr int mantissa = 23;
    static constexpr Integer root_half = 0x3f3504f3; // of sqrt(1/2)
    // 4/3 of the bits of 1 less what makes the guess's error even.
    static constexpr float guess = 1419967104.0f;
    static constexpr int log_terms = 5, root_rounds = 3;
};
template <> struct Bits<double> {
    using Integer = std::int64_t;
    static constexpr int mantissa = 52;
    static constexpr Integer root_half = 0x3fe6a09e667f3bcd;
    static constexpr double guess = 6142639395932058112.0;
    static constexpr int log_terms = 11, root_rounds = 4;
};

/// Functions of a law's formulas, for the numbers of a vector.
template <typename Number> struct PackMath {
    using Real = Number;
    using B = Bits<Real>;

    /// ln(1 + x) for x > -1; what comes of others is no number of use.
    /// 1 + x = 2^k m with m in [sqrt(1/2), sqrt(2)); ln m = 2 artanh(f / (2 + f)), f = m - 1, by
    /// its series. Where k is 0, f is x itself, so that small x keep all their digits.
    template <typename V> static V log_of_one_plus(V x) {
        using I = IntegersOf<V>;
        const V y = Real(1) + x;
        I bits;
        __builtin_memcpy(&bits, &y, sizeof(V));
        const I k = (bits - B::root_half) >> B::mantissa;
        bits -= k << B::mantissa;
        V m;
        __builtin_memcpy(&m, &bits, sizeof(V));
        const V f = k == 0 ? x : m - Real(1);
        const V s = f / (Real(2) + f), squared = s * s;
        V sum = V{} + Real(1) / Real(2 * B::log_terms - 1);
        for (int n = B::log_terms - 2; n >= 0; --n)
            sum = Real(1) / Real(2 * n + 1) + squared * sum;
        return Real(2) * s * sum + __builtin_convertvector(k, V) * Real(0.693147180559945309417);
    }

    /// x^(-1/3) for x > 0: a guess by the bits of x, then Newton's y (4 - x y^3) / 3.
    template <typename V> static V inverse_cube_root(V x) {
        using I = IntegersOf<V>;
        I bits;
        __builtin_memcpy(&bits, &x, sizeof(V));
        const V guess = B::guess - __builtin_convertvector(bits, V) * Real(1.0 / 3.0);
        bits = __builtin_convertvector(guess, I);
        V y;
        __builtin_memcpy(&y, &bits, sizeof(V));
        for (int round = 0; round < B::root_rounds; ++round)
            y = y * (Real(4) - x * y * y * y) * Real(1.0 / 3.0);
        return y;
    }
};

/// Forces on corners 1 to 3 of a batch of cells, in place of their displacements relative to
/// corner 0; returns det F.
template <typename Pack, typename Formulas>
inline typename Pack::V forces_by_law(const ForceJob<typename Pack::Real> &job, std::size_t batch,
                                      typename Pack::V *edges) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width;
    const Real *rest = job.rest + 10 * width * batch;
    V g[9], h[9];
    for (std::size_t k = 0; k < 9; ++k)
        g[k] = Pack::load(rest + k * width);
    gradient_of(g, edges, h);
    ModuliOf moduli{V{} + job.lmbda, V{} + job.mu, V{} + job.c01};
    if (job.moduli) {
        const Real *const own = job.moduli + 3 * width * batch;
        moduli = {Pack::load(own), Pack::load(own + width), Pack::load(own + 2 * width)};
    }
    // cof F = I + d.
    V d[9] = {h[4] * h[8] - h[5] * h[7], h[5] * h[6] - h[3] * h[8], h[3] * h[7] - h[4] * h[6],
              h[2] * h[7] - h[1] * h[8], h[0] * h[8] - h[2] * h[6], h[1] * h[6] - h[0] * h[7],
              h[1] * h[5] - h[2] * h[4], h[2] * h[3] - h[0] * h[5], h[0] * h[4] - h[1] * h[3]};
    const V trace = h[0] + h[4] + h[8];
    const V j = trace + (d[0] + d[4] + d[8]) + (h[0] * d[0] + h[1] * d[1] + h[2] * d[2]);
    d[0] += h[4] + h[8], d[4] += h[0] + h[8], d[8] += h[0] + h[4];
    d[1] -= h[3], d[2] -= h[6], d[3] -= h[1], d[5] -= h[7], d[6] -= h[2], d[7] -= h[5];
    V t{}, q{}, e[6]; // e: twice E
    if constexpr (Formulas::reads_trace) {
        twice_strain<true>(h, e);
        t = Real(0.5) * (e[0] + e[1] + e[2]);
    }
    if constexpr (Formulas::reads_second)
        q = Real(0.25) * (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) +
            Real(0.5) * (e[3] * e[3] + e[4] * e[4] + e[5] * e[5]);
    const auto [a, p, b] = Formulas::template coefficients<PackMath<Real>>(moduli, j, t, q);
    V stress[9];
    for (std::size_t k = 0; k < 9; ++k)
        stress[k] = a * h[k] + (p - a) * d[k];
    if constexpr (Formulas::reads_second) {
        // G = b (t I - E), then F G.
        const V half = Real(0.5) * b;
        const V s[6] = {b * t - half * e[0], b * t - half * e[1], b * t - half * e[2],
                        -half * e[3],        -half * e[4],        -half * e[5]};
        const V full[9] = {s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]};
        for (std::size_t i = 0; i < 9; i += 3)
            for (std::size_t k = 0; k < 3; ++k)
                stress[i + k] +=
                    full[i + k] + h[i] * full[k] + h[i + 1] * full[3 + k] + h[i + 2] * full[6 + k];
    }
    stress[0] += p, stress[4] += p, stress[8] += p;
    const V volume = Pack::load(rest + 9 * width);
    for (std::size_t k = 0; k < 9; ++k)
        stress[k] *= volume;
    for (std::size_t c = 0; c < 3; ++c)
        for (std::size_t i = 0; i < 3; ++i)
            edges[3 * c + i] = stress[3 * i] * g[3 * c] + stress[3 * i + 1] * g[3 * c + 1] +
                               stress[3 * i + 2] * g[3 * c + 2];
    return Real(1) + j;
}
