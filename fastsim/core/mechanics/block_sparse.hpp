#pragma once
// Sparse matrices of dense R x C blocks in compressed rows, and their products (Gustavson 1978).
// Bases of coarse levels are kept in single precision: any basis will do, as long as products
// with it are summed in double.

#include "mechanics/tet4.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

namespace fastsim {

template <std::size_t R, std::size_t C, typename Real = double>
using Block = std::array<Real, R * C>; // row-major

template <std::size_t R, std::size_t C, typename Real = double> struct BlockSparse {
    std::size_t num_columns = 0;
    std::vector<std::size_t> row_start{0};
    std::vector<Index> columns;
    std::vector<Block<R, C, Real>> blocks;

    std::size_t num_rows() const { return row_start.size() - 1; }
};

/// C += s A B for one block.
template <std::size_t R, std::size_t K, std::size_t C, typename Real>
void add_product(const Block<R, K> &a, const Block<K, C, Real> &b, double s, Block<R, C> &c) {
    for (std::size_t i = 0; i < R; ++i)
        for (std::size_t k = 0; k < K; ++k) {
            const double factor = s * a[K * i + k];
            for (std::size_t j = 0; j < C; ++j)
                c[C * i + j] += factor * static_cast<double>(b[C * k + j]);
        }
}

/// C += A^T B for one block.
template <std::size_t R, std::size_t K, std::size_t C, typename Real>
void add_transposed_product(const Block<K, R, Real> &a, const Block<K, C> &b, Block<R, C> &c) {
    for (std::size_t k = 0; k < K; ++k)
        for (std::size_t i = 0; i < R; ++i) {
            const double factor = static_cast<double>(a[R * k + i]);
            for (std::size_t j = 0; j < C; ++j)
                c[C * i + j] += factor * b[C * k + j];
        }
}

/// y += s A x for one block.
template <std::size_t R, std::size_t C, typename Real>
void add_product(const Block<R, C, Real> &a, const double *x, double s, double *y) {
    for (std::size_t i = 0; i < R; ++i) {
        double sum = 0.0;
        for (std::size_t j = 0; j < C; ++j)
            sum += static_cast<double>(a[C * i + j]) * x[j];
        y[i] += s * sum;
    }
}

/// y += A^T x for one block.
template <std::size_t R, std::size_t C, typename Real>
void add_transposed_product(const Block<R, C, Real> &a, const double *x, double *y) {
    for (std::size_t i = 0; i < R; ++i)
        for (std::size_t j = 0; j < C; ++j)
            y[j] += static_cast<double>(a[C * i + j]) * x[i];
}

/// Rows of sums of blocks. `visit(i, add)` calls add(column) for every term of row i and adds it
/// to the block that this returns. Done twice: the first pass only counts, so that the second
/// neither moves nor overshoots what it has stored.
template <std::size_t R, std::size_t C, typename Visit>
BlockSparse<R, C> sum_rows(std::size_t num_rows, std::size_t num_columns, const Visit &visit) {
    constexpr std::size_t none = static_cast<std::size_t>(-1);
    BlockSparse<R, C> result;
    result.num_columns = num_columns;
    std::vector<std::size_t> place(num_columns, none); // of each column in the last row with it
    std::size_t count = 0, begin = 0;
    Block<R, C> unused{};
    for (std::size_t i = 0; i < num_rows; ++i, begin = count)
        visit.columns(i, [&](Index column) {
            std::size_t &at = place[static_cast<std::size_t>(column)];
            if (at == none || at < begin)
                at = count++;
        });
    result.row_start.reserve(num_rows + 1);
    result.columns.reserve(count);
    result.blocks.reserve(count);
    std::fill(place.begin(), place.end(), none);
    for (std::size_t i = 0; i < num_rows; ++i) {
        begin = result.columns.size();
        visit.terms(i, [&](Index column) -> Block<R, C> & {
            std::size_t &at = place[static_cast<std::size_t>(column)];
            if (at == none || at < begin) {
                at = result.columns.size();
                result.columns.push_back(column);
                result.blocks.push_back(unused);
            }
            return result.blocks[at];
        });
        result.row_start.push_back(result.columns.size());
    }
    return result;
}

/// Terms of the rows of A B; A is any matrix with row_start, columns and blocks.
template <std::size_t R, std::size_t K, std::size_t C, typename Matrix, typename Real>
struct ProductTerms {
    const Matrix &a;
    const BlockSparse<K, C, Real> &b;

