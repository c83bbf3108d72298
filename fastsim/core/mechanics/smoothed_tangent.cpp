// The tangent of (S3). With dE_c = sym(F^T du (x) g_a) and D its matrix (Mandel's components, so
// that E : E is a dot product; t its trace, t_a = F g_a), averaged like E and theta:
//
//   K_ab = sum over e of 2 mu V_e D_e,a^T D_e,b + sum over n of lmbda V_n t_n,a t_n,b^T
//          + sum over c of V_c (g_a . S_c g_b) I
//
// By another law, with the moduli dS_0/dE of each edge, t_a = (dm/dF) g_a and the node's
// lmbda (g'^2 + g g''), and p_c d2m/dF2 beside the last term.

#include "mechanics/smoothed_law.hpp"
#include "mechanics/smoothed_tet4.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace fastsim {

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

using Vector3 = std::array<double, 3>;
using StrainRate = std::array<Vector3, 6>; // of one point: xx, yy, zz, then root 2 times yz, xz, xy

Vector3 times(const Matrix3 &m, const Vector3 &v) {
    return {m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
            m[6] * v[0] + m[7] * v[1] + m[8] * v[2]};
}

StrainRate strain_rate(const Matrix3 &f, const Vector3 &g) {
    static const double half_root = std::sqrt(0.5);
    StrainRate d{};
    for (std::size_t k = 0; k < 3; ++k) {
        for (std::size_t i = 0; i < 3; ++i)
            d[i][k] = f[3 * k + i] * g[i];
        d[3][k] = half_root * (f[3 * k + 1] * g[2] + f[3 * k + 2] * g[1]);
        d[4][k] = half_root * (f[3 * k] * g[2] + f[3 * k + 2] * g[0]);
        d[5][k] = half_root * (f[3 * k] * g[1] + f[3 * k + 1] * g[0]);
    }
    return d;
}

std::array<double, 6> mandel(const Matrix3 &e) {
    static const double root = std::sqrt(2.0);
    return {e[0], e[4], e[8], root * e[5], root * e[2], root * e[1]};
}

/// What a symmetric tensor does along a rate.
Vector3 times(const std::array<double, 6> &tensor, const StrainRate &rate) {
    Vector3 found{};
    for (std::size_t m = 0; m < 6; ++m)
        for (std::size_t k = 0; k < 3; ++k)
            found[k] += tensor[m] * rate[m][k];
    return found;
}

Vector3 trace(const StrainRate &rate) {
    return {rate[0][0] + rate[1][0] + rate[2][0], rate[0][1] + rate[1][1] + rate[2][1],
            rate[0][2] + rate[1][2] + rate[2][2]};
}

StrainRate times(const Mandel6 &moduli, const StrainRate &rate) {
    StrainRate found{};
    for (std::size_t i = 0; i < 6; ++i)
        for (std::size_t j = 0; j < 6; ++j)
            for (std::size_t k = 0; k < 3; ++k)
                found[i][k] += moduli[6 * i + j] * rate[j][k];
    return found;
}

/// V p d2m/dF2 of a cell, block ab for changes e_k g_b^T.
std::array<Matrix3, 16> volume_bends(const ElasticCells &body, std::size_t c,
                                     std::span<const double> displacement, double pressure) {
    const VolumeMeasure measure(body.law, body.gradient(c, displacement));
    return blocks_of_changes(body.rest.gradients[c], body.rest.volumes[c] * pressure,
                             [&](const Matrix3 &dh) { return measure.rate_change(dh); });
}

/// The points of a patch, numbered in the order in which they are met, each with a sum.
template <typename Sum> class PatchSums {
  public:
    explicit PatchSums(std::size_t num_points) : _place(num_points, -1) {}

    Sum &of(Index point) {
        Index &place = _place[at(point)];
        if (place < 0) {
            place = static_cast<Index>(points.size());
            points.push_back(point);
            sums.push_back(Sum{});
        }
        return sums[at(place)];
    }
    void clear() {
        for (const Index point : points)
            _place[at(point)] = -1;
        points.clear();
        sums.clear();
    }

    std::vector<Index> points;
    std::vector<Sum> sums;

  private:
    std::vector<Index> _place;
};

/// Calls add(block, a, b) for all pairs of so many points with the block of theirs.
template <typename Add>
void visit_blocks(BlockMatrix &matrix, std::span<const Index> points, const Add &add) {
    for (std::size_t a = 0; a < points.size(); ++a) {
        const std::size_t row = at(points[a]);
        const auto first =
            matrix.columns.begin() + static_cast<std::ptrdiff_t>(matrix.row_start[row]);
        const auto last =
            matrix.columns.begin() + static_cast<std::ptrdiff_t>(matrix.row_start[row + 1]);
        for (std::size_t b = 0; b < points.size(); ++b) {
            const auto place = std::lower_bound(first, last, points[b]);
            add(matrix.blocks[static_cast<std::size_t>(place - matrix.columns.begin())], a, b);
        }
    }
}

} // namespace

