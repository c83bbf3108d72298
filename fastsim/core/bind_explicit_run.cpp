// Bindings of the fast explicit run: no logic, no defaults. Python has checked every array.
#include "mechanics/explicit_run.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <memory>
#include <span>
#include <tuple>

namespace nb = nanobind;
using namespace fastsim;

namespace {

template <typename T>
using Table3 = nb::ndarray<T, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using States = nb::ndarray<T, nb::numpy, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Rows = nb::ndarray<T, nb::numpy, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Vector = nb::ndarray<T, nb::numpy, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Facets = nb::ndarray<const Index, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Cells = nb::ndarray<const Index, nb::numpy, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;

template <typename Array> auto as_span(Array &array) {
    return std::span(array.data(), array.size());
}

template <typename Real> void bind_run(nb::module_ &module, const char *name) {
    using Run = ExplicitRun<Real>;
    nb::class_<Run>(module, name)
        .def_static(
            "make",
            [](Table3<const double> points, Cells cells, Vector<const double> lumped_mass,
               Table3<const std::uint8_t> is_free, double lmbda, double mu, StrainMeasure strain,
               double time_step, double mass_damping, double displacement_limit,
               std::size_t num_threads, InstructionSet at_most, bool tracks_energy) {
                nb::gil_scoped_release release;
                return Run(as_span(points), as_span(cells), as_span(lumped_mass), as_span(is_free),
                           {{lmbda, mu},
                            strain,
                            time_step,
                            mass_damping,
                            displacement_limit,
                            num_threads,
                            at_most,
                            tracks_energy});
            },
            nb::arg("points").noconvert(), nb::arg("cells").noconvert(),
            nb::arg("lumped_mass").noconvert(), nb::arg("is_free").noconvert(), nb::arg("lmbda"),
            nb::arg("mu"), nb::arg("strain"), nb::arg("time_step"), nb::arg("mass_damping"),
            nb::arg("displacement_limit"), nb::arg("num_threads"), nb::arg("at_most"),
            nb::arg("tracks_energy"))
        .def(
            "set_state",
            [](Run &run, Table3<const double> displacement, Table3<const double> increment,
               double energy) {
                nb::gil_scoped_release release;
                run.set_state(as_span(displacement), as_span(increment), energy);
            },
            nb::arg("displacement").noconvert(), nb::arg("increment").noconvert(),
            nb::arg("energy"))
        .def(
            "get_state",
            [](const Run &run, Table3<double> displacement, Table3<double> increment) {
                nb::gil_scoped_release release;
                run.get_state(as_span(displacement), as_span(increment));
            },
            nb::arg("displacement").noconvert(), nb::arg("increment").noconvert())
        .def(
            "set_dead_loads",
            [](Run &run, States<const double> forces) {
                nb::gil_scoped_release release;
                run.set_dead_loads(as_span(forces), forces.shape(0));
            },
            nb::arg("forces").noconvert())
        .def(
            "set_pressure",
            [](Run &run, Facets facets, Vector<const double> pressures,
               Vector<const Index> histories) {
                nb::gil_scoped_release release;
                run.set_pressure(as_span(facets), as_span(pressures), as_span(histories));
            },
            nb::arg("facets").noconvert(), nb::arg("pressures").noconvert(),
            nb::arg("histories").noconvert())
        .def(
            "set_moving_supports",
            [](Run &run, Table3<const double> values, Table3<const Index> histories) {
                nb::gil_scoped_release release;
                run.set_moving_supports(as_span(values), as_span(histories));
            },
            nb::arg("values").noconvert(), nb::arg("histories").noconvert())
        .def("set_mass_damping", &Run::set_mass_damping, nb::arg("mass_damping"))
        .def(
            "advance",
            [](Run &run, Rows<const double> factors, std::int64_t every,
               States<double> displacements, Table3<double> energies, Rows<const double> poses,
               Rows<double> reactions) {
                const ExplicitPlan plan{as_span(factors),
                                        factors.shape(1),
                                        static_cast<std::int64_t>(factors.shape(0)) - 2,
                                        every,
                                        as_span(displacements),
                                        as_span(energies),
                                        as_span(poses),
                                        as_span(reactions)};
                nb::gil_scoped_release release;
                const ExplicitOutcome outcome = run.advance(plan);
                return std::make_tuple(outcome.steps_done, outcome.reason, outcome.point);
            },
            nb::arg("factors").noconvert(), nb::arg("every"), nb::arg("displacements").noconvert(),
            nb::arg("energies").noconvert(), nb::arg("poses").noconvert(),
            nb::arg("reactions").noconvert())
        .def(
            "add_tool",
            [](Run &run, const ToolShape &shape, bool is_constraint, double friction, double reach,
               double deepest, const Point &direction, double mass, Table3<const double> points,
               Vector<const Index> vertices, Vector<const double> stiffnesses) {
                nb::gil_scoped_release release;
                run.add_tool({shape, is_constraint, friction, reach, deepest, direction, mass},
                             as_span(points), as_span(vertices), as_span(stiffnesses));
            },
            nb::arg("shape"), nb::arg("is_constraint"), nb::arg("friction"), nb::arg("reach"),
            nb::arg("deepest"), nb::arg("direction"), nb::arg("mass"),
            nb::arg("points").noconvert(), nb::arg("vertices").noconvert(),
            nb::arg("stiffnesses").noconvert())
        .def(
            "set_body_touch",
            [](Run &run, Table3<const double> points, Cells cells, Vector<const Index> vertices,
               Facets facets, Vector<const Index> parts, Vector<const double> stiffnesses,
               InstructionSet at_most) {
                nb::gil_scoped_release release;
                const std::span rest{reinterpret_cast<const Position *>(points.data()),
                                     points.shape(0)};
                const std::span rows{reinterpret_cast<const BodyTouch::Cell *>(cells.data()),
                                     cells.shape(0)};
                const std::span sides{reinterpret_cast<const BodyTouch::Facet *>(facets.data()),
                                      facets.shape(0)};
                run.set_body_touch(std::make_unique<BodyTouch>(rest, rows, as_span(vertices), sides,
                                                               as_span(parts), as_span(stiffnesses),
                                                               at_most),
                                   as_span(points));
            },
            nb::arg("points").noconvert(), nb::arg("cells").noconvert(),
            nb::arg("vertices").noconvert(), nb::arg("facets").noconvert(),
            nb::arg("parts").noconvert(), nb::arg("stiffnesses").noconvert(), nb::arg("at_most"))
        .def("body_touches", &Run::body_touches)
        .def(
            "get_contact_force",
            [](const Run &run, Table3<double> force) {
                nb::gil_scoped_release release;
                run.get_contact_force(as_span(force));
            },
            nb::arg("force").noconvert())
        .def(
            "internal_force",
            [](Run &run, Table3<double> force) {
                nb::gil_scoped_release release;
                run.internal_force(as_span(force));
            },
            nb::arg("force").noconvert())
        .def_prop_ro("instruction_set", [](const Run &run) { return run.instruction_set(); });
}

} // namespace

void bind_explicit_run(nb::module_ &module);

void bind_explicit_run(nb::module_ &module) {
    nb::enum_<InstructionSet>(module, "InstructionSet")
        .value("baseline", InstructionSet::baseline)
        .value("avx2", InstructionSet::avx2)
        .value("avx512", InstructionSet::avx512);
    nb::enum_<StopReason>(module, "StopReason")
        .value("none", StopReason::none)
        .value("inverted_cell", StopReason::inverted_cell)
        .value("out_of_bounds", StopReason::out_of_bounds)
        .value("energy_growth", StopReason::energy_growth)
        .value("deep_in_tool", StopReason::deep_in_tool);
    module.def("widest_instruction_set", &widest_instruction_set);
    bind_run<float>(module, "ExplicitRun32");
    bind_run<double>(module, "ExplicitRun64");
}
