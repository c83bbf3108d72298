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
/// its part of the mass, which is its weight over the sum of all weights of its point.
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

/// Adds s D D^T, D the strain rates of a point whose shape function has the gradient g.
void add_strain_product(const Vector3 &g, double s, Matrix6 &a) {
    static const double r = std::sqrt(0.5);
    const double d[6][3] = {{g[0], 0, 0},
                            {0, g[1], 0},
                            {0, 0, g[2]},
                            {0, r * g[2], r * g[1]},
                            {r * g[2], 0, r * g[0]},
                            {r * g[1], r * g[0], 0}};
    for (std::size_t i = 0; i < 6; ++i)
        for (std::size_t j = 0; j < 6; ++j)
            a[6 * i + j] += s * (d[i][0] * d[j][0] + d[i][1] * d[j][1] + d[i][2] * d[j][2]);
}

/// (tr A^16)^(1/16) of a symmetric positive semidefinite matrix.
double bound_on_largest_eigenvalue(Matrix6 a) {
    double scale = 0.0;
    for (std::size_t i = 0; i < 6; ++i)
        scale += a[7 * i];
    if (!(scale > 0.0))
        return scale; // nothing, or NaN
    for (double &entry : a)
        entry /= scale;
    for (int squaring = 0; squaring < 3; ++squaring) {
        Matrix6 squared{};
        for (std::size_t i = 0; i < 6; ++i)
            for (std::size_t k = 0; k < 6; ++k)
                for (std::size_t j = 0; j < 6; ++j)
                    squared[6 * i + j] += a[6 * i + k] * a[6 * k + j];
        a = squared;
    }
    double sum = 0.0;
    for (const double entry : a)
        sum += entry * entry;
    return scale * std::pow(sum, 1.0 / 16.0);
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
    std::vector<double> over_mass(lumped_mass.size()), values;
    for (int round = 0; round < rounds; ++round) {
        std::fill(over_mass.begin(), over_mass.end(), 0.0);
        for (const PatchPoints *kind : {&edges, &nodes})
            for (std::size_t k = 0; k < kind->points.size(); ++k)
                over_mass[at(kind->points[k])] += kind->weights[k];
        for (std::size_t i = 0; i < over_mass.size(); ++i)
            over_mass[i] /= lumped_mass[i]; // 1 / m_ip is this over the weight
        double largest = 0.0;
        for (PatchPoints *kind : {&edges, &nodes}) {
            values.assign(kind->size(), 0.0);
            for (std::size_t p = 0; p < kind->size(); ++p) {
                if (kind->stiffness[p] == 0.0)
                    continue;
                Matrix6 a{};
                for (std::size_t k = kind->start[p]; k < kind->start[p + 1]; ++k) {
                    const Vector3 &g = kind->gradients[k];
                    // A point that does not strain a patch needs no mass in it.
                    if (kind->weights[k] == 0.0)
                        continue;
                    const double s =
                        kind->stiffness[p] * over_mass[at(kind->points[k])] / kind->weights[k];
                    if (kind == &edges)
                        add_strain_product(g, s, a);
                    else
                        values[p] += s * (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
                }
                if (kind == &edges)
                    values[p] = bound_on_largest_eigenvalue(a);
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
