#pragma once
// Sparse symmetric matrix of 3 x 3 blocks in compressed rows, one block row for each point.

#include "mechanics/tet4.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

struct BlockMatrix {
    std::size_t num_points = 0;
    std::vector<std::size_t> row_start; // num_points + 1
    std::vector<Index> columns;         // ascending in each row
    std::vector<Matrix3> blocks;
    std::vector<std::size_t> diagonal;        // position of each row's diagonal block
    std::vector<std::uint16_t> cell_position; // 16 for each cell, counted from the row's start; of
                                              // plain cells only

    std::size_t num_rows() const { return num_points; }
};

/// The pattern of a mesh; blocks are zero. Throws CrowdedPointError if a point has more than
/// 65 535 neighbours.
BlockMatrix make_block_matrix(std::size_t num_points, std::span<const Index> cells);

/// Adds pairs of points to the pattern, each in both rows; blocks there are as they were, new ones
/// zero. `cells` are those that the pattern was made of. Throws CrowdedPointError as above.
void extend_pattern(std::span<const Index> rows, std::span<const Index> columns,
                    std::span<const Index> cells, BlockMatrix &matrix);

/// Adds `weight` times the tangent stiffness dR/da at a displacement: the K of eq. 5 for linear
/// strain.
void add_tangent(const ElasticCells &body, std::span<const double> displacement, double weight,
                 BlockMatrix &matrix);

/// Adds the symmetric part of the tangent of a follower pressure on `facets` (3 points each), at
/// points as displaced. With f_k = -p/3 N on each corner and dN/dx_l = [e_l]_x / 2, e_l the edge
/// opposite corner l, the block is p/12 [e_l - e_k]_x. What is left out lives on the rim of the
/// loaded patch only; inside, and on a rim that is held, pressure has a potential.
void add_pressure_tangent(std::span<const double> displaced_points, std::span<const Index> facets,
                          double pressure, BlockMatrix &matrix);

/// Adds stiffnesses between the corners of `facets` (3 points each), 9 for each, which are the same
/// along x, y and z.
void add_facet_stiffness(std::span<const Index> facets, std::span<const double> stiffnesses,
                         BlockMatrix &matrix);

/// Adds blocks of pairs of points that the pattern has.
void add_blocks(std::span<const Index> rows, std::span<const Index> columns,
                std::span<const Matrix3> blocks, BlockMatrix &matrix);

/// Axes of their own for some points, as rows: a vector v of such a point has components Q v there.
struct PointFrames {
    std::vector<Index> points; // each once
    std::vector<Matrix3> axes; // orthonormal
};

/// The same matrix for components in the points' own axes: Q A Q^T.
void turn_to_frames(const PointFrames &frames, BlockMatrix &matrix);

/// Sum of the magnitudes of each row: Gershgorin's bound on the eigenvalues.
void absolute_row_sums(const BlockMatrix &matrix, std::span<double> sums);

/// y = A x.
void multiply(const BlockMatrix &matrix, std::span<const double> x, std::span<double> y);

} // namespace fastsim
