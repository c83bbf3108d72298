#pragma once
// A body's cells with the sparse matrix and the preconditioner that are made of them, kept between
// calls: the tangent or secant stiffness at one displacement at a time.

#include "mechanics/conjugate_gradient.hpp"
#include "mechanics/smoothed_tet4.hpp"

#include <optional>
#include <utility>

namespace fastsim {

/// Plain linear tetrahedra (tet4.hpp), or with strains averaged over patches (smoothed_tet4.hpp).
enum class Element { linear, smoothed };

struct ElasticBody {
    std::vector<double> points;
    ElasticCells elastic;
    std::optional<SmoothingPatches> patches; // of the smoothed element
    BlockMatrix matrix;
    PointFrames frames; // of points that supports hold along slanted directions
    std::optional<Multigrid> multigrid;

    /// Pre-condition: every cell has positive signed volume.
    ElasticBody(std::span<const double> rest, ElasticCells cells, Element element)
        : points(rest.begin(), rest.end()), elastic(std::move(cells)) {
        if (element == Element::smoothed)
            patches = make_smoothing_patches(elastic, points.size() / 3);
    }

    double strain_energy(std::span<const double> displacement) const;
    void add_internal_force(std::span<const double> displacement, std::span<double> force) const;
    /// The stresses that the element makes of strains of the cells, by S = lmbda tr(E) I + 2 mu E.
    void stresses(std::span<const Matrix3> strains, std::span<Matrix3> out) const;
    /// P of each cell [Pa], as the element takes it.
    void piola_stresses(std::span<const double> displacement, std::span<Matrix3> out) const;
    void assemble_tangent(std::span<const double> displacement);
    /// The symmetric secant stiffness K + P(a) of eq. 8-10, R(a) = (K + P(a)) a. R is cubic in a,
    /// so with the tangent K_T = K + N1 + N2, N1 linear and N2 quadratic in a, P = N1/2 + N2/3, and
    /// K + P = 2/3 K_T(0) + 5/12 K_T(a) - 1/12 K_T(-a).
    void assemble_secant(std::span<const double> displacement);

    /// The matrix for components in the frames, once all has been added to it.
    void turn_matrix() { turn_to_frames(frames, matrix); }

  private:
    void clear_matrix();
    void add_tangent(std::span<const double> displacement, double weight);
};

} // namespace fastsim
