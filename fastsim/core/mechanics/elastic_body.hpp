#pragma once
// A body's cells with the sparse matrix and the preconditioner that are made of them, kept between
// calls: the tangent or secant stiffness at one displacement at a time.

#include "mechanics/conjugate_gradient.hpp"

#include <optional>
#include <utility>

namespace fastsim {

struct ElasticBody {
    std::vector<double> points;
    ElasticCells elastic;
    BlockMatrix matrix;
    std::optional<Multigrid> multigrid;

    /// Pre-condition: every cell has positive signed volume.
    ElasticBody(std::span<const double> rest, std::span<const Index> cells, Lame lame,
                StrainMeasure strain)
        : points(rest.begin(), rest.end()),
          elastic{{cells.begin(), cells.end()}, make_rest_cells(rest, cells), lame, strain} {}

    /// The matrix with its pattern, made at the first call.
    BlockMatrix &patterned_matrix() {
        if (matrix.num_points == 0)
            matrix = make_block_matrix(points.size() / 3, elastic.cells);
        return matrix;
    }
};

} // namespace fastsim
