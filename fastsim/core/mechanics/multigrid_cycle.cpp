// The V-cycle, and the factors of the coarsest matrix.
#include "mechanics/multigrid.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

// Two rows of the finest matrix, or about as many bytes of a coarse one.
constexpr std::ptrdiff_t ahead = 30, ahead_coarse = 6; // [blocks]

template <typename T> void prefetch(const T *from, std::ptrdiff_t distance) {
#if defined(__GNUC__)
    // As numbers: the address may lie outside the array, and is only a hint.
    const auto address =
        reinterpret_cast<std::uintptr_t>(from) +
        static_cast<std::uintptr_t>(distance * static_cast<std::ptrdiff_t>(sizeof(T)));
    for (std::size_t line = 0; line < sizeof(T); line += 64)
        __builtin_prefetch(reinterpret_cast<const void *>(address + line));
#else
    static_cast<void>(from);
    static_cast<void>(distance);
#endif
}

// Position of a row's diagonal block; columns ascend, and every row has one.
std::size_t diagonal_of(const BlockMatrix &matrix, std::size_t row) { return matrix.diagonal[row]; }
std::size_t diagonal_of(const BlockSparse<6, 6> &matrix, std::size_t row) {
    const auto first = matrix.columns.begin() + static_cast<std::ptrdiff_t>(matrix.row_start[row]);
    const auto last =
        matrix.columns.begin() + static_cast<std::ptrdiff_t>(matrix.row_start[row + 1]);
    return at(static_cast<Index>(std::lower_bound(first, last, static_cast<Index>(row)) -
                                 matrix.columns.begin()));
}

/// rest -= sum of A_ik x_k over entries [first, last) of a row, from the last to the first if
/// `is_backward`: memory is then read in one direction throughout a sweep.
template <bool is_backward>
void subtract_row(const BlockMatrix &matrix, std::size_t first, std::size_t last, const double *x,
                  std::array<double, 3> &rest) {
    double r0 = rest[0], r1 = rest[1], r2 = rest[2];
    for (std::size_t count = first; count < last; ++count) {
        const std::size_t k = is_backward ? first + last - 1 - count : count;
        // Half rows and descending rows are beyond what processors foresee by themselves.
        prefetch(matrix.blocks.data() + k, is_backward ? -ahead : ahead);
        const Matrix3 &m = matrix.blocks[k];
        const double *v = x + 3 * at(matrix.columns[k]);
        r0 -= m[0] * v[0] + m[1] * v[1] + m[2] * v[2];
        r1 -= m[3] * v[0] + m[4] * v[1] + m[5] * v[2];
        r2 -= m[6] * v[0] + m[7] * v[1] + m[8] * v[2];
    }
    rest = {r0, r1, r2};
}

/// The same for a coarse level, whose blocks are stored transposed: columns lie together.
template <bool is_backward>
void subtract_row(const BlockSparse<6, 6> &matrix, std::size_t first, std::size_t last,
                  const double *x, std::array<double, 6> &rest) {
    std::array<double, 6> sum = rest;
    for (std::size_t count = first; count < last; ++count) {
        const std::size_t k = is_backward ? first + last - 1 - count : count;
        prefetch(matrix.blocks.data() + k, is_backward ? -ahead_coarse : ahead_coarse);
        const double *column = matrix.blocks[k].data();
        const double *v = x + 6 * at(matrix.columns[k]);
        for (std::size_t c = 0; c < 6; ++c, column += 6)
            for (std::size_t r = 0; r < 6; ++r)
                sum[r] -= column[r] * v[c];
    }
    rest = sum;
}

