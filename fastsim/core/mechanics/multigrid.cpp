#include "mechanics/multigrid.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

namespace {

constexpr std::size_t largest_coarsest = 120; // aggregates whose matrix is factored
constexpr std::size_t most_levels = 10;
constexpr Index unassigned = -1;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// Inverse by Gauss-Jordan without pivoting, fit for positive definite blocks; rows whose pivot
/// is not positive are left out (zero), so a coarse basis vector that is missing does no harm.
template <std::size_t R> Block<R, R> inverse_of(Block<R, R> m) {
    Block<R, R> inverse{};
    double largest = 0.0;
    for (std::size_t i = 0; i < R; ++i) {
        inverse[R * i + i] = 1.0;
        largest = std::max(largest, m[R * i + i]);
    }
    for (std::size_t i = 0; i < R; ++i) {
        const double pivot = m[R * i + i];
        if (!(pivot > 1e-13 * largest)) {
            for (std::size_t j = 0; j < R; ++j)
                m[R * i + j] = m[R * j + i] = inverse[R * i + j] = inverse[R * j + i] = 0.0;
            continue;
        }
        for (std::size_t j = 0; j < R; ++j) {
            m[R * i + j] /= pivot;
            inverse[R * i + j] /= pivot;
        }
        for (std::size_t k = 0; k < R; ++k) {
            if (k == i)
                continue;
            const double factor = m[R * k + i];
            for (std::size_t j = 0; j < R; ++j) {
                m[R * k + j] -= factor * m[R * i + j];
                inverse[R * k + j] -= factor * inverse[R * i + j];
            }
        }
    }
    return inverse;
}

std::vector<Block<6, 6>> inverse_diagonal_of(const BlockSparse<6, 6> &matrix) {
    std::vector<Block<6, 6>> inverse(matrix.num_rows());
    for (std::size_t i = 0; i < matrix.num_rows(); ++i)
        for (std::size_t k = matrix.row_start[i]; k < matrix.row_start[i + 1]; ++k)
            if (at(matrix.columns[k]) == i)
                inverse[i] = inverse_of<6>(matrix.blocks[k]);
    return inverse;
}

/// Held components are cut out: zero rows and columns.
std::vector<Matrix3> inverse_diagonal_of(const BlockMatrix &matrix,
                                         std::span<const std::uint8_t> is_free) {
    std::vector<Matrix3> inverse(matrix.num_points);
    for (std::size_t i = 0; i < matrix.num_points; ++i) {
        Matrix3 block = matrix.blocks[matrix.diagonal[i]];
        for (std::size_t r = 0; r < 3; ++r)
            for (std::size_t s = 0; s < 3; ++s)
                if (is_free[3 * i + r] == 0 || is_free[3 * i + s] == 0)
                    block[3 * r + s] = 0.0;
        inverse[i] = inverse_of<3>(block);
    }
    return inverse;
}

/// Greedy aggregates: whole neighbourhoods first, then what is left joins a neighbour's.
template <typename Matrix>
std::vector<Index> aggregate(const Matrix &matrix, const std::vector<bool> &is_active,
                             std::size_t &num_aggregates) {
    const std::size_t n = matrix.num_rows();
    std::vector<Index> of(n, unassigned);
    Index count = 0;
    const auto neighbours = [&](std::size_t i) {
        return std::span(matrix.columns.data() + matrix.row_start[i],
                         matrix.row_start[i + 1] - matrix.row_start[i]);
    };
    for (std::size_t i = 0; i < n; ++i) {
        if (!is_active[i] || of[i] != unassigned)
            continue;
        bool is_clear = true;
        for (const Index j : neighbours(i))
            is_clear = is_clear && of[at(j)] == unassigned;
        if (!is_clear)
            continue;
        for (const Index j : neighbours(i))
            if (is_active[at(j)])
                of[at(j)] = count;
        ++count;
    }
    const std::vector<Index> roots = of;
    for (std::size_t i = 0; i < n; ++i) {
        if (!is_active[i] || of[i] != unassigned)
            continue;
        for (const Index j : neighbours(i))
            if (roots[at(j)] != unassigned) {
                of[i] = roots[at(j)];
                break;
            }
        if (of[i] == unassigned)
            of[i] = count++;
    }
    num_aggregates = static_cast<std::size_t>(count);
    return of;
}

/// Orthonormal rigid modes of each aggregate; `modes` (6 for each row) becomes the coarse modes.
template <std::size_t R>
BlockSparse<R, 6> tentative_basis(const std::vector<Index> &of, std::size_t num_aggregates,
                                  std::vector<Block<R, 6>> &modes,
                                  std::vector<Block<6, 6>> &coarse_modes) {
    std::vector<std::vector<std::size_t>> members(num_aggregates);
    for (std::size_t i = 0; i < of.size(); ++i)
        if (of[i] != unassigned)
            members[at(of[i])].push_back(i);
    coarse_modes.assign(num_aggregates, {});
    for (std::size_t a = 0; a < num_aggregates; ++a)
        for (std::size_t c = 0; c < 6; ++c) {
            const auto dot = [&](std::size_t p, std::size_t q) {
                double sum = 0.0;
                for (const std::size_t i : members[a])
                    for (std::size_t r = 0; r < R; ++r)
                        sum += modes[i][6 * r + p] * modes[i][6 * r + q];
                return sum;
            };
            const double before = std::sqrt(dot(c, c));
            for (int sweep = 0; sweep < 2; ++sweep) // twice is enough
                for (std::size_t p = 0; p < c; ++p) {
                    const double along = dot(p, c);
                    coarse_modes[a][6 * p + c] += along;
                    for (const std::size_t i : members[a])
                        for (std::size_t r = 0; r < R; ++r)
                            modes[i][6 * r + c] -= along * modes[i][6 * r + p];
                }
            const double norm = std::sqrt(dot(c, c));
            // Too few points in the aggregate for this mode: no basis vector.
            const bool is_new = norm > 1e-6 * before;
            coarse_modes[a][6 * c + c] = is_new ? norm : 0.0;
            for (const std::size_t i : members[a])
                for (std::size_t r = 0; r < R; ++r)
                    modes[i][6 * r + c] = is_new ? modes[i][6 * r + c] / norm : 0.0;
        }
    BlockSparse<R, 6> basis;
    basis.num_columns = num_aggregates;
    for (std::size_t i = 0; i < of.size(); ++i) {
        if (of[i] != unassigned) {
            basis.columns.push_back(of[i]);
            basis.blocks.push_back(modes[i]);
        }
        basis.row_start.push_back(basis.columns.size());
    }
    return basis;
}

/// y = A x.
template <std::size_t R, typename Matrix>
void multiply_into(const Matrix &a, const std::vector<double> &x, std::vector<double> &y) {
    for (std::size_t i = 0; i < a.num_rows(); ++i) {
        std::array<double, R> sum{};
        for (std::size_t k = a.row_start[i]; k < a.row_start[i + 1]; ++k)
            add_product<R, R, double>(a.blocks[k], &x[R * at(a.columns[k])], 1.0, sum.data());
        std::copy(sum.begin(), sum.end(), &y[R * i]);
    }
}

/// Largest eigenvalue of D^-1 A by power iteration from a fixed start.
template <std::size_t R, typename Matrix>
double largest_eigenvalue(const Matrix &matrix, const std::vector<Block<R, R>> &inverse_diagonal) {
    const std::size_t n = R * matrix.num_rows();
    std::vector<double> x(n), y(n);
    for (std::size_t i = 0; i < n; ++i)
        x[i] = 0.5 + static_cast<double>((i * 2654435761u) % 1024u) / 1024.0 - (i % 2 ? 1.5 : 0.0);
    double value = 1.0;
    for (int iteration = 0; iteration < 12; ++iteration) {
        multiply_into<R>(matrix, x, y);
        std::fill(x.begin(), x.end(), 0.0);
        double squared = 0.0;
        for (std::size_t i = 0; i < matrix.num_rows(); ++i)
            add_product<R, R, double>(inverse_diagonal[i], &y[R * i], 1.0, &x[R * i]);
        for (const double v : x)
            squared += v * v;
        value = std::sqrt(squared);
        if (!(value > 0.0))
            return 1.0;
        for (double &v : x)
            v /= value;
    }
    return value;
}

/// (I - omega D^-1 A) times the tentative basis, in single precision.
template <std::size_t R, typename Matrix>
BlockSparse<R, 6, float> smoothed_basis(const Matrix &matrix,
                                        const std::vector<Block<R, R>> &inverse_diagonal,
                                        const BlockSparse<R, 6> &basis) {
    // The power iteration comes from below: 1.1 on its value.
    const double omega = 4.0 / (3.0 * 1.1 * largest_eigenvalue<R>(matrix, inverse_diagonal));
    BlockSparse<R, 6> whole = product<R, R, 6>(matrix, basis);
    BlockSparse<R, 6, float> smoothed;
    smoothed.num_columns = basis.num_columns;
    smoothed.blocks.resize(whole.blocks.size());
    for (std::size_t i = 0; i < whole.num_rows(); ++i)
        for (std::size_t k = whole.row_start[i]; k < whole.row_start[i + 1]; ++k) {
            Block<R, 6> result{};
            add_product<R, R, 6, double>(inverse_diagonal[i], whole.blocks[k], -omega, result);
            const std::size_t own = basis.row_start[i];
            if (own < basis.row_start[i + 1] && basis.columns[own] == whole.columns[k])
                for (std::size_t e = 0; e < R * 6; ++e)
                    result[e] += basis.blocks[own][e];
            for (std::size_t e = 0; e < R * 6; ++e)
                smoothed.blocks[k][e] = static_cast<float>(result[e]);
        }
    smoothed.row_start = std::move(whole.row_start);
    smoothed.columns = std::move(whole.columns);
    return smoothed;
}

/// Fills a level whose inverse diagonal is set; returns the next matrix.
template <std::size_t R, typename Matrix>
BlockSparse<6, 6> coarsen(const Matrix &matrix, MultigridLevel<R> &level,
                          const std::vector<bool> &is_active, std::vector<Block<R, 6>> &modes,
                          std::vector<Block<6, 6>> &coarse_modes) {
    std::size_t num_aggregates = 0;
    {
        const std::vector<Index> of = aggregate(matrix, is_active, num_aggregates);
        const BlockSparse<R, 6> basis = tentative_basis<R>(of, num_aggregates, modes, coarse_modes);
        std::vector<Block<R, 6>>().swap(modes);
        level.prolongation = smoothed_basis<R>(matrix, level.inverse_diagonal, basis);
    }
    level.coarse_right.resize(6 * num_aggregates);
    level.coarse_x.resize(6 * num_aggregates);
    BlockSparse<6, 6> next = transposed_product<6, R, 6>(
        level.prolongation, product<R, R, 6>(matrix, level.prolongation));
    sort_columns(next);
    return next;
}

void transpose_blocks(BlockSparse<6, 6> &matrix) {
    for (Block<6, 6> &block : matrix.blocks)
        for (std::size_t r = 0; r < 6; ++r)
            for (std::size_t c = 0; c < r; ++c)
                std::swap(block[6 * r + c], block[6 * c + r]);
}

} // namespace

