#include "mechanics/block_matrix.hpp"

#include "errors.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace fastsim {

namespace {

/// Block k = 4 a + b of a cell in the matrix.
Matrix3 &cell_block(BlockMatrix &matrix, std::span<const Index> cells, std::size_t cell,
                    std::size_t k) {
    const auto row = static_cast<std::size_t>(cells[4 * cell + k / 4]);
    return matrix.blocks[matrix.row_start[row] + matrix.cell_position[16 * cell + k]];
}

std::span<const Index> columns_of(const BlockMatrix &matrix, std::size_t row) {
    return {matrix.columns.data() + matrix.row_start[row],
            matrix.row_start[row + 1] - matrix.row_start[row]};
}

void require_few_neighbours(const BlockMatrix &matrix, std::size_t row) {
    if (columns_of(matrix, row).size() > std::numeric_limits<std::uint16_t>::max())
        throw CrowdedPointError(static_cast<Index>(row));
}

/// Where each cell's blocks are in their rows.
void locate_cells(std::span<const Index> cells, BlockMatrix &matrix) {
    matrix.cell_position.resize(4 * cells.size());
    for (std::size_t first = 0; first < cells.size(); first += 4)
        for (std::size_t a = 0; a < 4; ++a) {
            const auto row = columns_of(matrix, static_cast<std::size_t>(cells[first + a]));
            for (std::size_t b = 0; b < 4; ++b)
                matrix.cell_position[4 * (first + a) + b] = static_cast<std::uint16_t>(
                    std::ranges::lower_bound(row, cells[first + b]) - row.begin());
        }
}

} // namespace

BlockMatrix make_block_matrix(std::size_t num_points, std::span<const Index> cells) {
    const std::size_t num_cells = cells.size() / 4;
    // Count, then list, then sort and drop repeats: 16 entries for each cell.
    std::vector<std::size_t> start(num_points + 1, 0);
    for (const Index i : cells)
        start[static_cast<std::size_t>(i) + 1] += 4;
    for (std::size_t i = 0; i < num_points; ++i)
        start[i + 1] += start[i];
    std::vector<Index> listed(start.back());
    std::vector<std::size_t> fill(start.begin(), start.end() - 1);
    for (std::size_t c = 0; c < num_cells; ++c)
        for (std::size_t a = 0; a < 4; ++a)
            for (std::size_t b = 0; b < 4; ++b)
                listed[fill[static_cast<std::size_t>(cells[4 * c + a])]++] = cells[4 * c + b];

    BlockMatrix matrix;
    matrix.num_points = num_points;
    matrix.row_start.assign(num_points + 1, 0);
    matrix.diagonal.resize(num_points);
    for (std::size_t i = 0; i < num_points; ++i) {
        const auto first = listed.begin() + static_cast<std::ptrdiff_t>(start[i]);
        const auto last = listed.begin() + static_cast<std::ptrdiff_t>(start[i + 1]);
        std::sort(first, last);
        for (auto it = first; it != last; ++it) {
            if (it != first && *it == *(it - 1))
                continue;
            if (static_cast<std::size_t>(*it) == i)
                matrix.diagonal[i] = matrix.columns.size();
            matrix.columns.push_back(*it);
        }
        matrix.row_start[i + 1] = matrix.columns.size();
        require_few_neighbours(matrix, i);
    }
    matrix.columns.shrink_to_fit();
    std::vector<Index>().swap(listed);
    matrix.blocks.assign(matrix.columns.size(), Matrix3{});
    locate_cells(cells, matrix);
    return matrix;
}

void extend_pattern(std::span<const Index> rows, std::span<const Index> columns,
                    std::span<const Index> cells, BlockMatrix &matrix) {
    std::vector<std::vector<Index>> added(matrix.num_points);
    for (std::size_t k = 0; k < rows.size(); ++k) {
        added[static_cast<std::size_t>(rows[k])].push_back(columns[k]);
        added[static_cast<std::size_t>(columns[k])].push_back(rows[k]);
    }
    BlockMatrix wider;
    wider.num_points = matrix.num_points;
    wider.row_start.assign(1, 0);
    wider.diagonal.resize(matrix.num_points);
    std::vector<Index> row;
    for (std::size_t i = 0; i < matrix.num_points; ++i) {
        const auto before = columns_of(matrix, i);
        row.assign(before.begin(), before.end());
        row.insert(row.end(), added[i].begin(), added[i].end());
        std::ranges::sort(row);
        row.erase(std::ranges::unique(row).begin(), row.end());
        std::size_t old = 0;
        for (const Index column : row) {
            if (static_cast<std::size_t>(column) == i)
                wider.diagonal[i] = wider.columns.size();
            const bool is_old = old < before.size() && before[old] == column;
            wider.columns.push_back(column);
            wider.blocks.push_back(is_old ? matrix.blocks[matrix.row_start[i] + old++] : Matrix3{});
        }
        wider.row_start.push_back(wider.columns.size());
        require_few_neighbours(wider, i);
    }
    if (!matrix.cell_position.empty())
        locate_cells(cells, wider);
    matrix = std::move(wider);
}

void add_tangent(const ElasticCells &body, std::span<const double> displacement, double weight,
                 BlockMatrix &matrix) {
    for (std::size_t c = 0; c < body.size(); ++c) {
        const auto local = cell_tangent(body, c, displacement, weight);
        for (std::size_t k = 0; k < 16; ++k) {
            Matrix3 &block = cell_block(matrix, body.cells, c, k);
            for (std::size_t e = 0; e < 9; ++e)
                block[e] += local[k][e];
        }
    }
}

