// Bindings of the mechanics: no logic, no defaults. Python has checked every array.
#include "bind_arrays.hpp"
#include "mechanics/block_matrix.hpp"
#include "mechanics/central_difference.hpp"
#include "mechanics/conjugate_gradient.hpp"
#include "mechanics/tet4.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <optional>
#include <span>
#include <tuple>

namespace nb = nanobind;
using namespace fastsim;

namespace {

template <typename T>
using Table3 = nb::ndarray<T, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Vector = nb::ndarray<T, nb::numpy, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Facets = nb::ndarray<const Index, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Cells = nb::ndarray<const Index, nb::numpy, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;

template <typename Array> auto as_span(Array &array) {
    return std::span(array.data(), array.size());
}

/// A mesh with its rest data, kept between calls.
struct Solid {
    std::vector<Index> cells;
    std::size_t num_points;
    std::vector<double> points;
    RestCells rest;
    BlockMatrix matrix;
    std::optional<Multigrid> multigrid;
};

Solid make_solid(Table3<const double> points, Cells cells) {
    const std::span<const Index> view = as_span(cells);
    const std::span<const double> positions = as_span(points);
    nb::gil_scoped_release release;
    Solid solid;
    solid.cells.assign(view.begin(), view.end());
    solid.num_points = points.shape(0);
    solid.points.assign(positions.begin(), positions.end());
    solid.rest = make_rest_cells(as_span(points), solid.cells);
    return solid;
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

    nb::class_<Solid>(module, "Solid")
        .def_static("make", &make_solid, nb::arg("points").noconvert(),
                    nb::arg("cells").noconvert())
        .def(
            "internal_force",
            [](const Solid &solid, Table3<const double> displacement, double lmbda, double mu,
               StrainMeasure strain, Table3<double> force) {
                nb::gil_scoped_release release;
                add_internal_force(solid.rest, solid.cells, as_span(displacement), {lmbda, mu},
                                   strain, as_span(force));
            },
            nb::arg("displacement").noconvert(), nb::arg("lmbda"), nb::arg("mu"), nb::arg("strain"),
            nb::arg("force").noconvert())
        .def(
            "strain_energy",
            [](const Solid &solid, Table3<const double> displacement, double lmbda, double mu,
               StrainMeasure strain) {
                nb::gil_scoped_release release;
                return strain_energy(solid.rest, solid.cells, as_span(displacement), {lmbda, mu},
                                     strain);
            },
            nb::arg("displacement").noconvert(), nb::arg("lmbda"), nb::arg("mu"), nb::arg("strain"))
        .def(
            "det_f",
            [](const Solid &solid, Table3<const double> displacement, Vector<double> out) {
                nb::gil_scoped_release release;
                cell_det_f(solid.rest, solid.cells, as_span(displacement), as_span(out));
            },
            nb::arg("displacement").noconvert(), nb::arg("out").noconvert())
        .def(
            "assemble_tangent",
            [](Solid &solid, Table3<const double> displacement, double lmbda, double mu,
               StrainMeasure strain) {
                nb::gil_scoped_release release;
                if (solid.matrix.num_points == 0)
                    solid.matrix = make_block_matrix(solid.num_points, solid.cells);
                assemble_tangent(solid.rest, solid.cells, as_span(displacement), {lmbda, mu},
                                 strain, solid.matrix);
            },
            nb::arg("displacement").noconvert(), nb::arg("lmbda"), nb::arg("mu"), nb::arg("strain"))
        .def(
            "assemble_secant",
            [](Solid &solid, Table3<const double> displacement, double lmbda, double mu,
               StrainMeasure strain) {
                nb::gil_scoped_release release;
                if (solid.matrix.num_points == 0)
                    solid.matrix = make_block_matrix(solid.num_points, solid.cells);
                assemble_secant(solid.rest, solid.cells, as_span(displacement), {lmbda, mu}, strain,
                                solid.matrix);
            },
            nb::arg("displacement").noconvert(), nb::arg("lmbda"), nb::arg("mu"), nb::arg("strain"))
        .def(
            "add_pressure_tangent",
            [](Solid &solid, Table3<const double> displaced_points, Facets facets,
               double pressure) {
                nb::gil_scoped_release release;
                add_pressure_tangent(as_span(displaced_points), as_span(facets), pressure,
                                     solid.matrix);
            },
            nb::arg("displaced_points").noconvert(), nb::arg("facets").noconvert(),
            nb::arg("pressure"))
        .def(
            "add_diagonal_blocks",
            [](Solid &solid, GivenColumn<Index> points, GivenTable<double, 9> blocks) {
                nb::gil_scoped_release release;
                add_diagonal_blocks({points.data(), points.size()}, as_rows<Matrix3>(blocks),
                                    solid.matrix);
            },
            nb::arg("points").noconvert(), nb::arg("blocks").noconvert())
        .def(
            "absolute_row_sums",
            [](const Solid &solid, Table3<double> sums) {
                nb::gil_scoped_release release;
                absolute_row_sums(solid.matrix, as_span(sums));
            },
            nb::arg("sums").noconvert())
        .def(
            "multiply_tangent",
            [](const Solid &solid, Table3<const double> x, Table3<double> y) {
                nb::gil_scoped_release release;
                multiply(solid.matrix, as_span(x), as_span(y));
            },
            nb::arg("x").noconvert(), nb::arg("y").noconvert())
        .def(
            "build_multigrid",
            [](Solid &solid, Table3<const std::uint8_t> is_free) {
                nb::gil_scoped_release release;
                solid.multigrid.emplace(solid.matrix, solid.points, as_span(is_free));
                return solid.multigrid->num_levels();
            },
            nb::arg("is_free").noconvert())
        .def(
            "apply_multigrid",
            [](const Solid &solid, Table3<const double> b, Table3<double> x) {
                nb::gil_scoped_release release;
                solid.multigrid.value().apply(solid.matrix, as_span(b), as_span(x));
            },
            nb::arg("b").noconvert(), nb::arg("x").noconvert())
        .def(
            "solve_tangent",
            [](Solid &solid, Table3<const double> b, Table3<const std::uint8_t> is_free,
               double absolute_tolerance, std::int64_t max_iterations, bool uses_multigrid,
               Table3<double> x) {
                nb::gil_scoped_release release;
                if (uses_multigrid)
                    solid.multigrid.value().set_finest(solid.matrix, as_span(is_free));
                const SolveResult result = conjugate_gradient(
                    solid.matrix, as_span(b), as_span(is_free), absolute_tolerance, max_iterations,
                    uses_multigrid ? &solid.multigrid.value() : nullptr, as_span(x));
                return std::make_tuple(result.status, result.iterations, result.residual_norm);
            },
            nb::arg("b").noconvert(), nb::arg("is_free").noconvert(), nb::arg("absolute_tolerance"),
            nb::arg("max_iterations"), nb::arg("uses_multigrid"), nb::arg("x").noconvert())
        .def(
            "central_difference",
            [](const Solid &solid, double lmbda, double mu, StrainMeasure strain,
               Vector<const double> lumped_mass, Table3<const double> external_force,
               Table3<const std::uint8_t> is_free, double time_step, double mass_damping,
               double displacement_limit, std::int64_t num_steps, Table3<double> displacement,
               Table3<double> previous) {
                nb::gil_scoped_release release;
                const StepOutcome outcome = central_difference(
                    solid.rest, solid.cells, {lmbda, mu}, strain, as_span(lumped_mass),
                    as_span(external_force), as_span(is_free),
                    {time_step, mass_damping, displacement_limit}, num_steps, as_span(displacement),
                    as_span(previous));
                return std::make_tuple(outcome.steps_done, outcome.is_blown_up);
            },
            nb::arg("lmbda"), nb::arg("mu"), nb::arg("strain"), nb::arg("lumped_mass").noconvert(),
            nb::arg("external_force").noconvert(), nb::arg("is_free").noconvert(),
            nb::arg("time_step"), nb::arg("mass_damping"), nb::arg("displacement_limit"),
            nb::arg("num_steps"), nb::arg("displacement").noconvert(),
            nb::arg("previous").noconvert());
}
