#include "mechanics/smoothed_bound.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace fastsim {

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

using Vector3 = std::array<double, 3>;
using Matrix6 = std::array<double, 36>;

/// Points of all patches, patch by patch, each with the mean gradient of its shape function and
/// the weight of its part of the mass.
struct PatchPoints {
    std::vector<std::size_t> start{0};
    std::vector<Index> points;
    std::vector<Vector3> gradients;
    std::vector<double> weights;
    std::vector<double> stiffness; // 2 mu V_e or lmbda V_n, by patch

    std::size_t size() const { return stiffness.size(); }

    /// `table` names `width` patches for each cell, among which its volume is divided.
    PatchPoints(const ElasticCells &body, const std::vector<Index> &table, std::size_t width,
                const std::vector<double> &volumes, std::vector<double> given_stiffness,
                std::size_t num_points)
        : stiffness(std::move(given_stiffness)) {
        const Groups cells_of = rows_naming(table, width, volumes.size());
        const auto parts = static_cast<double>(width);
        std::vector<Index> place(num_points, -1);
        for (std::size_t p = 0; p < size(); ++p) {
            for (const Index cell : cells_of.of(p)) {
                const std::size_t c = at(cell);
                const double share = body.rest.volumes[c] / parts / volumes[p];
                const auto g = all_gradients(body.rest.gradients[c]);
                for (std::size_t a = 0; a < 4; ++a) {
                    const Index point = body.cells[4 * c + a];
                    Index &found = place[at(point)];
                    if (found < 0) {
                        found = static_cast<Index>(points.size());
                        points.push_back(point);
                        gradients.push_back({});
                    }
                    for (std::size_t j = 0; j < 3; ++j)
                        gradients[at(found)][j] += share * g[a][j];
                }
            }
            double sum = 0.0;
            for (std::size_t k = start.back(); k < points.size(); ++k) {
                place[at(points[k])] = -1;
                weights.push_back(std::hypot(gradients[k][0], gradients[k][1], gradients[k][2]));
                sum += weights.back();
            }
            for (std::size_t k = start.back(); k < points.size(); ++k)
                weights[k] *= stiffness[p] * sum;
            start.push_back(points.size());
        }
    }
};

Matrix3 identity(double scale) { return {scale, 0, 0, 0, scale, 0, 0, 0, scale}; }

/// a += scale g g^T.
void add_product(const Vector3 &g, double scale, Matrix3 &a) {
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            a[3 * i + j] += scale * g[i] * g[j];
}

/// Of a symmetric matrix.
Matrix3 inverse(const Matrix3 &a) {
    const double xx = a[4] * a[8] - a[5] * a[5], xy = a[2] * a[5] - a[1] * a[8],
                 xz = a[1] * a[5] - a[2] * a[4];
    const double yy = a[0] * a[8] - a[2] * a[2], yz = a[1] * a[2] - a[0] * a[5],
                 zz = a[0] * a[4] - a[1] * a[1];
    const double det = a[0] * xx + a[1] * xy + a[2] * xz;
    return {xx / det, xy / det, xz / det, xy / det, yy / det,
            yz / det, xz / det, yz / det, zz / det};
}

/// Adds s D^T R D, D the strain rates of a point whose shape function has the gradient g.
void add_strain_product(const Vector3 &g, const Matrix3 &r, double s, Matrix6 &a) {
    static const double h = std::sqrt(0.5);
    const double d[6][3] = {{g[0], 0, 0},
                            {0, g[1], 0},
                            {0, 0, g[2]},
                            {0, h * g[2], h * g[1]},
                            {h * g[2], 0, h * g[0]},
                            {h * g[1], h * g[0], 0}};
    for (std::size_t i = 0; i < 6; ++i) {
        double row[3];
        for (std::size_t k = 0; k < 3; ++k)
            row[k] = s * (d[i][0] * r[k] + d[i][1] * r[3 + k] + d[i][2] * r[6 + k]);
        for (std::size_t j = 0; j < 6; ++j)
            a[6 * i + j] += row[0] * d[j][0] + row[1] * d[j][1] + row[2] * d[j][2];
    }
}

/// (tr A^(2 n))^(1 / (2 n)), n = 2^squarings, of a symmetric positive semidefinite matrix.
template <std::size_t size>
double bound_on_largest_eigenvalue(std::array<double, size * size> a, int squarings) {
    double scale = 0.0;
    for (std::size_t i = 0; i < size; ++i)
        scale += a[(size + 1) * i];
    if (!(scale > 0.0))
        return scale; // nothing, or NaN
    for (double &entry : a)
        entry /= scale;
    for (int squaring = 0; squaring < squarings; ++squaring) {
        std::array<double, size * size> squared{};
        for (std::size_t i = 0; i < size; ++i)
            for (std::size_t k = 0; k < size; ++k)
                for (std::size_t j = 0; j < size; ++j)
                    squared[size * i + j] += a[size * i + k] * a[size * k + j];
        a = squared;
    }
    double sum = 0.0;
    for (const double entry : a)
        sum += entry * entry;
    return scale * std::pow(sum, std::ldexp(0.5, -squarings));
}