namespace {

/// Of a row and a column that it has.
Matrix3 &block(BlockMatrix &matrix, std::size_t row, Index column) {
    const auto columns = columns_of(matrix, row);
    const auto place = std::ranges::lower_bound(columns, column) - columns.begin();
    return matrix.blocks[matrix.row_start[row] + static_cast<std::size_t>(place)];
}

} // namespace

void add_pressure_tangent(std::span<const double> displaced_points, std::span<const Index> facets,
                          double pressure, BlockMatrix &matrix) {
    for (std::size_t t = 0; t < facets.size() / 3; ++t) {
        std::array<std::size_t, 3> corner{};
        std::array<const double *, 3> x{};
        for (std::size_t k = 0; k < 3; ++k) {
            corner[k] = static_cast<std::size_t>(facets[3 * t + k]);
            x[k] = displaced_points.data() + 3 * corner[k];
        }
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t l = 0; l < 3; ++l) {
                if (k == l)
                    continue;
                // e_l - e_k, with e_l = x_{l+2} - x_{l+1}.
                std::array<double, 3> v{};
                for (std::size_t j = 0; j < 3; ++j)
                    v[j] = pressure / 12.0 *
                           ((x[(l + 2) % 3][j] - x[(l + 1) % 3][j]) -
                            (x[(k + 2) % 3][j] - x[(k + 1) % 3][j]));
                Matrix3 &m = block(matrix, corner[k], facets[3 * t + l]);
                m[1] -= v[2];
                m[2] += v[1];
                m[3] += v[2];
                m[5] -= v[0];
                m[6] -= v[1];
                m[7] += v[0];
            }
    }
}

void add_facet_stiffness(std::span<const Index> facets, std::span<const double> stiffnesses,
                         BlockMatrix &matrix) {
    for (std::size_t t = 0; t < facets.size() / 3; ++t)
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t l = 0; l < 3; ++l) {
                Matrix3 &m =
                    block(matrix, static_cast<std::size_t>(facets[3 * t + k]), facets[3 * t + l]);
                for (std::size_t j = 0; j < 9; j += 4)
                    m[j] += stiffnesses[9 * t + 3 * k + l];
            }
}

void add_blocks(std::span<const Index> rows, std::span<const Index> columns,
                std::span<const Matrix3> blocks, BlockMatrix &matrix) {
    for (std::size_t k = 0; k < rows.size(); ++k) {
        Matrix3 &m = block(matrix, static_cast<std::size_t>(rows[k]), columns[k]);
        for (std::size_t j = 0; j < 9; ++j)
            m[j] += blocks[k][j];
    }
}

void turn_to_frames(const PointFrames &frames, BlockMatrix &matrix) {
    std::vector<const Matrix3 *> axes_of(matrix.num_points, nullptr);
    for (std::size_t k = 0; k < frames.points.size(); ++k)
        axes_of[static_cast<std::size_t>(frames.points[k])] = &frames.axes[k];
    for (std::size_t i = 0; i < matrix.num_points; ++i)
        for (std::size_t k = matrix.row_start[i]; k < matrix.row_start[i + 1]; ++k) {
            Matrix3 &m = matrix.blocks[k];
            if (const Matrix3 *const own = axes_of[i]) {
                const Matrix3 &q = *own, given = m;
                for (std::size_t r = 0; r < 3; ++r)
                    for (std::size_t c = 0; c < 3; ++c)
                        m[3 * r + c] = q[3 * r] * given[c] + q[3 * r + 1] * given[3 + c] +
                                       q[3 * r + 2] * given[6 + c];
            }
            if (const Matrix3 *const other = axes_of[static_cast<std::size_t>(matrix.columns[k])]) {
                const Matrix3 &q = *other, given = m;
                for (std::size_t r = 0; r < 3; ++r)
                    for (std::size_t c = 0; c < 3; ++c)
                        m[3 * r + c] = given[3 * r] * q[3 * c] + given[3 * r + 1] * q[3 * c + 1] +
                                       given[3 * r + 2] * q[3 * c + 2];
            }
        }
}

void absolute_row_sums(const BlockMatrix &matrix, std::span<double> sums) {
    for (std::size_t i = 0; i < matrix.num_points; ++i)
        for (std::size_t r = 0; r < 3; ++r) {
            double sum = 0.0;
            for (std::size_t k = matrix.row_start[i]; k < matrix.row_start[i + 1]; ++k)
                for (std::size_t c = 0; c < 3; ++c)
                    sum += std::abs(matrix.blocks[k][3 * r + c]);
            sums[3 * i + r] = sum;
        }
}

void multiply(const BlockMatrix &matrix, std::span<const double> x, std::span<double> y) {
    for (std::size_t i = 0; i < matrix.num_points; ++i) {
        double y0 = 0.0, y1 = 0.0, y2 = 0.0;
        for (std::size_t k = matrix.row_start[i]; k < matrix.row_start[i + 1]; ++k) {
            const Matrix3 &m = matrix.blocks[k];
            const double *v = x.data() + 3 * static_cast<std::size_t>(matrix.columns[k]);
            y0 += m[0] * v[0] + m[1] * v[1] + m[2] * v[2];
            y1 += m[3] * v[0] + m[4] * v[1] + m[5] * v[2];
            y2 += m[6] * v[0] + m[7] * v[1] + m[8] * v[2];
        }
        y[3 * i] = y0;
        y[3 * i + 1] = y1;
        y[3 * i + 2] = y2;
    }
}

} // namespace fastsim
