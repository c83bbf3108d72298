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

template <std::size_t R>
std::vector<Block<R, R>> inverse_diagonal_of(const BlockSparse<R, R> &matrix) {
    std::vector<Block<R, R>> inverse(matrix.num_rows());
    for (std::size_t i = 0; i < matrix.num_rows(); ++i)
        for (std::size_t k = matrix.row_start[i]; k < matrix.row_start[i + 1]; ++k)
            if (at(matrix.columns[k]) == i)
                inverse[i] = inverse_of<R>(matrix.blocks[k]);
    return inverse;
}

/// Greedy aggregates: whole neighbourhoods first, then what is left joins a neighbour's.
template <std::size_t R>
std::vector<Index> aggregate(const BlockSparse<R, R> &matrix, const std::vector<bool> &is_active,
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

/// Largest eigenvalue of D^-1 A by power iteration from a fixed start.
template <std::size_t R>
double largest_eigenvalue(const BlockSparse<R, R> &matrix,
                          const std::vector<Block<R, R>> &inverse_diagonal) {
    const std::size_t n = R * matrix.num_rows();
    std::vector<double> x(n), y(n);
    for (std::size_t i = 0; i < n; ++i)
        x[i] = 0.5 + static_cast<double>((i * 2654435761u) % 1024u) / 1024.0 - (i % 2 ? 1.5 : 0.0);
    double value = 1.0;
    for (int iteration = 0; iteration < 12; ++iteration) {
        std::fill(y.begin(), y.end(), 0.0);
        add_product(matrix, x, 1.0, y);
        std::fill(x.begin(), x.end(), 0.0);
        double squared = 0.0;
        for (std::size_t i = 0; i < matrix.num_rows(); ++i)
            add_product<R, R>(inverse_diagonal[i], &y[R * i], 1.0, &x[R * i]);
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

/// Fills a level whose matrix is set; returns the next matrix.
template <std::size_t R>
BlockSparse<6, 6> coarsen(MultigridLevel<R> &level, const std::vector<bool> &is_active,
                          std::vector<Block<R, 6>> &modes, std::vector<Block<6, 6>> &coarse_modes) {
    std::size_t num_aggregates = 0;
    const std::vector<Index> of = aggregate(level.matrix, is_active, num_aggregates);
    BlockSparse<R, 6> basis = tentative_basis<R>(of, num_aggregates, modes, coarse_modes);
    level.inverse_diagonal = inverse_diagonal_of(level.matrix);
    // The power iteration comes from below: 1.1 on its value.
    const double omega =
        4.0 / (3.0 * 1.1 * largest_eigenvalue(level.matrix, level.inverse_diagonal));
    BlockSparse<R, 6> smoothed = product<R, R, 6>(level.matrix, basis);
    for (std::size_t i = 0; i < smoothed.num_rows(); ++i)
        for (std::size_t k = smoothed.row_start[i]; k < smoothed.row_start[i + 1]; ++k) {
            Block<R, 6> result{};
            add_product<R, R, 6>(level.inverse_diagonal[i], smoothed.blocks[k], -omega, result);
            if (of[i] == smoothed.columns[k])
                for (std::size_t e = 0; e < R * 6; ++e)
                    result[e] += basis.blocks[basis.row_start[i]][e];
            smoothed.blocks[k] = result;
        }
    level.prolongation = std::move(smoothed);
    level.restriction = transpose<R, 6>(level.prolongation);
    level.residual.resize(R * level.matrix.num_rows());
    level.coarse_right.resize(6 * num_aggregates);
    level.coarse_x.resize(6 * num_aggregates);
    return product<6, R, 6>(level.restriction, product<R, R, 6>(level.matrix, level.prolongation));
}

/// One block Gauss-Seidel sweep over rows in ascending or descending order.
template <std::size_t R>
void sweep(const MultigridLevel<R> &level, std::span<const double> b, std::span<double> x,
           bool is_forward) {
    const std::size_t n = level.matrix.num_rows();
    for (std::size_t count = 0; count < n; ++count) {
        const std::size_t i = is_forward ? count : n - 1 - count;
        std::array<double, R> rest{};
        for (std::size_t r = 0; r < R; ++r)
            rest[r] = b[R * i + r];
        for (std::size_t k = level.matrix.row_start[i]; k < level.matrix.row_start[i + 1]; ++k)
            add_product<R, R>(level.matrix.blocks[k], &x[R * at(level.matrix.columns[k])], -1.0,
                              rest.data());
        add_product<R, R>(level.inverse_diagonal[i], rest.data(), 1.0, &x[R * i]);
    }
}

template <std::size_t R, typename Next>
void cycle(const MultigridLevel<R> &level, std::span<const double> b, std::span<double> x,
           const Next &solve_coarse) {
    std::fill(x.begin(), x.end(), 0.0);
    sweep(level, b, x, true);
    std::copy(b.begin(), b.end(), level.residual.begin());
    add_product(level.matrix, std::span<const double>(x), -1.0, std::span(level.residual));
    std::fill(level.coarse_right.begin(), level.coarse_right.end(), 0.0);
    add_product(level.restriction, std::span<const double>(level.residual), 1.0,
                std::span(level.coarse_right));
    solve_coarse(level.coarse_right, level.coarse_x);
    add_product(level.prolongation, std::span<const double>(level.coarse_x), 1.0, x);
    sweep(level, b, x, false);
}

} // namespace

Multigrid::Multigrid(const BlockMatrix &matrix, std::span<const double> points,
                     std::span<const std::uint8_t> is_free) {
    const std::size_t n = matrix.num_points;
    BlockSparse<3, 3> &fine = _fine.matrix;
    fine.num_columns = n;
    std::vector<bool> is_active(n);
    std::array<double, 3> centre{};
    for (std::size_t i = 0; i < n; ++i) {
        is_active[i] = is_free[3 * i] || is_free[3 * i + 1] || is_free[3 * i + 2];
        for (std::size_t j = 0; j < 3; ++j)
            centre[j] += points[3 * i + j] / static_cast<double>(n);
    }
    std::vector<Block<3, 6>> modes(n);
    double size = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i)
        size = std::max(size, std::abs(points[i] - centre[i % 3]));
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = matrix.row_start[i]; k < matrix.row_start[i + 1]; ++k) {
            const std::size_t j = at(matrix.columns[k]);
            if (i != j && !(is_active[i] && is_active[j]))
                continue;
            Matrix3 block = matrix.blocks[k];
            for (std::size_t r = 0; r < 3; ++r)
                for (std::size_t s = 0; s < 3; ++s)
                    if (is_free[3 * i + r] == 0 || is_free[3 * j + s] == 0)
                        block[3 * r + s] = 0.0;
            fine.columns.push_back(matrix.columns[k]);
            fine.blocks.push_back(block);
        }
        fine.row_start.push_back(fine.columns.size());
        const double x = (points[3 * i] - centre[0]) / size;
        const double y = (points[3 * i + 1] - centre[1]) / size;
        const double z = (points[3 * i + 2] - centre[2]) / size;
        modes[i] = {1, 0, 0, 0, z, -y, 0, 1, 0, -z, 0, x, 0, 0, 1, y, -x, 0};
        for (std::size_t r = 0; r < 3; ++r)
            if (is_free[3 * i + r] == 0)
                for (std::size_t c = 0; c < 6; ++c)
                    modes[i][6 * r + c] = 0.0;
    }
    std::vector<Block<6, 6>> coarse_modes, next_modes;
    BlockSparse<6, 6> next = coarsen<3>(_fine, is_active, modes, coarse_modes);
    while (next.num_rows() > largest_coarsest && _coarse.size() + 2 < most_levels) {
        MultigridLevel<6> level;
        level.matrix = std::move(next);
        const std::vector<bool> all(level.matrix.num_rows(), true);
        next = coarsen<6>(level, all, coarse_modes, next_modes);
        coarse_modes = next_modes;
        _coarse.push_back(std::move(level));
    }
    factor_coarsest(next);
}

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
        cycle(_coarse[depth], b, x, [&](std::span<const double> right, std::span<double> result) {
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

void Multigrid::apply(std::span<const double> b, std::span<double> x) const {
    cycle(_fine, b, x, [&](std::span<const double> right, std::span<double> result) {
        descend(0, right, result);
    });
}

} // namespace fastsim