BlockMatrix make_smoothed_matrix(std::size_t num_points, const ElasticCells &body,
                                 const SmoothingPatches &patches) {
    const Groups cells_of = rows_naming(patches.cell_nodes, 4, patches.num_nodes());
    const Groups nodes_of = rows_naming(patches.node_point, 1, num_points);
    BlockMatrix matrix;
    matrix.num_points = num_points;
    matrix.row_start.assign(1, 0);
    matrix.diagonal.resize(num_points);
    std::vector<Index> last_row(num_points, -1), row;
    std::vector<Index> last_node(patches.num_nodes(), -1);
    const auto visit_corners = [&](Index node, const auto &visit) {
        for (const Index cell : cells_of.of(at(node)))
            for (std::size_t a = 0; a < 4; ++a)
                visit(4 * at(cell) + a);
    };
    for (std::size_t i = 0; i < num_points; ++i) {
        const auto mark = static_cast<Index>(i);
        row.assign(1, mark);
        last_row[i] = mark;
        for (const Index own : nodes_of.of(i))
            visit_corners(own, [&](std::size_t beside) {
                const Index node = patches.cell_nodes[beside];
                if (last_node[at(node)] == mark)
                    return;
                last_node[at(node)] = mark;
                visit_corners(node, [&](std::size_t corner) {
                    const Index point = body.cells[corner];
                    if (last_row[at(point)] == mark)
                        return;
                    last_row[at(point)] = mark;
                    row.push_back(point);
                });
            });
        std::sort(row.begin(), row.end());
        const auto own = std::lower_bound(row.begin(), row.end(), mark) - row.begin();
        matrix.diagonal[i] = matrix.columns.size() + static_cast<std::size_t>(own);
        matrix.columns.insert(matrix.columns.end(), row.begin(), row.end());
        matrix.row_start.push_back(matrix.columns.size());
    }
    matrix.columns.shrink_to_fit();
    matrix.blocks.assign(matrix.columns.size(), Matrix3{});
    return matrix;
}

