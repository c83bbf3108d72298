#include "mechanics/conjugate_gradient.hpp"

#include <cmath>
#include <vector>

namespace fastsim {

namespace {

double dot(std::span<const double> a, std::span<const double> b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i)
        sum += a[i] * b[i];
    return sum;
}

/// Inverse of each diagonal block with held components cut out; by the adjugate.
std::vector<Matrix3> inverse_diagonal(const BlockMatrix &matrix,
                                      std::span<const std::uint8_t> is_free) {
    std::vector<Matrix3> inverse(matrix.num_points);
    for (std::size_t i = 0; i < matrix.num_points; ++i) {
        Matrix3 m = matrix.blocks[matrix.diagonal[i]];
        for (std::size_t a = 0; a < 3; ++a)
            if (is_free[3 * i + a] == 0)
                for (std::size_t b = 0; b < 3; ++b)
                    m[3 * a + b] = m[3 * b + a] = a == b ? 1.0 : 0.0;
        const double det = determinant(m);
        Matrix3 &inv = inverse[i];
        // A block that is not positive definite still gives a usable, if poor, scaling.
        if (!(det > 0.0 && m[0] > 0.0 && m[0] * m[4] - m[1] * m[3] > 0.0)) {
            inv = Matrix3{};
            for (std::size_t a = 0; a < 3; ++a)
                inv[4 * a] = 1.0 / std::max(std::abs(m[4 * a]), 1e-300);
            continue;
        }
        inv = {(m[4] * m[8] - m[5] * m[7]) / det, (m[2] * m[7] - m[1] * m[8]) / det,
               (m[1] * m[5] - m[2] * m[4]) / det, (m[5] * m[6] - m[3] * m[8]) / det,
               (m[0] * m[8] - m[2] * m[6]) / det, (m[2] * m[3] - m[0] * m[5]) / det,
               (m[3] * m[7] - m[4] * m[6]) / det, (m[1] * m[6] - m[0] * m[7]) / det,
               (m[0] * m[4] - m[1] * m[3]) / det};
    }
    return inverse;
}

} // namespace

SolveResult conjugate_gradient(const BlockMatrix &matrix, std::span<const double> b,
                               std::span<const std::uint8_t> is_free, double absolute_tolerance,
                               std::int64_t max_iterations, const Multigrid *multigrid,
                               std::span<double> x) {
    const std::size_t n = b.size();
    const std::vector<Matrix3> inverse =
        multigrid == nullptr ? inverse_diagonal(matrix, is_free) : std::vector<Matrix3>{};
    std::vector<double> r(n), z(n), p(n), q(n);
    for (std::size_t i = 0; i < n; ++i)
        r[i] = is_free[i] ? b[i] : 0.0;
    const auto precondition = [&]() {
        if (multigrid != nullptr) {
            multigrid->apply(matrix, r, z);
            return;
        }
        for (std::size_t i = 0; i < matrix.num_points; ++i) {
            const Matrix3 &m = inverse[i];
            const double *v = &r[3 * i];
            for (std::size_t a = 0; a < 3; ++a)
                z[3 * i + a] = is_free[3 * i + a]
                                   ? m[3 * a] * v[0] + m[3 * a + 1] * v[1] + m[3 * a + 2] * v[2]
                                   : 0.0;
        }
    };
    double residual = std::sqrt(dot(r, r));
    if (residual <= absolute_tolerance)
        return {SolveStatus::converged, 0, residual};
    precondition();
    p = z;
    double rz = dot(r, z);
    for (std::int64_t k = 1; k <= max_iterations; ++k) {
        multiply(matrix, p, q);
        for (std::size_t i = 0; i < n; ++i)
            if (!is_free[i])
                q[i] = 0.0;
        const double curvature = dot(p, q);
        if (!(curvature > 0.0))
            return {SolveStatus::negative_curvature, k, residual};
        const double alpha = rz / curvature;
        for (std::size_t i = 0; i < n; ++i) {
            x[i] += alpha * p[i];
            r[i] -= alpha * q[i];
        }
        residual = std::sqrt(dot(r, r));
        if (residual <= absolute_tolerance)
            return {SolveStatus::converged, k, residual};
        precondition();
        const double rz_next = dot(r, z);
        const double beta = rz_next / rz;
        rz = rz_next;
        for (std::size_t i = 0; i < n; ++i)
            p[i] = z[i] + beta * p[i];
    }
    return {SolveStatus::iteration_limit, max_iterations, residual};
}

} // namespace fastsim
