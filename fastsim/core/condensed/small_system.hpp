#pragma once
// Small dense systems, by Gaussian elimination with partial pivoting.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

namespace fastsim {

/// Solves A X = B in place of B; A, n x n, and B, n x m, row by row. False where A is singular.
inline bool solve_small(std::span<double> a, std::span<double> b, std::size_t n, std::size_t m) {
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
            for (std::size_t j = k + 1; j < n; ++j)
                a[i * n + j] -= factor * a[k * n + j];
            for (std::size_t j = 0; j < m; ++j)
                b[i * m + j] -= factor * b[k * m + j];
        }
    }
    for (std::size_t k = n; k-- > 0;) {
        for (std::size_t i = k + 1; i < n; ++i) {
            const double factor = a[k * n + i];
            for (std::size_t j = 0; j < m; ++j)
                b[k * m + j] -= factor * b[i * m + j];
        }
        const double inverse = 1.0 / a[k * n + k];
        for (std::size_t j = 0; j < m; ++j)
            b[k * m + j] *= inverse;
    }
    return true;
}

} // namespace fastsim