/// How a point's mass is divided: a weight of 1 gets `unit`; what is left goes to its edge patches
/// in equal parts.
struct Division {
    double unit;
    Matrix3 rest;
};

std::vector<Division> divide(const PatchPoints &edges, const PatchPoints &nodes,
                             std::span<const double> lumped_mass) {
    std::vector<Matrix3> sums(lumped_mass.size(), Matrix3{});
    std::vector<double> num_edges(lumped_mass.size(), 0.0);
    for (std::size_t k = 0; k < edges.points.size(); ++k)
        if (edges.weights[k] > 0.0) {
            for (std::size_t j = 0; j < 9; j += 4)
                sums[at(edges.points[k])][j] += edges.weights[k];
            num_edges[at(edges.points[k])] += 1.0;
        }
    for (std::size_t k = 0; k < nodes.points.size(); ++k)
        if (nodes.weights[k] > 0.0) {
            const Vector3 &g = nodes.gradients[k];
            const double squared = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
            add_product(g, nodes.weights[k] / squared, sums[at(nodes.points[k])]);
        }
    std::vector<Division> parts(lumped_mass.size());
    for (std::size_t i = 0; i < parts.size(); ++i) {
        parts[i].unit = lumped_mass[i] / bound_on_largest_eigenvalue<3>(sums[i], 5);
        parts[i].rest = identity(lumped_mass[i] / num_edges[i]);
        for (std::size_t j = 0; j < 9; ++j)
            parts[i].rest[j] -= parts[i].unit * sums[i][j] / num_edges[i];
    }
    return parts;
}

} // namespace

double bound_on_squared_frequency(const ElasticCells &body, const SmoothingPatches &patches,
                                  std::span<const double> lumped_mass, int rounds) {
    std::vector<double> of_edges(patches.num_edges()), of_nodes(patches.num_nodes());
    for (std::size_t e = 0; e < of_edges.size(); ++e)
        of_edges[e] =
            2.0 * patches.edge_volume[e] * body.materials[at(patches.edge_material[e])].mu;
    for (std::size_t n = 0; n < of_nodes.size(); ++n)
        of_nodes[n] = patches.node_volume[n] *
                      std::max(0.0, body.materials[at(patches.node_material[n])].lmbda);
    PatchPoints edges(body, patches.cell_edges, 6, patches.edge_volume, std::move(of_edges),
                      lumped_mass.size());
    PatchPoints nodes(body, patches.cell_nodes, 4, patches.node_volume, std::move(of_nodes),
                      lumped_mass.size());
    double best = std::numeric_limits<double>::infinity();
    std::vector<double> values;
    for (int round = 0; round < rounds; ++round) {
        const std::vector<Division> parts = divide(edges, nodes, lumped_mass);
        double largest = 0.0;
        for (PatchPoints *kind : {&edges, &nodes}) {
            values.assign(kind->size(), 0.0);
            for (std::size_t p = 0; p < kind->size(); ++p) {
                if (kind->stiffness[p] == 0.0)
                    continue;
                Matrix6 a{};
                for (std::size_t k = kind->start[p]; k < kind->start[p + 1]; ++k) {
                    // A point that does not strain a patch needs no mass in it.
                    if (kind->weights[k] == 0.0)
                        continue;
                    const Vector3 &g = kind->gradients[k];
                    const Division &part = parts[at(kind->points[k])];
                    const double own = part.unit * kind->weights[k];
                    if (kind == &edges) {
                        Matrix3 mass = part.rest;
                        for (std::size_t j = 0; j < 9; j += 4)
                            mass[j] += own;
                        add_strain_product(g, inverse(mass), kind->stiffness[p], a);
                    } else {
                        values[p] +=
                            kind->stiffness[p] * (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) / own;
                    }
                }
                if (kind == &edges)
                    values[p] = bound_on_largest_eigenvalue<6>(a, 5);
                // NaN is handed on.
                largest = values[p] <= largest ? largest : values[p];
            }
            for (std::size_t p = 0; p < kind->size(); ++p)
                for (std::size_t k = kind->start[p]; k < kind->start[p + 1]; ++k)
                    kind->weights[k] *= values[p];
        }
        best = std::min(best, largest);
        // Weights of size 1 again: only their ratios count.
        for (PatchPoints *kind : {&edges, &nodes})
            for (double &weight : kind->weights)
                weight /= largest;
    }
    return best;
}

} // namespace fastsim
