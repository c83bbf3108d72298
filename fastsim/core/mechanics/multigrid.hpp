#pragma once
// Smoothed-aggregation multigrid (Vanek, Mandel and Brezina 1996) as a preconditioner:
//  1. points are gathered into aggregates of neighbours
//  2. the six rigid modes, cut to each aggregate and made orthonormal, are the coarse basis
//  3. one step of damped Jacobi smooths that basis
//  4. Galerkin products give the next matrix; again, until it is small; that one is factored
// One V-cycle with a forward sweep of block Gauss-Seidel down and a backward one up: symmetric,
// so conjugate gradients may use it. The finest matrix is the caller's own, not a copy.

#include "mechanics/block_matrix.hpp"
#include "mechanics/block_sparse.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

/// What a level needs besides its matrix.
template <std::size_t R> struct MultigridLevel {
    std::vector<Block<R, R>> inverse_diagonal;
    BlockSparse<R, 6, float> prolongation; // its transpose restricts
    mutable std::vector<double> coarse_right, coarse_x;
};

class Multigrid {
  public:
    /// Pre-conditions: `matrix` is symmetric, its columns ascend, components are those of the
    /// frames where points have one; held components are cut out here.
    Multigrid(const BlockMatrix &matrix, std::span<const double> points,
              std::span<const std::uint8_t> is_free, const PointFrames &frames);

    /// Takes over another matrix of the same pattern, coarse levels unchanged.
    void set_finest(const BlockMatrix &matrix, std::span<const std::uint8_t> is_free);

    /// x = approximate inverse of A times b; held components of b must be 0. `matrix` is the one
    /// last given.
    void apply(const BlockMatrix &matrix, std::span<const double> b, std::span<double> x) const;

    std::size_t num_levels() const { return _coarse.size() + 2; }

  private:
    void factor_coarsest(const BlockSparse<6, 6> &matrix);
    void descend(std::size_t depth, std::span<const double> b, std::span<double> x) const;

    MultigridLevel<3> _fine;
    std::vector<MultigridLevel<6>> _coarse;
    std::vector<BlockSparse<6, 6>> _matrices; // of the coarse levels
    std::size_t _coarsest_size = 0;
    std::vector<double> _cholesky; // lower, row-major
};

} // namespace fastsim
