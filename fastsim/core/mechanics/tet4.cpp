#include "mechanics/hyperelastic.hpp"
#include "mechanics/principal.hpp"

#include <cstddef>

namespace fastsim {

namespace {

constexpr Matrix3 identity{1, 0, 0, 0, 1, 0, 0, 0, 1};

Matrix3 multiply(const Matrix3 &a, const Matrix3 &b) {
    Matrix3 c{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    return c;
}

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// What `visit` makes of a law other than Saint-Venant-Kirchhoff's at H.
template <typename Visit>
auto visit_law(const ElasticCells &body, const Moduli &moduli, const Matrix3 &h,
               const Visit &visit) {
    return is_of_stretches(body.law) ? visit(StressByStretches(body, moduli, h))
                                     : visit(FiniteStress(body.law, moduli, h));
}

} // namespace

double determinant(const Matrix3 &m) {
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
           m[2] * (m[3] * m[7] - m[4] * m[6]);
}

Matrix3 stress_of(const Matrix3 &e, const Moduli &moduli) {
    const double pressure_part = moduli.lmbda * (e[0] + e[4] + e[8]);
    Matrix3 s{};
    for (std::size_t k = 0; k < 9; ++k)
        s[k] = 2.0 * moduli.mu * e[k] + pressure_part * identity[k];
    return s;
}

Matrix3 deformation_gradient(const Matrix3 &h) {
    Matrix3 f = h;
    f[0] += 1.0;
    f[4] += 1.0;
    f[8] += 1.0;
    return f;
}

std::array<std::array<double, 3>, 4> all_gradients(const Matrix3 &g) {
    std::array<std::array<double, 3>, 4> all{};
    for (std::size_t j = 0; j < 3; ++j) {
        all[1][j] = g[j];
        all[2][j] = g[3 + j];
        all[3][j] = g[6 + j];
        all[0][j] = -(g[j] + g[3 + j] + g[6 + j]);
    }
    return all;
}

Matrix3 strain_tensor(const Matrix3 &h, StrainMeasure strain) {
    Matrix3 e{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            double twice = h[3 * i + j] + h[3 * j + i];
            if (strain == StrainMeasure::green)
                twice += h[i] * h[j] + h[3 + i] * h[3 + j] + h[6 + i] * h[6 + j];
            e[3 * i + j] = 0.5 * twice;
        }
    return e;
}

double det_f(const Matrix3 &h) { return determinant(deformation_gradient(h)); }

RestCells make_rest_cells(std::span<const double> points, std::span<const Index> cells) {
    const std::size_t num_cells = cells.size() / 4;
    RestCells rest;
    rest.gradients.resize(num_cells);
    rest.volumes.resize(num_cells);
    for (std::size_t c = 0; c < num_cells; ++c) {
        const double *x0 = points.data() + 3 * at(cells[4 * c]);
        Matrix3 d{}; // edge a in row a: the transpose of D_m
        for (std::size_t a = 0; a < 3; ++a) {
            const double *xa = points.data() + 3 * at(cells[4 * c + 1 + a]);
            for (std::size_t j = 0; j < 3; ++j)
                d[3 * a + j] = xa[j] - x0[j];
        }
        const double det = determinant(d);
        rest.volumes[c] = det / 6.0;
        // grad N_a . edge_b = delta_ab: rows of the inverse transpose, by cross products.
        Matrix3 &g = rest.gradients[c];
        for (std::size_t a = 0; a < 3; ++a) {
            const double *p = &d[3 * ((a + 1) % 3)];
            const double *q = &d[3 * ((a + 2) % 3)];
            g[3 * a] = (p[1] * q[2] - p[2] * q[1]) / det;
            g[3 * a + 1] = (p[2] * q[0] - p[0] * q[2]) / det;
            g[3 * a + 2] = (p[0] * q[1] - p[1] * q[0]) / det;
        }
    }
    return rest;
}

ElasticCells make_elastic_cells(std::span<const double> points, std::span<const Index> cells,
                                std::span<const Moduli> materials,
                                std::span<const Index> material_of, StrainMeasure strain, Law law) {
    return {{cells.begin(), cells.end()},
            make_rest_cells(points, cells),
            {materials.begin(), materials.end()},
            {material_of.begin(), material_of.end()},
            strain,
            law};
}

Matrix3 ElasticCells::gradient(std::size_t number, std::span<const double> displacement) const {
    const Matrix3 &g = rest.gradients[number];
    const Index *cell = &cells[4 * number];
    const double *u0 = displacement.data() + 3 * at(cell[0]);
    Matrix3 h{};
    for (std::size_t a = 0; a < 3; ++a) {
        const double *ua = displacement.data() + 3 * at(cell[a + 1]);
        for (std::size_t i = 0; i < 3; ++i) {
            const double du = ua[i] - u0[i];
            for (std::size_t j = 0; j < 3; ++j)
                h[3 * i + j] += du * g[3 * a + j];
        }
    }
    return h;
}

Matrix3 push_forward(const Matrix3 &h, const Matrix3 &s, StrainMeasure strain) {
    return strain == StrainMeasure::linear ? s : multiply(deformation_gradient(h), s);
}

Matrix3 first_piola_kirchhoff_stress(const Matrix3 &h, const Moduli &moduli, StrainMeasure strain) {
    return push_forward(h, stress_of(strain_tensor(h, strain), moduli), strain);
}

double strain_energy_density(const Matrix3 &h, const Moduli &moduli, StrainMeasure strain) {
    const Matrix3 e = strain_tensor(h, strain);
    const double trace = e[0] + e[4] + e[8];
    double squared = 0.0;
    for (const double component : e)
        squared += component * component;
    return 0.5 * moduli.lmbda * trace * trace + moduli.mu * squared;
}

std::array<Matrix3, 16> tangent_blocks(const Matrix3 &h, const Matrix3 &gradients, double volume,
                                       const Moduli &moduli, StrainMeasure strain) {
    // dP g_a for du_b:  K_ab = V [ (g_a . S g_b) I + lmbda (F g_a)(F g_b)^T
    //                              + mu ( (g_a . g_b) F F^T + (F g_b)(F g_a)^T ) ].
    const bool is_green = strain == StrainMeasure::green;
    const Matrix3 f = is_green ? deformation_gradient(h) : identity;
    const Matrix3 s = is_green ? stress_of(strain_tensor(h, strain), moduli) : Matrix3{};
    Matrix3 fft{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            fft[3 * i + j] =
                f[3 * i] * f[3 * j] + f[3 * i + 1] * f[3 * j + 1] + f[3 * i + 2] * f[3 * j + 2];
    const auto g = all_gradients(gradients);
    std::array<std::array<double, 3>, 4> fg{}, sg{};
    for (std::size_t a = 0; a < 4; ++a)
        for (std::size_t i = 0; i < 3; ++i) {
            fg[a][i] = f[3 * i] * g[a][0] + f[3 * i + 1] * g[a][1] + f[3 * i + 2] * g[a][2];
            sg[a][i] = s[3 * i] * g[a][0] + s[3 * i + 1] * g[a][1] + s[3 * i + 2] * g[a][2];
        }
    std::array<Matrix3, 16> blocks{};
    for (std::size_t a = 0; a < 4; ++a)
        for (std::size_t b = 0; b < 4; ++b) {
            const double geometric = g[a][0] * sg[b][0] + g[a][1] * sg[b][1] + g[a][2] * sg[b][2];
            const double gg = g[a][0] * g[b][0] + g[a][1] * g[b][1] + g[a][2] * g[b][2];
            Matrix3 &k = blocks[4 * a + b];
            for (std::size_t i = 0; i < 3; ++i)
                for (std::size_t j = 0; j < 3; ++j)
                    k[3 * i + j] =
                        volume *
                        (geometric * identity[3 * i + j] + moduli.lmbda * fg[a][i] * fg[b][j] +
                         moduli.mu * (gg * fft[3 * i + j] + fg[b][i] * fg[a][j]));
        }
    return blocks;
}

void add_cell_force(const ElasticCells &body, std::size_t number, const Matrix3 &p,
                    std::span<double> force) {
    const Index *cell = &body.cells[4 * number];
    const Matrix3 &g = body.rest.gradients[number];
    double *f0 = force.data() + 3 * at(cell[0]);
    for (std::size_t a = 0; a < 3; ++a) {
        double *fa = force.data() + 3 * at(cell[a + 1]);
        for (std::size_t i = 0; i < 3; ++i) {
            const double f =
                body.rest.volumes[number] *
                (p[3 * i] * g[3 * a] + p[3 * i + 1] * g[3 * a + 1] + p[3 * i + 2] * g[3 * a + 2]);
            fa[i] += f;
            f0[i] -= f;
        }
    }
}

Matrix3 cell_stress(const ElasticCells &body, std::size_t c, std::span<const double> displacement) {
    const Matrix3 h = body.gradient(c, displacement);
    if (body.is_linear_in_strain())
        return first_piola_kirchhoff_stress(h, body.moduli_of(c), body.strain);
    return visit_law(body, body.moduli_of(c), h, [](const auto &law) { return law.stress(); });
}

std::array<Matrix3, 16> cell_tangent(const ElasticCells &body, std::size_t c,
                                     std::span<const double> displacement, double weight) {
    const Matrix3 h = body.gradient(c, displacement);
    const double volume = weight * body.rest.volumes[c];
    if (body.is_linear_in_strain())
        return tangent_blocks(h, body.rest.gradients[c], volume, body.moduli_of(c), body.strain);
    return visit_law(body, body.moduli_of(c), h, [&](const auto &law) {
        return blocks_of_changes(body.rest.gradients[c], volume,
                                 [&](const Matrix3 &dh) { return law.change(dh); });
    });
}

void add_internal_force(const ElasticCells &body, std::span<const double> displacement,
                        std::span<double> force) {
    for (std::size_t c = 0; c < body.size(); ++c)
        add_cell_force(body, c, cell_stress(body, c, displacement), force);
}

double strain_energy(const ElasticCells &body, std::span<const double> displacement) {
    double energy = 0.0;
    for (std::size_t c = 0; c < body.size(); ++c) {
        const Matrix3 h = body.gradient(c, displacement);
        const double density = body.is_linear_in_strain()
                                   ? strain_energy_density(h, body.moduli_of(c), body.strain)
                                   : visit_law(body, body.moduli_of(c), h,
                                               [](const auto &law) { return law.energy(); });
        energy += body.rest.volumes[c] * density;
    }
    return energy;
}

void cell_det_f(const ElasticCells &body, std::span<const double> displacement,
                std::span<double> out) {
    for (std::size_t c = 0; c < body.size(); ++c)
        out[c] = det_f(body.gradient(c, displacement));
}

} // namespace fastsim