void add_smoothed_tangent(const ElasticCells &body, const SmoothingPatches &patches,
                          std::span<const double> displacement, double weight,
                          BlockMatrix &matrix) {
    const bool is_green = body.strain == StrainMeasure::green;
    std::optional<SmoothedLaw> law;
    if (!body.is_linear_in_strain())
        law.emplace(body, patches, displacement, true);
    std::vector<Matrix3> deformations(body.size()), volume_rates, stresses;
    for (std::size_t c = 0; c < body.size(); ++c) {
        const Matrix3 h = body.gradient(c, displacement);
        if (law)
            volume_rates.push_back(VolumeMeasure(body.law, h).rate);
        else
            stresses.push_back(strain_tensor(h, body.strain));
        deformations[c] = deformation_gradient(is_green ? h : Matrix3{});
    }
    const std::vector<Matrix3> &rates = law ? volume_rates : deformations;
    const auto visit_corners = [&](std::size_t c, const auto &visit) {
        const auto g = all_gradients(body.rest.gradients[c]);
        for (std::size_t a = 0; a < 4; ++a)
            visit(body.cells[4 * c + a], g[a]);
    };
    const Groups of_edges = rows_naming(patches.cell_edges, 6, patches.num_edges());
    PatchSums<StrainRate> edge(matrix.num_points);
    PatchSums<Vector3> work(matrix.num_points);
    std::vector<StrainRate> moduli_times;
    std::optional<EdgeBlends> blend;
    if (blends(body))
        blend.emplace(body, patches, stresses);
    for (std::size_t e = 0; e < patches.num_edges(); ++e, edge.clear(), work.clear()) {
        const bool blended = blend && blend->beta[e] > 0.0;
        for (const Index cell : of_edges.of(e)) {
            const std::size_t c = at(cell);
            const double part = body.rest.volumes[c] / 6.0 / patches.edge_volume[e];
            visit_corners(c, [&](Index point, const Vector3 &g) {
                const StrainRate d = strain_rate(deformations[c], g);
                StrainRate &sum = edge.of(point);
                for (std::size_t m = 0; m < 6; ++m)
                    for (std::size_t k = 0; k < 3; ++k)
                        sum[m][k] += part * d[m][k];
                if (blended) {
                    Vector3 &of = work.of(point);
                    const Vector3 w = times(mandel(stresses[c]), d);
                    for (std::size_t k = 0; k < 3; ++k)
                        of[k] += part * w[k];
                }
            });
        }
        if (blended)
            for (std::size_t a = 0; a < work.sums.size(); ++a) {
                const Vector3 w = times(mandel(blend->strains[e]), edge.sums[a]);
                for (std::size_t k = 0; k < 3; ++k)
                    work.sums[a][k] -= w[k];
            }
        double factor = weight * patches.edge_volume[e];
        if (law) {
            moduli_times.clear();
            for (const StrainRate &rate : edge.sums)
                moduli_times.push_back(times(law->edge_moduli[e], rate));
        } else
            factor *= 2.0 * body.materials[at(patches.edge_material[e])].mu;
        const std::vector<StrainRate> &rights = law ? moduli_times : edge.sums;
        visit_blocks(matrix, edge.points, [&](Matrix3 &block, std::size_t a, std::size_t b) {
            const StrainRate &left = edge.sums[a], &right = rights[b];
            Matrix3 product{};
            for (std::size_t m = 0; m < 6; ++m)
                for (std::size_t i = 0; i < 3; ++i)
                    for (std::size_t j = 0; j < 3; ++j)
                        product[3 * i + j] += left[m][i] * right[m][j];
            if (blended) {
                const Vector3 s = trace(left), t = trace(right);
                const Vector3 &v = work.sums[a], &w = work.sums[b];
                const double bend = 0.5 * blend->bend[e] * blend->variance[e];
                for (std::size_t i = 0; i < 3; ++i)
                    for (std::size_t j = 0; j < 3; ++j)
                        product[3 * i + j] = (1.0 - blend->beta[e]) * product[3 * i + j] +
                                             bend * s[i] * t[j] +
                                             blend->slope[e] * (v[i] * t[j] + s[i] * w[j]);
            }
            for (std::size_t k = 0; k < 9; ++k)
                block[k] += factor * product[k];
        });
    }
    const Groups of_nodes = rows_naming(patches.cell_nodes, 4, patches.num_nodes());
    PatchSums<Vector3> node(matrix.num_points);
    for (std::size_t n = 0; n < patches.num_nodes(); ++n, node.clear()) {
        for (const Index cell : of_nodes.of(n)) {
            const std::size_t c = at(cell);
            const double part = body.rest.volumes[c] / 4.0 / patches.node_volume[n];
            visit_corners(c, [&](Index point, const Vector3 &g) {
                const Vector3 t = times(rates[c], g);
                Vector3 &sum = node.of(point);
                for (std::size_t k = 0; k < 3; ++k)
                    sum[k] += part * t[k];
            });
        }
        const double factor =
            weight * patches.node_volume[n] *
            (law ? law->node_moduli[n] : body.materials[at(patches.node_material[n])].lmbda);
        visit_blocks(matrix, node.points, [&](Matrix3 &block, std::size_t a, std::size_t b) {
            for (std::size_t i = 0; i < 3; ++i)
                for (std::size_t j = 0; j < 3; ++j)
                    block[3 * i + j] += factor * node.sums[a][i] * node.sums[b][j];
        });
    }
    if (!is_green)
        return;
    std::array<Matrix3, 16> bends{};
    if (!law) {
        const std::vector<Matrix3> strains = stresses;
        smoothed_stresses(body, patches, strains, stresses);
        add_blend(body, patches, *blend, strains, stresses);
    }
    for (std::size_t c = 0; c < body.size(); ++c) {
        const auto g = all_gradients(body.rest.gradients[c]);
        double own = 0.0;
        if (blend)
            for (std::size_t k = 0; k < 6; ++k)
                own += blend->beta[at(patches.cell_edges[6 * c + k])] / 6.0;
        own *= 2.0 * body.moduli_of(c).mu * weight * body.rest.volumes[c];
        if (law)
            bends = volume_bends(body, c, displacement, weight * law->pressures[c]);
        visit_blocks(matrix, std::span(body.cells).subspan(4 * c, 4),
                     [&](Matrix3 &block, std::size_t a, std::size_t b) {
                         const Vector3 sg = times(law ? law->stresses[c] : stresses[c], g[b]);
                         const double geometric =
                             weight * body.rest.volumes[c] *
                             (g[a][0] * sg[0] + g[a][1] * sg[1] + g[a][2] * sg[2]);
                         for (std::size_t i = 0; i < 9; i += 4)
                             block[i] += geometric;
                         if (own > 0.0) {
                             const StrainRate da = strain_rate(deformations[c], g[a]),
                                              db = strain_rate(deformations[c], g[b]);
                             for (std::size_t m = 0; m < 6; ++m)
                                 for (std::size_t i = 0; i < 3; ++i)
                                     for (std::size_t j = 0; j < 3; ++j)
                                         block[3 * i + j] += own * da[m][i] * db[m][j];
                         }
                         if (law)
                             for (std::size_t i = 0; i < 9; ++i)
                                 block[i] += bends[4 * a + b][i];
                     });
    }
}

} // namespace fastsim
