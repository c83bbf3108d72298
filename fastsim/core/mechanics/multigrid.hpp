#pragma once
// Smoothed-aggregation multigrid (Vanek, Mandel and Brezina 1996) as a preconditioner:
//  1. points are gathered into aggregates of neighbours
//  2. the six rigid modes, cut to each aggregate and made orthonormal, are the coarse basis
//  3. one step of damped Jacobi smooths that basis
//  4. Galerkin products give the next matrix; again, until it is small; that one is factored
// One V-cycle with a forward sweep of block Gauss-Seidel down and a backward one up: symmetric,
// so conjugate gradients may use it.

#include "mechanics/block_matrix.hpp"
#include "mechanics/block_sparse.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

template <std::size_t R> struct MultigridLevel {
    BlockSparse<R, R> matrix;
    std::vector<Block<R, R>> inverse_diagonal;
    BlockSparse<R, 6> prolongation;
    BlockSparse<6, R> restriction;
    mutable std::vector<double> residual, coarse_right, coarse_x;
};

class Multigrid {
  public:
    /// Pre-conditions: `matrix` is symmetric; held components are cut out here.
    Multigrid(const BlockMatrix &matrix, std::span<const double> points,
              std::span<const std::uint8_t> is_free);

    /// x = approximate inverse of A times b; held components of b must be 0.
    void apply(std::span<const double> b, std::span<double> x) const;

    std::size_t num_levels() const { return _coarse.size() + 2; }

  private:
    void factor_coarsest(const BlockSparse<6, 6> &matrix);
    void descend(std::size_t depth, std::span<const double> b, std::span<double> x) const;

    MultigridLevel<3> _fine;
    std::vector<MultigridLevel<6>> _coarse;
    std::size_t _coarsest_size = 0;
    std::vector<double> _cholesky; // lower, row-major
};

} // namespace fastsim
