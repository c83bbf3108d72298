#include "mechanics/smoothed_tet4.hpp"

#include "mechanics/compression_blend.hpp"
#include "mechanics/smoothed_law.hpp"

namespace fastsim {

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

double trace(const Matrix3 &m) { return m[0] + m[4] + m[8]; }

/// (S1) and (S2).
struct SmoothedStrains {
    std::vector<Matrix3> of_edges;
    std::vector<double> of_nodes;

    SmoothedStrains(const ElasticCells &body, const SmoothingPatches &patches,
                    std::span<const Matrix3> strains)
        : of_edges(patches.num_edges(), Matrix3{}), of_nodes(patches.num_nodes(), 0.0) {
        for (std::size_t c = 0; c < body.size(); ++c) {
            for (std::size_t k = 0; k < 6; ++k) {
                const std::size_t edge = at(patches.cell_edges[6 * c + k]);
                const double part = body.rest.volumes[c] / 6.0 / patches.edge_volume[edge];
                for (std::size_t j = 0; j < 9; ++j)
                    of_edges[edge][j] += part * strains[c][j];
            }
            for (std::size_t a = 0; a < 4; ++a) {
                const std::size_t node = at(patches.cell_nodes[4 * c + a]);
                const double part = body.rest.volumes[c] / 4.0 / patches.node_volume[node];
                of_nodes[node] += part * trace(strains[c]);
            }
        }
    }
};

double dot(const Matrix3 &a, const Matrix3 &b) {
    double sum = 0.0;
    for (std::size_t j = 0; j < 9; ++j)
        sum += a[j] * b[j];
    return sum;
}

} // namespace

bool blends(const ElasticCells &body) {
    return body.strain == StrainMeasure::green && body.law == Law::saint_venant_kirchhoff;
}

EdgeBlends::EdgeBlends(const ElasticCells &body, const SmoothingPatches &patches,
                       std::span<const Matrix3> of_cells)
    : beta(patches.num_edges(), 0.0), slope(beta), bend(beta), variance(beta) {
    SmoothedStrains smoothed(body, patches, of_cells);
    strains = std::move(smoothed.of_edges);
    if (!blends(body))
        return;
    for (std::size_t c = 0; c < body.size(); ++c) {
        const double squared = dot(of_cells[c], of_cells[c]);
        for (std::size_t k = 0; k < 6; ++k) {
            const std::size_t edge = at(patches.cell_edges[6 * c + k]);
            variance[edge] += body.rest.volumes[c] / 6.0 / patches.edge_volume[edge] * squared;
        }
    }
    for (std::size_t e = 0; e < beta.size(); ++e) {
        variance[e] -= dot(strains[e], strains[e]);
        const Moduli &m = body.materials[at(patches.edge_material[e])];
        const double rate = blend_rate(m.lmbda, m.mu);
        const CompressionBlend blend(rate * trace(strains[e]) - blend_onset / blend_width);
        beta[e] = blend.beta;
        slope[e] = rate * blend.slope;
        bend[e] = rate * rate * blend.bend;
    }
}

void smoothed_stresses(const ElasticCells &body, const SmoothingPatches &patches,
                       std::span<const Matrix3> strains, std::span<Matrix3> stresses) {
    const SmoothedStrains smoothed(body, patches, strains);
    for (std::size_t c = 0; c < body.size(); ++c) {
        const Moduli &moduli = body.moduli_of(c);
        Matrix3 s{};
        for (std::size_t k = 0; k < 6; ++k) {
            const Matrix3 &e = smoothed.of_edges[at(patches.cell_edges[6 * c + k])];
            for (std::size_t j = 0; j < 9; ++j)
                s[j] += moduli.mu / 3.0 * e[j];
        }
        double sum = 0.0;
        for (std::size_t a = 0; a < 4; ++a)
            sum += smoothed.of_nodes[at(patches.cell_nodes[4 * c + a])];
        for (std::size_t j = 0; j < 9; j += 4)
            s[j] += moduli.lmbda / 4.0 * sum;
        stresses[c] = s;
    }
}

void add_blend(const ElasticCells &body, const SmoothingPatches &patches, const EdgeBlends &blend,
               std::span<const Matrix3> strains, std::span<Matrix3> stresses) {
    for (std::size_t c = 0; c < body.size(); ++c) {
        const double mu = body.moduli_of(c).mu;
        for (std::size_t k = 0; k < 6; ++k) {
            const std::size_t e = at(patches.cell_edges[6 * c + k]);
            if (blend.beta[e] == 0.0)
                continue;
            for (std::size_t j = 0; j < 9; ++j)
                stresses[c][j] += mu / 3.0 * blend.beta[e] * (strains[c][j] - blend.strains[e][j]);
            for (std::size_t j = 0; j < 9; j += 4)
                stresses[c][j] += mu / 6.0 * blend.slope[e] * blend.variance[e];
        }
    }
}

double smoothed_energy(const ElasticCells &body, const SmoothingPatches &patches,
                       std::span<const double> displacement) {
    if (!body.is_linear_in_strain())
        return SmoothedLaw(body, patches, displacement, false).energy;
    std::vector<Matrix3> strains(body.size());
    for (std::size_t c = 0; c < body.size(); ++c)
        strains[c] = strain_tensor(body.gradient(c, displacement), body.strain);
    const SmoothedStrains smoothed(body, patches, strains);
    double energy = 0.0;
    const EdgeBlends blend(body, patches, strains);
    for (std::size_t e = 0; e < patches.num_edges(); ++e) {
        double squared = blend.beta[e] * blend.variance[e];
        for (const double component : smoothed.of_edges[e])
            squared += component * component;
        energy +=
            patches.edge_volume[e] * body.materials[at(patches.edge_material[e])].mu * squared;
    }
    for (std::size_t n = 0; n < patches.num_nodes(); ++n) {
        const double theta = smoothed.of_nodes[n];
        energy += patches.node_volume[n] * 0.5 *
                  body.materials[at(patches.node_material[n])].lmbda * theta * theta;
    }
    return energy;
}

void smoothed_first_stresses(const ElasticCells &body, const SmoothingPatches &patches,
                             std::span<const double> displacement, std::span<Matrix3> out) {
    if (!body.is_linear_in_strain())
        return smoothed_piola_stresses(body, patches, displacement, out);
    for (std::size_t c = 0; c < body.size(); ++c)
        out[c] = strain_tensor(body.gradient(c, displacement), body.strain);
    const std::vector<Matrix3> strains(out.begin(), out.end());
    smoothed_stresses(body, patches, out, out);
    if (blends(body))
        add_blend(body, patches, EdgeBlends(body, patches, strains), strains, out);
    for (std::size_t c = 0; c < body.size(); ++c)
        out[c] = push_forward(body.gradient(c, displacement), out[c], body.strain);
}

void add_smoothed_force(const ElasticCells &body, const SmoothingPatches &patches,
                        std::span<const double> displacement, std::span<double> force) {
    std::vector<Matrix3> stresses(body.size());
    smoothed_first_stresses(body, patches, displacement, stresses);
    for (std::size_t c = 0; c < body.size(); ++c)
        add_cell_force(body, c, stresses[c], force);
}

} // namespace fastsim
