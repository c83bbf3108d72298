// Bindings of the mechanics: no logic, no defaults. Python has checked every array.
#include "bind_arrays.hpp"
#include "mechanics/cell_bounds.hpp"
#include "mechanics/elastic_body.hpp"
#include "mechanics/smoothed_bound.hpp"

#include <nanobind/stl/string_view.h>
#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>

using namespace fastsim;

using Vectors = GivenPoints; // three numbers for each point
using Flags = GivenTable<std::uint8_t, 3>;

namespace {

/// What `fill` writes into a new array of the size of the points, without Python's lock.
template <typename Fill> auto vectors_by(const ElasticBody &body, Fill &&fill) {
    auto out = new_array<double>({body.points.size() / 3, 3});
    nb::gil_scoped_release release;
    fill(as_span(out));
    return out;
}

Law law_of_name(std::string_view name) {
#define FASTSIM_CHOOSE(law)                                                                        \
    if (name == #law)                                                                              \
        return Law::law;
    FASTSIM_LAWS(FASTSIM_CHOOSE)
#undef FASTSIM_CHOOSE
    throw std::invalid_argument("no law of that name: " + std::string(name));
}

} // namespace

void bind_mechanics(nb::module_ &module);

void bind_mechanics(nb::module_ &module) {
    nb::enum_<StrainMeasure>(module, "StrainMeasure")
        .value("linear", StrainMeasure::linear)
        .value("green", StrainMeasure::green);
    nb::enum_<SolveStatus>(module, "SolveStatus")
        .value("converged", SolveStatus::converged)
        .value("negative_curvature", SolveStatus::negative_curvature)
        .value("iteration_limit", SolveStatus::iteration_limit);

    nb::enum_<Element>(module, "Element")
        .value("linear", Element::linear)
        .value("smoothed", Element::smoothed);

    nb::class_<ElasticBody>(module, "ElasticBody")
        .def(
            "__init__",
            [](ElasticBody *self, GivenPoints points, GivenCells cells,
               GivenTable<double, 3> materials, GivenColumn<Index> material_of,
               StrainMeasure strain, std::string_view law, Element element) {
                nb::gil_scoped_release release;
                new (self) ElasticBody(
                    as_span(points),
                    make_elastic_cells(as_span(points), as_span(cells), as_rows<Moduli>(materials),
                                       as_span(material_of), strain, law_of_name(law)),
                    element);
            },
            nb::arg("points").noconvert(), nb::arg("cells").noconvert(),
            nb::arg("materials").noconvert(), nb::arg("material_of").noconvert(), nb::arg("strain"),
            nb::arg("law"), nb::arg("element"))
        .def(
            "set_ogden_terms",
            [](ElasticBody &body, GivenTable<double, 2> terms) {
                const auto rows = as_rows<OgdenTerm>(terms);
                body.elastic.ogden_terms.assign(rows.begin(), rows.end());
            },
            nb::arg("terms").noconvert())
        .def("shape_gradients",
             [](const ElasticBody &body) { return as_table(body.elastic.rest.gradients); })
        .def(
            "displacement_gradients",
            [](const ElasticBody &body, Vectors displacement) {
                std::vector<Matrix3> gradients(body.elastic.size());
                for (std::size_t c = 0; c < gradients.size(); ++c)
                    gradients[c] = body.elastic.gradient(c, as_span(displacement));
                return as_table(gradients);
            },
            nb::arg("displacement").noconvert())
        .def(
            "smoothed_bound",
            [](const ElasticBody &body, GivenColumn<double> lumped_mass, int rounds) {
                nb::gil_scoped_release release;
                return bound_on_squared_frequency(body.elastic, body.patches.value(),
                                                  as_span(lumped_mass), rounds);
            },
            nb::arg("lumped_mass").noconvert(), nb::arg("rounds"))
        .def(
            "first_piola_kirchhoff_stresses",
            [](const ElasticBody &body, Vectors displacement) {
                std::vector<Matrix3> found(body.elastic.size());
                body.piola_stresses(as_span(displacement), found);
                return as_table(found);
            },
            nb::arg("displacement").noconvert())
        .def(
            "stresses",
            [](const ElasticBody &body, GivenTable<double, 9> strains) {
                std::vector<Matrix3> found(body.elastic.size());
                body.stresses(as_rows<Matrix3>(strains), found);
                return as_table(found);
            },
            nb::arg("strains").noconvert())
        .def(
            "internal_force",
            [](const ElasticBody &body, Vectors displacement) {
                return vectors_by(body, [&](auto force) {
                    body.add_internal_force(as_span(displacement), force);
                });
            },
            nb::arg("displacement").noconvert())
        .def(
            "strain_energy",
            [](const ElasticBody &body, Vectors displacement) {
                nb::gil_scoped_release release;
                return body.strain_energy(as_span(displacement));
            },
            nb::arg("displacement").noconvert())
        .def(
            "det_f",
            [](const ElasticBody &body, Vectors displacement) {
                auto out = new_array<double>({body.elastic.size()});
                nb::gil_scoped_release release;
                cell_det_f(body.elastic, as_span(displacement), as_span(out));
                return out;
            },
            nb::arg("displacement").noconvert())
        .def(
            "assemble_tangent",
            [](ElasticBody &body, Vectors displacement) {
                nb::gil_scoped_release release;
                body.assemble_tangent(as_span(displacement));
            },
            nb::arg("displacement").noconvert())
        .def(
            "assemble_secant",
            [](ElasticBody &body, Vectors displacement) {
                nb::gil_scoped_release release;
                body.assemble_secant(as_span(displacement));
            },
            nb::arg("displacement").noconvert())
        .def(
            "add_pressure_tangent",
            [](ElasticBody &body, GivenPoints displaced_points, GivenFacets facets,
               double pressure) {
                nb::gil_scoped_release release;
                add_pressure_tangent(as_span(displaced_points), as_span(facets), pressure,
                                     body.matrix);
            },
            nb::arg("displaced_points").noconvert(), nb::arg("facets").noconvert(),
            nb::arg("pressure"))
        .def(
            "add_facet_stiffness",
            [](ElasticBody &body, GivenFacets facets, GivenTable<double, 9> stiffnesses) {
                nb::gil_scoped_release release;
                add_facet_stiffness(as_span(facets), as_span(stiffnesses), body.matrix);
            },
            nb::arg("facets").noconvert(), nb::arg("stiffnesses").noconvert())
        .def(
            "extend_pattern",
            [](ElasticBody &body, GivenColumn<Index> rows, GivenColumn<Index> columns) {
                nb::gil_scoped_release release;
                extend_pattern(as_span(rows), as_span(columns), body.elastic.cells, body.matrix);
            },
            nb::arg("rows").noconvert(), nb::arg("columns").noconvert())
        .def(
            "add_blocks",
            [](ElasticBody &body, GivenColumn<Index> rows, GivenColumn<Index> columns,
               GivenTable<double, 9> blocks) {
                nb::gil_scoped_release release;
                add_blocks(as_span(rows), as_span(columns), as_rows<Matrix3>(blocks), body.matrix);
            },
            nb::arg("rows").noconvert(), nb::arg("columns").noconvert(),
            nb::arg("blocks").noconvert())
        .def(
            "set_frames",
            [](ElasticBody &body, GivenColumn<Index> points, GivenTable<double, 9> axes) {
                const auto numbers = as_span(points);
                const auto rows = as_rows<Matrix3>(axes);
                body.frames = {{numbers.begin(), numbers.end()}, {rows.begin(), rows.end()}};
            },
            nb::arg("points").noconvert(), nb::arg("axes").noconvert())
        .def("turn_matrix",
             [](ElasticBody &body) {
                 nb::gil_scoped_release release;
                 body.turn_matrix();
             })
        .def("absolute_row_sums",
             [](const ElasticBody &body) {
                 return vectors_by(body, [&](auto sums) { absolute_row_sums(body.matrix, sums); });
             })
        .def(
            "multiply",
            [](const ElasticBody &body, Vectors x) {
                return vectors_by(body, [&](auto y) { multiply(body.matrix, as_span(x), y); });
            },
            nb::arg("x").noconvert())
        .def("matrix",
             [](const ElasticBody &body) {
                 const BlockMatrix &matrix = body.matrix;
                 auto row_start = new_array<Index>({matrix.row_start.size()});
                 std::ranges::transform(matrix.row_start, row_start.data(), [](std::size_t entry) {
                     return static_cast<Index>(entry);
                 });
                 return std::make_tuple(row_start, as_column<Index>(std::span(matrix.columns)),
                                        as_table(matrix.blocks));
             })
        .def(
            "build_multigrid",
            [](ElasticBody &body, Flags is_free) {
                nb::gil_scoped_release release;
                body.multigrid.emplace(body.matrix, body.points, as_span(is_free), body.frames);
                return body.multigrid->num_levels();
            },
            nb::arg("is_free").noconvert())
        .def(
            "apply_multigrid",
            [](const ElasticBody &body, Vectors b) {
                return vectors_by(body, [&](auto x) {
                    body.multigrid.value().apply(body.matrix, as_span(b), x);
                });
            },
            nb::arg("b").noconvert())
        .def(
            "solve",
            [](ElasticBody &body, Vectors b, Flags is_free, double absolute_tolerance,
               std::int64_t max_iterations, bool uses_multigrid) {
                SolveResult result{};
                auto x = vectors_by(body, [&](auto out) {
                    if (uses_multigrid)
                        body.multigrid.value().set_finest(body.matrix, as_span(is_free));
                    result = conjugate_gradient(
                        body.matrix, as_span(b), as_span(is_free), absolute_tolerance,
                        max_iterations, uses_multigrid ? &body.multigrid.value() : nullptr, out);
                });
                return std::make_tuple(x, result.status, result.iterations);
            },
            nb::arg("b").noconvert(), nb::arg("is_free").noconvert(), nb::arg("absolute_tolerance"),
            nb::arg("max_iterations"), nb::arg("uses_multigrid"));

    module.def(
        "bound_cell_stiffness",
        [](GivenPoints points, GivenCells cells, double lmbda, double mu) {
            auto upper = new_array<double>({cells.shape(0)});
            auto lower = new_array<double>({cells.shape(0)});
            double largest_cosine = 0.0;
            {
                nb::gil_scoped_release release;
                largest_cosine = bound_cell_stiffness(as_rows<Point>(points),
                                                      as_rows<std::array<Index, 4>>(cells), lmbda,
                                                      mu, as_span(upper), as_span(lower));
            }
            return std::make_tuple(largest_cosine, upper, lower);
        },
        nb::arg("points").noconvert(), nb::arg("cells").noconvert(), nb::arg("lmbda"),
        nb::arg("mu"));
}
