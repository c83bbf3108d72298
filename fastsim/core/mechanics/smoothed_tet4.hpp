#pragma once
// Tetrahedra whose strain is averaged over patches of cells: over edges for the shear part of the
// law, over nodes for the volumetric part (Liu and Nguyen-Thoi, "Smoothed Finite Element Methods",
// 2010; Lee, Mihai, Hale, Kerfriden and Bordas, Computers and Structures 182, 2017).
//
//   E_e     = (1 / V_e) sum over c at e of (V_c / 6) E_c                                   (S1)
//   theta_n = (1 / V_n) sum over c at n of (V_c / 4) tr E_c                                (S2)
//   W       = sum of V_e mu E_e : E_e  +  sum of V_n (lmbda / 2) theta_n^2                 (S3)
//   S_c     = (1 / 6) sum over e of c of 2 mu E_e + (lmbda / 4) sum over n of c of theta_n I  (S4)
//   f_a     = V_c F_c S_c g_a, as of any tetrahedron                                       (S5)
//
// Other laws: smoothed_law.hpp, (S6) to (S8). E_c is the strain of the plain cell (tet4.hpp). It is
// E that is averaged, not F: finite rotations stay exact. A constant strain is reproduced; f =
// dW/du holds exactly; W is never above that of the plain cells, since (S3) is convex in E.

#include "mechanics/block_matrix.hpp"
#include "mechanics/smoothing_patches.hpp"

#include <span>

namespace fastsim {

/// S_c of (S4) for any strains of the cells: linear and symmetric in them, weighed by volume.
void smoothed_stresses(const ElasticCells &body, const SmoothingPatches &patches,
                       std::span<const Matrix3> strains, std::span<Matrix3> stresses);

/// Whether the element goes over to plain cells where it is compressed: compression_blend.hpp.
bool blends(const ElasticCells &body);

/// What that takes at each edge, of strains of the cells; all 0 of a body that does not.
struct EdgeBlends {
    std::vector<Matrix3> strains;          // E_e
    std::vector<double> beta, slope, bend; // and beta's derivatives by tr E_e
    std::vector<double> variance;          // v_e

    EdgeBlends(const ElasticCells &body, const SmoothingPatches &patches,
               std::span<const Matrix3> of_cells);
};

/// Adds to S of each cell what the blend adds.
void add_blend(const ElasticCells &body, const SmoothingPatches &patches, const EdgeBlends &blend,
               std::span<const Matrix3> strains, std::span<Matrix3> stresses);

/// (S3), or (S7) by the law.
double smoothed_energy(const ElasticCells &body, const SmoothingPatches &patches,
                       std::span<const double> displacement);

/// P of each cell: F_c S_c of (S4), or (S8) by the law.
void smoothed_first_stresses(const ElasticCells &body, const SmoothingPatches &patches,
                             std::span<const double> displacement, std::span<Matrix3> out);

/// Adds (S5) of all cells to `force`.
void add_smoothed_force(const ElasticCells &body, const SmoothingPatches &patches,
                        std::span<const double> displacement, std::span<double> force);

/// The pattern of the tangent, zero: points that share a node's patch.
BlockMatrix make_smoothed_matrix(std::size_t num_points, const ElasticCells &body,
                                 const SmoothingPatches &patches);

/// Adds `weight` times the tangent d2W/du2 at a displacement.
void add_smoothed_tangent(const ElasticCells &body, const SmoothingPatches &patches,
                          std::span<const double> displacement, double weight, BlockMatrix &matrix);

} // namespace fastsim