    template <typename Add> void columns(std::size_t i, const Add &add) const {
        for (std::size_t k = a.row_start[i]; k < a.row_start[i + 1]; ++k) {
            const auto inner = static_cast<std::size_t>(a.columns[k]);
            for (std::size_t l = b.row_start[inner]; l < b.row_start[inner + 1]; ++l)
                add(b.columns[l]);
        }
    }
    template <typename Add> void terms(std::size_t i, const Add &add) const {
        for (std::size_t k = a.row_start[i]; k < a.row_start[i + 1]; ++k) {
            const auto inner = static_cast<std::size_t>(a.columns[k]);
            for (std::size_t l = b.row_start[inner]; l < b.row_start[inner + 1]; ++l)
                add_product<R, K, C, Real>(a.blocks[k], b.blocks[l], 1.0, add(b.columns[l]));
        }
    }
};

/// Terms of the rows of A^T B.
template <std::size_t R, std::size_t K, std::size_t C, typename Real> struct TransposedTerms {
    const BlockSparse<K, R, Real> &a;
    const BlockSparse<K, C> &b;
    std::vector<std::size_t> start;                // of each column of A in `places`
    std::vector<std::pair<Index, Index>> places{}; // row and position, by column of A

    TransposedTerms(const BlockSparse<K, R, Real> &left, const BlockSparse<K, C> &right)
        : a(left), b(right), start(left.num_columns + 1, 0), places(left.columns.size()) {
        for (const Index j : a.columns)
            ++start[static_cast<std::size_t>(j) + 1];
        for (std::size_t j = 0; j < a.num_columns; ++j)
            start[j + 1] += start[j];
        std::vector<std::size_t> fill(start.begin(), start.end() - 1);
        for (std::size_t i = 0; i < a.num_rows(); ++i)
            for (std::size_t k = a.row_start[i]; k < a.row_start[i + 1]; ++k)
                places[fill[static_cast<std::size_t>(a.columns[k])]++] = {static_cast<Index>(i),
                                                                          static_cast<Index>(k)};
    }

    template <typename Add> void columns(std::size_t j, const Add &add) const {
        for (std::size_t p = start[j]; p < start[j + 1]; ++p) {
            const auto i = static_cast<std::size_t>(places[p].first);
            for (std::size_t l = b.row_start[i]; l < b.row_start[i + 1]; ++l)
                add(b.columns[l]);
        }
    }
    template <typename Add> void terms(std::size_t j, const Add &add) const {
        for (std::size_t p = start[j]; p < start[j + 1]; ++p) {
            const auto i = static_cast<std::size_t>(places[p].first);
            const auto &block = a.blocks[static_cast<std::size_t>(places[p].second)];
            for (std::size_t l = b.row_start[i]; l < b.row_start[i + 1]; ++l)
                add_transposed_product<R, K, C, Real>(block, b.blocks[l], add(b.columns[l]));
        }
    }
};

/// A B.
template <std::size_t R, std::size_t K, std::size_t C, typename Matrix, typename Real>
BlockSparse<R, C> product(const Matrix &a, const BlockSparse<K, C, Real> &b) {
    return sum_rows<R, C>(a.row_start.size() - 1, b.num_columns,
                          ProductTerms<R, K, C, Matrix, Real>{a, b});
}

/// A^T B.
template <std::size_t R, std::size_t K, std::size_t C, typename Real>
BlockSparse<R, C> transposed_product(const BlockSparse<K, R, Real> &a, const BlockSparse<K, C> &b) {
    return sum_rows<R, C>(a.num_columns, b.num_columns, TransposedTerms<R, K, C, Real>(a, b));
}

/// Puts the columns of each row in ascending order.
template <std::size_t R, std::size_t C> void sort_columns(BlockSparse<R, C> &matrix) {
    std::vector<std::pair<Index, std::size_t>> order;
    std::vector<Block<R, C>> blocks;
    for (std::size_t i = 0; i < matrix.num_rows(); ++i) {
        const std::size_t begin = matrix.row_start[i], end = matrix.row_start[i + 1];
        order.clear();
        for (std::size_t k = begin; k < end; ++k)
            order.emplace_back(matrix.columns[k], k);
        std::sort(order.begin(), order.end());
        blocks.clear();
        for (const auto &[column, k] : order)
            blocks.push_back(matrix.blocks[k]);
        for (std::size_t k = begin; k < end; ++k) {
            matrix.columns[k] = order[k - begin].first;
            matrix.blocks[k] = blocks[k - begin];
        }
    }
}

} // namespace fastsim
