#include "condensed/small_system.hpp"

#include "slivers/wide.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

/// row -= factor * other, of rows that do not overlap.
[[gnu::always_inline]] inline void subtract(double *__restrict row, const double *__restrict other,
                                            double factor, std::size_t count) {
    for (std::size_t j = 0; j < count; ++j)
        row[j] -= factor * other[j];
}

} // namespace

PALPATE_WIDE bool solve_small(std::span<double> a, std::span<double> b, std::size_t n,
                              std::size_t m) {
    for (std::size_t k = 0; k < n; ++k) {
        std::size_t pivot = k;
        for (std::size_t i = k + 1; i < n; ++i)
            if (std::abs(a[i * n + k]) > std::abs(a[pivot * n + k]))
                pivot = i;
        if (!(std::abs(a[pivot * n + k]) > 0.0))
            return false;
        if (pivot != k) {
            std::swap_ranges(&a[k * n], &a[k * n] + n, &a[pivot * n]);
            std::swap_ranges(&b[k * m], &b[k * m] + m, &b[pivot * m]);
        }
        const double inverse = 1.0 / a[k * n + k];
        for (std::size_t i = k + 1; i < n; ++i) {
            const double factor = a[i * n + k] * inverse;
            if (factor == 0.0)
                continue;
            subtract(&a[i * n] + k + 1, &a[k * n] + k + 1, factor, n - k - 1);
            subtract(&b[i * m], &b[k * m], factor, m);
        }
    }
    for (std::size_t k = n; k-- > 0;) {
        for (std::size_t i = k + 1; i < n; ++i)
            subtract(&b[k * m], &b[i * m], a[k * n + i], m);
        const double inverse = 1.0 / a[k * n + k];
        for (std::size_t j = 0; j < m; ++j)
            b[k * m + j] *= inverse;
    }
    return true;
}

} // namespace fastsim