/// From zero: Gauss-Seidel forward, coarse correction, Gauss-Seidel backward.
template <std::size_t R, typename Matrix, typename Next>
void cycle(const Matrix &matrix, const MultigridLevel<R> &level, std::span<const double> b,
           std::span<double> x, const Next &solve_coarse) {
    const std::size_t n = matrix.num_rows();
    const auto right_side = [&](std::size_t i) {
        std::array<double, R> rest;
        std::copy_n(&b[R * i], R, rest.begin());
        return rest;
    };
    for (std::size_t i = 0; i < n; ++i) {
        std::array<double, R> rest = right_side(i);
        subtract_row<false>(matrix, matrix.row_start[i], diagonal_of(matrix, i), x.data(), rest);
        std::fill_n(&x[R * i], R, 0.0);
        add_product<R, R, double>(level.inverse_diagonal[i], rest.data(), 1.0, &x[R * i]);
    }
    // After that sweep (L + D) x = b, so the residual is -U x: half the matrix.
    std::fill(level.coarse_right.begin(), level.coarse_right.end(), 0.0);
    const BlockSparse<R, 6, float> &basis = level.prolongation;
    for (std::size_t i = 0; i < n; ++i) {
        std::array<double, R> rest{};
        subtract_row<false>(matrix, diagonal_of(matrix, i) + 1, matrix.row_start[i + 1], x.data(),
                            rest);
        for (std::size_t k = basis.row_start[i]; k < basis.row_start[i + 1]; ++k)
            add_transposed_product<R, 6, float>(basis.blocks[k], rest.data(),
                                                &level.coarse_right[6 * at(basis.columns[k])]);
    }
    solve_coarse(level.coarse_right, level.coarse_x);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = basis.row_start[i]; k < basis.row_start[i + 1]; ++k)
            add_product<R, 6, float>(basis.blocks[k], &level.coarse_x[6 * at(basis.columns[k])],
                                     1.0, &x[R * i]);
    for (std::size_t i = n; i-- > 0;) {
        std::array<double, R> rest = right_side(i);
        subtract_row<true>(matrix, matrix.row_start[i], matrix.row_start[i + 1], x.data(), rest);
        add_product<R, R, double>(level.inverse_diagonal[i], rest.data(), 1.0, &x[R * i]);
    }
}

} // namespace

void Multigrid::factor_coarsest(const BlockSparse<6, 6> &matrix) {
    const std::size_t n = 6 * matrix.num_rows();
    _coarsest_size = n;
    _cholesky.assign(n * n, 0.0);
    for (std::size_t i = 0; i < matrix.num_rows(); ++i)
        for (std::size_t k = matrix.row_start[i]; k < matrix.row_start[i + 1]; ++k)
            for (std::size_t r = 0; r < 6; ++r)
                for (std::size_t s = 0; s < 6; ++s)
                    _cholesky[n * (6 * i + r) + 6 * at(matrix.columns[k]) + s] =
                        matrix.blocks[k][6 * r + s];
    double largest = 0.0;
    for (std::size_t i = 0; i < n; ++i)
        largest = std::max(largest, _cholesky[n * i + i]);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j <= i; ++j) {
            double sum = _cholesky[n * i + j];
            for (std::size_t k = 0; k < j; ++k)
                sum -= _cholesky[n * i + k] * _cholesky[n * j + k];
            // A missing basis vector, or a tangent that is not positive definite: leave it out.
            if (i == j)
                _cholesky[n * i + i] =
                    sum > 1e-13 * largest ? std::sqrt(sum) : std::sqrt(largest) * 1e100;
            else
                _cholesky[n * i + j] = sum / _cholesky[n * j + j];
        }
}

void Multigrid::descend(std::size_t depth, std::span<const double> b, std::span<double> x) const {
    if (depth < _coarse.size()) {
        cycle(_matrices[depth], _coarse[depth], b, x,
              [&](std::span<const double> right, std::span<double> result) {
                  descend(depth + 1, right, result);
              });
        return;
    }
    const std::size_t n = _coarsest_size;
    for (std::size_t i = 0; i < n; ++i) {
        double sum = b[i];
        for (std::size_t k = 0; k < i; ++k)
            sum -= _cholesky[n * i + k] * x[k];
        x[i] = sum / _cholesky[n * i + i];
    }
    for (std::size_t i = n; i-- > 0;) {
        x[i] /= _cholesky[n * i + i];
        for (std::size_t k = 0; k < i; ++k)
            x[k] -= _cholesky[n * i + k] * x[i];
    }
}

void Multigrid::apply(const BlockMatrix &matrix, std::span<const double> b,
                      std::span<double> x) const {
    cycle(matrix, _fine, b, x, [&](std::span<const double> right, std::span<double> result) {
        descend(0, right, result);
    });
}

} // namespace fastsim
