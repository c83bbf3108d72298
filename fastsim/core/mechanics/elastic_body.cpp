#include "mechanics/elastic_body.hpp"

#include <algorithm>

namespace fastsim {

double ElasticBody::strain_energy(std::span<const double> displacement) const {
    return patches ? smoothed_energy(elastic, *patches, displacement)
                   : fastsim::strain_energy(elastic, displacement);
}

void ElasticBody::add_internal_force(std::span<const double> displacement,
                                     std::span<double> force) const {
    if (patches)
        add_smoothed_force(elastic, *patches, displacement, force);
    else
        fastsim::add_internal_force(elastic, displacement, force);
}

void ElasticBody::stresses(std::span<const Matrix3> strains, std::span<Matrix3> out) const {
    if (patches)
        return smoothed_stresses(elastic, *patches, strains, out);
    for (std::size_t c = 0; c < elastic.size(); ++c)
        out[c] = stress_of(strains[c], elastic.moduli_of(c));
}

void ElasticBody::piola_stresses(std::span<const double> displacement,
                                 std::span<Matrix3> out) const {
    if (!patches) {
        for (std::size_t c = 0; c < elastic.size(); ++c)
            out[c] = cell_stress(elastic, c, displacement);
        return;
    }
    smoothed_first_stresses(elastic, *patches, displacement, out);
}

void ElasticBody::assemble_tangent(std::span<const double> displacement) {
    clear_matrix();
    add_tangent(displacement, 1.0);
}

void ElasticBody::assemble_secant(std::span<const double> displacement) {
    clear_matrix();
    std::vector<double> other(displacement.size(), 0.0);
    add_tangent(other, 2.0 / 3.0);
    add_tangent(displacement, 5.0 / 12.0);
    std::ranges::transform(displacement, other.begin(), [](double u) { return -u; });
    add_tangent(other, -1.0 / 12.0);
}

void ElasticBody::clear_matrix() {
    if (matrix.num_points == 0)
        matrix = patches ? make_smoothed_matrix(points.size() / 3, elastic, *patches)
                         : make_block_matrix(points.size() / 3, elastic.cells);
    std::ranges::fill(matrix.blocks, Matrix3{});
}

void ElasticBody::add_tangent(std::span<const double> displacement, double weight) {
    if (patches)
        add_smoothed_tangent(elastic, *patches, displacement, weight, matrix);
    else
        fastsim::add_tangent(elastic, displacement, weight, matrix);
}

} // namespace fastsim
