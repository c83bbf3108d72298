#pragma once
// Sparse matrices of dense R x C blocks in compressed rows, and their products (Gustavson 1978).

#include "mechanics/tet4.hpp"

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace fastsim {

template <std::size_t R, std::size_t C> using Block = std::array<double, R * C>; // row-major

template <std::size_t R, std::size_t C> struct BlockSparse {
    std::size_t num_columns = 0;
    std::vector<std::size_t> row_start{0};
    std::vector<Index> columns;
    std::vector<Block<R, C>> blocks;

    std::size_t num_rows() const { return row_start.size() - 1; }
};

/// C += s A B for one block.
template <std::size_t R, std::size_t K, std::size_t C>
void add_product(const Block<R, K> &a, const Block<K, C> &b, double s, Block<R, C> &c) {
    for (std::size_t i = 0; i < R; ++i)
        for (std::size_t k = 0; k < K; ++k) {
            const double factor = s * a[K * i + k];
            for (std::size_t j = 0; j < C; ++j)
                c[C * i + j] += factor * b[C * k + j];
        }
}

/// y += s A x for one block.
template <std::size_t R, std::size_t C>
void add_product(const Block<R, C> &a, const double *x, double s, double *y) {
    for (std::size_t i = 0; i < R; ++i) {
        double sum = 0.0;
        for (std::size_t j = 0; j < C; ++j)
            sum += a[C * i + j] * x[j];
        y[i] += s * sum;
    }
}

/// y += s A x.
template <std::size_t R, std::size_t C>
void add_product(const BlockSparse<R, C> &a, std::span<const double> x, double s,
                 std::span<double> y) {
    for (std::size_t i = 0; i < a.num_rows(); ++i)
        for (std::size_t k = a.row_start[i]; k < a.row_start[i + 1]; ++k)
            add_product<R, C>(a.blocks[k], &x[C * static_cast<std::size_t>(a.columns[k])], s,
                              &y[R * i]);
}

template <std::size_t R, std::size_t K, std::size_t C>
BlockSparse<R, C> product(const BlockSparse<R, K> &a, const BlockSparse<K, C> &b) {
    BlockSparse<R, C> c;
    c.num_columns = b.num_columns;
    constexpr std::size_t none = static_cast<std::size_t>(-1);
    std::vector<std::size_t> place(b.num_columns, none); // of each column in the present row
    for (std::size_t i = 0; i < a.num_rows(); ++i) {
        const std::size_t begin = c.columns.size();
        for (std::size_t k = a.row_start[i]; k < a.row_start[i + 1]; ++k) {
            const auto row = static_cast<std::size_t>(a.columns[k]);
            for (std::size_t l = b.row_start[row]; l < b.row_start[row + 1]; ++l) {
                std::size_t &at = place[static_cast<std::size_t>(b.columns[l])];
                if (at == none || at < begin) {
                    at = c.columns.size();
                    c.columns.push_back(b.columns[l]);
                    c.blocks.push_back({});
                }
                add_product<R, K, C>(a.blocks[k], b.blocks[l], 1.0, c.blocks[at]);
            }
        }
        c.row_start.push_back(c.columns.size());
    }
    return c;
}

template <std::size_t R, std::size_t C> BlockSparse<C, R> transpose(const BlockSparse<R, C> &a) {
    BlockSparse<C, R> t;
    t.num_columns = a.num_rows();
    t.row_start.assign(a.num_columns + 1, 0);
    for (const Index j : a.columns)
        ++t.row_start[static_cast<std::size_t>(j) + 1];
    for (std::size_t j = 0; j < a.num_columns; ++j)
        t.row_start[j + 1] += t.row_start[j];
    t.columns.resize(a.columns.size());
    t.blocks.resize(a.blocks.size());
    std::vector<std::size_t> fill(t.row_start.begin(), t.row_start.end() - 1);
    for (std::size_t i = 0; i < a.num_rows(); ++i)
        for (std::size_t k = a.row_start[i]; k < a.row_start[i + 1]; ++k) {
            const std::size_t at = fill[static_cast<std::size_t>(a.columns[k])]++;
            t.columns[at] = static_cast<Index>(i);
            for (std::size_t r = 0; r < R; ++r)
                for (std::size_t s = 0; s < C; ++s)
                    t.blocks[at][R * s + r] = a.blocks[k][C * r + s];
        }
    return t;
}

} // namespace fastsim
