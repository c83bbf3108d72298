#pragma once
// The four-node tetrahedron: strain, force, energy and tangent of one cell.
//
// H = grad u is constant in a cell; g_a is the rest gradient of shape function a.
//   linear strain (eq. 3-4):  e = (H + H^T) / 2
//   Green strain (eq. 6-7):   E = (H + H^T + H^T H) / 2
//   S = lmbda tr(E) I + 2 mu E (eq. 2),  P = (I + H) S,  f_a = V P g_a (eq. 1)
// Strain is taken from H, never from F^T F - I, which loses digits when H is small.

#include "mechanics/law.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

using Index = std::int32_t;
using Matrix3 = std::array<double, 9>; // row-major

enum class StrainMeasure { linear, green };

/// Of Ogden's law: its part of the shear modulus at rest, and its exponent.
struct OgdenTerm {
    double share;
    double alpha;
};

/// Rest data of the cells: gradients of shape functions 1, 2, 3 (rows) and volumes.
struct RestCells {
    std::vector<Matrix3> gradients;
    std::vector<double> volumes;
};

/// Pre-condition: every cell has positive signed volume.
RestCells make_rest_cells(std::span<const double> points, std::span<const Index> cells);

/// The cells of a body (4 points each), at rest, and what each is made of.
struct ElasticCells {
    std::vector<Index> cells;
    RestCells rest;
    std::vector<Moduli> materials;
    std::vector<Index> material_of; // each cell
    StrainMeasure strain;
    Law law; // under Green strain; with the linear strain all are Hooke's
    std::vector<OgdenTerm> ogden_terms{}; // of that law alone

    /// Whether stress is S = lmbda tr(E) I + 2 mu E of the strain: Hooke's law, or
    /// Saint-Venant-Kirchhoff's.
    bool is_linear_in_strain() const {
        return strain == StrainMeasure::linear || law == Law::saint_venant_kirchhoff;
    }
    std::size_t size() const { return rest.volumes.size(); }
    const Moduli &moduli_of(std::size_t cell) const {
        return materials[static_cast<std::size_t>(material_of[cell])];
    }
    /// Displacement gradient H of a cell.
    Matrix3 gradient(std::size_t cell, std::span<const double> displacement) const;
};

/// Pre-condition: every cell has positive signed volume, and a number of one of the materials.
ElasticCells make_elastic_cells(std::span<const double> points, std::span<const Index> cells,
                                std::span<const Moduli> materials,
                                std::span<const Index> material_of, StrainMeasure strain, Law law);

double determinant(const Matrix3 &m);

/// I + H.
Matrix3 deformation_gradient(const Matrix3 &gradient_of_displacement);

/// (H + H^T) / 2, plus H^T H / 2 for Green strain: eq. 3-4 and 6-7.
Matrix3 strain_tensor(const Matrix3 &gradient_of_displacement, StrainMeasure strain);

/// Gradients of all four shape functions; they sum to zero.
std::array<std::array<double, 3>, 4> all_gradients(const Matrix3 &gradients);

/// det(I + H).
double det_f(const Matrix3 &gradient_of_displacement);

/// S = lmbda tr(E) I + 2 mu E; eq. 2.
Matrix3 stress_of(const Matrix3 &strain, const Moduli &moduli);

/// P = F S for Green strain; S itself for linear strain.
Matrix3 push_forward(const Matrix3 &gradient_of_displacement, const Matrix3 &s,
                     StrainMeasure strain);

/// First Piola-Kirchhoff stress P (the engineering stress for linear strain); eq. 2.
Matrix3 first_piola_kirchhoff_stress(const Matrix3 &h, const Moduli &moduli, StrainMeasure strain);

double strain_energy_density(const Matrix3 &h, const Moduli &moduli, StrainMeasure strain);

/// Tangent blocks of one cell, 4 x 4 blocks of 3 x 3, row-major in both; includes the volume.
std::array<Matrix3, 16> tangent_blocks(const Matrix3 &h, const Matrix3 &gradients, double volume,
                                       const Moduli &moduli, StrainMeasure strain);

/// Such blocks of a stress whose derivative along a change of H is change(dH): column k of block ab
/// is `weight` times dP g_a for dH = e_k (x) g_b.
template <typename Change>
std::array<Matrix3, 16> blocks_of_changes(const Matrix3 &gradients, double weight,
                                          const Change &change) {
    const auto g = all_gradients(gradients);
    std::array<Matrix3, 16> blocks{};
    for (std::size_t b = 0; b < 4; ++b)
        for (std::size_t k = 0; k < 3; ++k) {
            Matrix3 dh{};
            for (std::size_t j = 0; j < 3; ++j)
                dh[3 * k + j] = g[b][j];
            const Matrix3 dp = change(dh);
            for (std::size_t a = 0; a < 4; ++a)
                for (std::size_t i = 0; i < 3; ++i)
                    blocks[4 * a + b][3 * i + k] =
                        weight *
                        (dp[3 * i] * g[a][0] + dp[3 * i + 1] * g[a][1] + dp[3 * i + 2] * g[a][2]);
        }
    return blocks;
}

/// First Piola-Kirchhoff stress of a cell by the body's law.
Matrix3 cell_stress(const ElasticCells &body, std::size_t cell,
                    std::span<const double> displacement);

/// The same blocks by the body's law, of a cell at a displacement; `weight` times.
std::array<Matrix3, 16> cell_tangent(const ElasticCells &body, std::size_t cell,
                                     std::span<const double> displacement, double weight);

/// Adds the nodal forces of a first Piola-Kirchhoff stress in one cell: eq. 1.
void add_cell_force(const ElasticCells &body, std::size_t cell, const Matrix3 &p,
                    std::span<double> force);

/// Adds the nodal internal forces R(a) of all cells to `force`: eq. 1, 5 and 8.
void add_internal_force(const ElasticCells &body, std::span<const double> displacement,
                        std::span<double> force);

double strain_energy(const ElasticCells &body, std::span<const double> displacement);

/// det F of every cell into `out`.
void cell_det_f(const ElasticCells &body, std::span<const double> displacement,
                std::span<double> out);

} // namespace fastsim