Multigrid::Multigrid(const BlockMatrix &matrix, std::span<const double> points,
                     std::span<const std::uint8_t> is_free, const PointFrames &frames) {
    const std::size_t n = matrix.num_points;
    std::vector<bool> is_active(n);
    std::array<double, 3> centre{};
    for (std::size_t i = 0; i < n; ++i) {
        is_active[i] = is_free[3 * i] || is_free[3 * i + 1] || is_free[3 * i + 2];
        for (std::size_t j = 0; j < 3; ++j)
            centre[j] += points[3 * i + j] / static_cast<double>(n);
    }
    double size = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i)
        size = std::max(size, std::abs(points[i] - centre[i % 3]));
    std::vector<Block<3, 6>> modes(n);
    for (std::size_t i = 0; i < n; ++i) {
        const double x = (points[3 * i] - centre[0]) / size;
        const double y = (points[3 * i + 1] - centre[1]) / size;
        const double z = (points[3 * i + 2] - centre[2]) / size;
        modes[i] = {1, 0, 0, 0, z, -y, 0, 1, 0, -z, 0, x, 0, 0, 1, y, -x, 0};
    }
    for (std::size_t k = 0; k < frames.points.size(); ++k) {
        Block<3, 6> &own = modes[at(frames.points[k])];
        const Block<3, 6> given = own;
        own = {};
        for (std::size_t r = 0; r < 3; ++r)
            for (std::size_t s = 0; s < 3; ++s)
                for (std::size_t c = 0; c < 6; ++c)
                    own[6 * r + c] += frames.axes[k][3 * r + s] * given[6 * s + c];
    }
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t r = 0; r < 3; ++r)
            if (is_free[3 * i + r] == 0)
                for (std::size_t c = 0; c < 6; ++c)
                    modes[i][6 * r + c] = 0.0;
    set_finest(matrix, is_free);
    std::vector<Block<6, 6>> coarse_modes, next_modes;
    BlockSparse<6, 6> next = coarsen<3>(matrix, _fine, is_active, modes, coarse_modes);
    while (next.num_rows() > largest_coarsest && _coarse.size() + 2 < most_levels) {
        _matrices.push_back(std::move(next));
        MultigridLevel<6> level;
        level.inverse_diagonal = inverse_diagonal_of(_matrices.back());
        const std::vector<bool> all(_matrices.back().num_rows(), true);
        next = coarsen<6>(_matrices.back(), level, all, coarse_modes, next_modes);
        coarse_modes = next_modes;
        _coarse.push_back(std::move(level));
    }
    for (BlockSparse<6, 6> &coarse : _matrices)
        transpose_blocks(coarse);
    factor_coarsest(next);
}

void Multigrid::set_finest(const BlockMatrix &matrix, std::span<const std::uint8_t> is_free) {
    _fine.inverse_diagonal = inverse_diagonal_of(matrix, is_free);
}

} // namespace fastsim
