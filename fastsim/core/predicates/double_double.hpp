#pragma once
// Numbers as the sum of two doubles, about 106 bits. Additions err by at most 3 u^2 relative,
// products by at most 7 u^2, u = 2^-53 (Joldes, Muller, Popescu 2017, Tight and rigorous error
// bounds for basic building blocks of double-word arithmetic, algorithms 6 and 10).
// Needs IEEE rounding: no contraction into fused multiply-adds.

namespace fastsim {

struct DoubleDouble {
    double high = 0.0;
    double low = 0.0;
};

/// a + b exactly, |a| >= |b| or a = 0.
inline DoubleDouble quick_sum(double a, double b) {
    const double sum = a + b;
    return {sum, b - (sum - a)};
}

/// a + b exactly.
inline DoubleDouble exact_sum(double a, double b) {
    const double sum = a + b;
    const double part = sum - a;
    return {sum, (a - (sum - part)) + (b - part)};
}

/// a b exactly (Dekker 1971), where nothing overflows or underflows.
inline DoubleDouble exact_product(double a, double b) {
    constexpr double splitter = 134217729.0; // 2^27 + 1
    const double ca = splitter * a, cb = splitter * b;
    const double a_high = ca - (ca - a), b_high = cb - (cb - b);
    const double a_low = a - a_high, b_low = b - b_high;
    const double product = a * b;
    return {product,
            a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)};
}

inline DoubleDouble operator+(const DoubleDouble &x, const DoubleDouble &y) {
    const DoubleDouble s = exact_sum(x.high, y.high), t = exact_sum(x.low, y.low);
    const DoubleDouble v = quick_sum(s.high, s.low + t.high);
    return quick_sum(v.high, t.low + v.low);
}

inline DoubleDouble operator-(const DoubleDouble &x) { return {-x.high, -x.low}; }
inline DoubleDouble operator-(const DoubleDouble &x, const DoubleDouble &y) { return x + (-y); }

inline DoubleDouble operator*(const DoubleDouble &x, const DoubleDouble &y) {
    const DoubleDouble p = exact_product(x.high, y.high);
    return quick_sum(p.high, p.low + (x.high * y.low + x.low * y.high));
}

} // namespace fastsim
