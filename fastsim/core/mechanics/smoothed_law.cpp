#include "mechanics/smoothed_law.hpp"

#include "mechanics/hyperelastic.hpp"

#include <cmath>

namespace fastsim {

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// g of m, and its first two derivatives.
struct VolumeTerm {
    double g, slope, bend;
};

VolumeTerm volume_term(Law law, double m) {
    if (is_by_log_of_volume(law))
        return {std::log1p(m), 1.0 / (1.0 + m), -1.0 / ((1.0 + m) * (1.0 + m))};
    return {m, 1.0, 0.0};
}

/// Mandel's unit tensor k, symmetric.
Matrix3 unit_of(std::size_t k) {
    static const double half_root = std::sqrt(0.5);
    Matrix3 unit{};
    if (k < 3)
        unit[4 * k] = 1.0;
    else {
        const std::size_t i = k == 3 ? 1 : 0, j = k == 5 ? 1 : 2;
        unit[3 * i + j] = unit[3 * j + i] = half_root;
    }
    return unit;
}

double dot(const Matrix3 &a, const Matrix3 &b) {
    double sum = 0.0;
    for (std::size_t k = 0; k < 9; ++k)
        sum += a[k] * b[k];
    return sum;
}

template <typename Stress> Mandel6 moduli_of(const Stress &stress) {
    Mandel6 found{};
    for (std::size_t k = 0; k < 6; ++k) {
        const Matrix3 change = stress.change(unit_of(k));
        for (std::size_t i = 0; i < 6; ++i)
            found[6 * i + k] = dot(unit_of(i), change);
    }
    return found;
}

} // namespace

VolumeMeasure::VolumeMeasure(Law law, const Matrix3 &h) : _f(deformation_gradient(h)) {
    if (law == Law::corotational) {
        const Principal strain = principal_values(strain_tensor(h, StrainMeasure::green));
        value = stretch_sum(strain.values);
        _inverse.emplace(strain, stretch_sum_rate(strain.values));
        rate = pushed(_f, _inverse->value());
        return;
    }
    const Matrix3 cof = cofactor(h);
    const double trace = h[0] + h[4] + h[8];
    value = trace + (cof[0] + cof[4] + cof[8]) + (h[0] * cof[0] + h[1] * cof[1] + h[2] * cof[2]);
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            rate[3 * i + j] = cof[3 * i + j] - h[3 * j + i] + (i == j ? 1.0 + trace : 0.0);
}

Matrix3 VolumeMeasure::rate_change(const Matrix3 &dh) const {
    return _inverse ? pushed_change(_f, *_inverse, _inverse->value(), dh) : cofactor_change(_f, dh);
}

SmoothedLaw::SmoothedLaw(const ElasticCells &body, const SmoothingPatches &patches,
                         std::span<const double> displacement, bool has_moduli)
    : stresses(body.size(), Matrix3{}), pressures(body.size(), 0.0) {
    std::vector<Matrix3> strains(patches.num_edges(), Matrix3{});
    std::vector<double> measures(patches.num_nodes(), 0.0);
    for (std::size_t c = 0; c < body.size(); ++c) {
        const Matrix3 h = body.gradient(c, displacement);
        const Matrix3 strain = strain_tensor(h, StrainMeasure::green);
        const double measure = VolumeMeasure(body.law, h).value;
        for (std::size_t k = 0; k < 6; ++k) {
            const std::size_t edge = at(patches.cell_edges[6 * c + k]);
            const double part = body.rest.volumes[c] / 6.0 / patches.edge_volume[edge];
            for (std::size_t j = 0; j < 9; ++j)
                strains[edge][j] += part * strain[j];
        }
        for (std::size_t a = 0; a < 4; ++a) {
            const std::size_t node = at(patches.cell_nodes[4 * c + a]);
            measures[node] += body.rest.volumes[c] / 4.0 / patches.node_volume[node] * measure;
        }
    }
    std::vector<Matrix3> of_edges(patches.num_edges());
    if (has_moduli)
        edge_moduli.resize(patches.num_edges());
    for (std::size_t e = 0; e < patches.num_edges(); ++e) {
        Moduli moduli = body.materials[at(patches.edge_material[e])];
        moduli.lmbda = 0.0;
        const auto take = [&](const auto &stress, double density) {
            of_edges[e] = stress.value();
            energy += patches.edge_volume[e] * density;
            if (has_moduli)
                edge_moduli[e] = moduli_of(stress);
        };
        if (is_of_stretches(body.law)) {
            const Principal strain = principal_values(strains[e]);
            take(CoaxialTensor(strain, principal_stress(body, moduli, strain.values)),
                 principal_energy(body, moduli, strain.values));
        } else {
            const ShapeStress stress(body.law, moduli, strains[e]);
            take(stress, stress.energy());
        }
    }
    std::vector<double> of_nodes(patches.num_nodes());
    if (has_moduli)
        node_moduli.resize(patches.num_nodes());
    for (std::size_t n = 0; n < patches.num_nodes(); ++n) {
        const double lmbda = body.materials[at(patches.node_material[n])].lmbda;
        const auto [g, slope, bend] = volume_term(body.law, measures[n]);
        of_nodes[n] = lmbda * g * slope;
        energy += patches.node_volume[n] * 0.5 * lmbda * g * g;
        if (has_moduli)
            node_moduli[n] = lmbda * (slope * slope + g * bend);
    }
    for (std::size_t c = 0; c < body.size(); ++c) {
        for (std::size_t k = 0; k < 6; ++k) {
            const Matrix3 &s = of_edges[at(patches.cell_edges[6 * c + k])];
            for (std::size_t j = 0; j < 9; ++j)
                stresses[c][j] += s[j] / 6.0;
        }
        for (std::size_t a = 0; a < 4; ++a)
            pressures[c] += of_nodes[at(patches.cell_nodes[4 * c + a])] / 4.0;
    }
}

void smoothed_piola_stresses(const ElasticCells &body, const SmoothingPatches &patches,
                             std::span<const double> displacement, std::span<Matrix3> out) {
    const SmoothedLaw law(body, patches, displacement, false);
    for (std::size_t c = 0; c < body.size(); ++c) {
        const Matrix3 h = body.gradient(c, displacement);
        const VolumeMeasure measure(body.law, h);
        out[c] = pushed(deformation_gradient(h), law.stresses[c]);
        for (std::size_t k = 0; k < 9; ++k)
            out[c][k] += law.pressures[c] * measure.rate[k];
    }
}

} // namespace fastsim
