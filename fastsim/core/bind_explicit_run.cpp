// Bindings of the fast explicit run: no logic, no defaults. Python has checked every array.
#include "bind_arrays.hpp"
#include "explicit/explicit_run.hpp"
#include "explicit/multirate.hpp"
#include "explicit/stiffness_at_rest.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>

#include <tuple>

using namespace fastsim;

using Vectors = GivenPoints; // three numbers for each point
using Rows = nb::ndarray<const double, nb::numpy, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using OwnVectors = nb::ndarray<double, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

namespace {

auto carry_out(ExplicitRun &run, const Rows &factors, const Rows &tools,
               ExplicitOutcome (ExplicitRun::*task)(const ExplicitPlan &)) {
    const std::span steps{reinterpret_cast<const ToolStep *>(tools.data()),
                          tools.size() * sizeof(double) / sizeof(ToolStep)};
    const ExplicitPlan plan{as_span(factors), steps, factors.shape(0)};
    nb::gil_scoped_release release;
    const ExplicitOutcome outcome = (run.*task)(plan);
    return std::make_tuple(outcome.steps_done, outcome.reason, outcome.point);
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
    module.def("ratio_of_classes", &ratio_of_classes);
    module.def("widest_instruction_set", &widest_instruction_set);

    nb::class_<StiffnessAtRest>(module, "StiffnessAtRest")
        .def(
            "__init__",
            [](StiffnessAtRest *self, const ElasticBody &body, InstructionSet at_most) {
                nb::gil_scoped_release release;
                new (self) StiffnessAtRest(body, at_most);
            },
            nb::arg("body"), nb::arg("at_most"))
        .def(
            "multiply",
            [](StiffnessAtRest &stiffness, Vectors x) {
                auto y = new_array<double>({stiffness.num_points(), 3});
                nb::gil_scoped_release release;
                stiffness.multiply(as_span(x), as_span(y));
                return y;
            },
            nb::arg("x").noconvert());

    nb::class_<CentralDifference>(module, "CentralDifference")
        .def(
            "__init__",
            [](CentralDifference *self, double time_step, double mass_damping) {
                new (self) CentralDifference{time_step, mass_damping};
            },
            nb::arg("time_step"), nb::arg("mass_damping"))
        .def_ro("time_step", &CentralDifference::time_step)
        .def_ro("mass_damping", &CentralDifference::mass_damping)
        .def(
            "next_increments",
            [](const CentralDifference &scheme, Vectors increment, GivenColumn<double> mass,
               Vectors force) {
                auto next = new_array<double>({mass.size(), 3});
                for (std::size_t i = 0; i < next.size(); ++i)
                    next.data()[i] =
                        next_increment(scheme.keep(), increment.data()[i],
                                       scheme.mobility(mass.data()[i / 3]), force.data()[i]);
                return next;
            },
            nb::arg("increment").noconvert(), nb::arg("mass").noconvert(),
            nb::arg("force").noconvert());

    using Run = ExplicitRun;
    nb::class_<Run>(module, "ExplicitRun")
        .def_static(
            "make",
            [](const ElasticBody &body, GivenColumn<double> lumped_mass,
               GivenTable<std::uint8_t, 3> is_free, double time_step, double mass_damping,
               double displacement_limit, std::size_t num_threads, InstructionSet at_most,
               double stiffness_damping, bool is_single, bool tracks_energy,
               GivenColumn<Index> classes) {
                nb::gil_scoped_release release;
                return Run::make(body, as_span(lumped_mass), as_span(is_free),
                                 {{time_step, mass_damping},
                                  displacement_limit,
                                  num_threads,
                                  at_most,
                                  stiffness_damping,
                                  is_single,
                                  tracks_energy,
                                  as_span(classes)});
            },
            nb::arg("body"), nb::arg("lumped_mass").noconvert(), nb::arg("is_free").noconvert(),
            nb::kw_only(), nb::arg("time_step"), nb::arg("mass_damping"),
            nb::arg("displacement_limit"), nb::arg("num_threads"), nb::arg("at_most"),
            nb::arg("stiffness_damping"), nb::arg("is_single"), nb::arg("tracks_energy"),
            nb::arg("classes").noconvert(), nb::keep_alive<0, 1>())
        .def(
            "set_state",
            [](Run &run, Vectors displacement, Vectors increment, double energy) {
                run.set_state(as_span(displacement), as_span(increment), energy);
            },
            nb::arg("displacement").noconvert(), nb::arg("increment").noconvert(),
            nb::arg("energy"))
        .def(
            "get_state",
            [](const Run &run, OwnVectors displacement, OwnVectors increment) {
                run.get_state(as_span(displacement), as_span(increment));
            },
            nb::arg("displacement").noconvert(), nb::arg("increment").noconvert())
        .def(
            "set_dead_load",
            [](Run &run, std::size_t history, Vectors forces) {
                run.set_dead_load(history, as_span(forces));
            },
            nb::arg("history"), nb::arg("forces").noconvert())
        .def(
            "set_pressure",
            [](Run &run, GivenPoints points, GivenFacets facets, GivenColumn<double> pressures,
               GivenColumn<Index> histories) {
                run.set_pressure(as_span(points), as_span(facets), as_span(pressures),
                                 as_span(histories));
            },
            nb::arg("points").noconvert(), nb::arg("facets").noconvert(),
            nb::arg("pressures").noconvert(), nb::arg("histories").noconvert())
        .def(
            "set_springs",
            [](Run &run, GivenFacets facets, GivenTable<double, 9> stiffnesses,
               GivenColumn<Index> histories) {
                run.set_springs(as_span(facets), as_span(stiffnesses), as_span(histories));
            },
            nb::arg("facets").noconvert(), nb::arg("stiffnesses").noconvert(),
            nb::arg("histories").noconvert())
        .def(
            "set_moving_supports",
            [](Run &run, Vectors values, GivenFacets histories) {
                run.set_moving_supports(as_span(values), as_span(histories));
            },
            nb::arg("values").noconvert(), nb::arg("histories").noconvert())
        .def(
            "set_sliding_supports",
            [](Run &run, GivenColumn<Index> points, GivenTable<double, 6> directions,
               GivenTable<double, 2> values, GivenTable<Index, 2> histories) {
                run.set_sliding_supports(as_span(points), as_span(directions), as_span(values),
                                         as_span(histories));
            },
            nb::arg("points").noconvert(), nb::arg("directions").noconvert(),
            nb::arg("values").noconvert(), nb::arg("histories").noconvert())
        .def("set_mass_damping", &Run::set_mass_damping, nb::arg("mass_damping"))
        .def(
            "add_tool",
            [](Run &run, const ToolShape &shape, bool is_constraint, double friction, double reach,
               double deepest, const Point &direction, double mass, GivenPoints points,
               GivenColumn<Index> vertices, GivenColumn<double> stiffnesses) {
                run.add_tool({shape, is_constraint, friction, reach, deepest, direction, mass},
                             as_span(points), as_span(vertices), as_span(stiffnesses));
            },
            nb::arg("shape"), nb::kw_only(), nb::arg("is_constraint"), nb::arg("friction"),
            nb::arg("reach"), nb::arg("deepest"), nb::arg("direction"), nb::arg("mass"),
            nb::arg("points").noconvert(), nb::arg("vertices").noconvert(),
            nb::arg("stiffnesses").noconvert())
        .def(
            "add_tool_over_facets",
            [](Run &run, const ToolShape &shape, double reach, double deepest,
               const Point &direction, double mass, GivenPoints points, GivenFacets facets,
               GivenColumn<double> stiffnesses) {
                run.add_tool_over_facets({shape, false, 0.0, reach, deepest, direction, mass},
                                         as_span(points), as_span(facets), as_span(stiffnesses));
            },
            nb::arg("shape"), nb::kw_only(), nb::arg("reach"), nb::arg("deepest"),
            nb::arg("direction"), nb::arg("mass"), nb::arg("points").noconvert(),
            nb::arg("facets").noconvert(), nb::arg("stiffnesses").noconvert())
        .def(
            "add_constraint_over_facets",
            [](Run &run, const ToolShape &shape, double friction, double reach, double deepest,
               GivenPoints points, GivenFacets facets, GivenColumn<double> facet_areas,
               GivenFacets constraints, GivenColumn<double> areas) {
                run.add_constraint_over_facets(
                    {shape, true, friction, reach, deepest, {}, 0.0}, as_span(points),
                    as_span(facets), as_span(facet_areas), as_span(constraints), as_span(areas));
            },
            nb::arg("shape"), nb::kw_only(), nb::arg("friction"), nb::arg("reach"),
            nb::arg("deepest"), nb::arg("points").noconvert(), nb::arg("facets").noconvert(),
            nb::arg("facet_areas").noconvert(), nb::arg("constraints").noconvert(),
            nb::arg("areas").noconvert())
        .def(
            "set_self_contact",
            [](Run &run, GivenPoints points, GivenCells cells, GivenColumn<Index> vertices,
               GivenFacets facets, GivenColumn<Index> parts, GivenColumn<double> stiffnesses,
               InstructionSet at_most) {
                run.set_self_contact(std::make_unique<BodyTouch>(
                                         as_rows<Position>(points), as_rows<BodyTouch::Cell>(cells),
                                         as_span(vertices), as_rows<BodyTouch::Facet>(facets),
                                         as_span(parts), as_span(stiffnesses), at_most),
                                     as_span(points));
            },
            nb::arg("points").noconvert(), nb::arg("cells").noconvert(),
            nb::arg("vertices").noconvert(), nb::arg("facets").noconvert(),
            nb::arg("parts").noconvert(), nb::arg("stiffnesses").noconvert(), nb::arg("at_most"))
        .def(
            "advance",
            [](Run &run, Rows factors, Rows tools) {
                return carry_out(run, factors, tools, &Run::advance);
            },
            nb::arg("factors").noconvert(), nb::arg("tools").noconvert())
        .def(
            "look",
            [](Run &run, Rows factors, Rows tools) {
                return carry_out(run, factors, tools, &Run::look);
            },
            nb::arg("factors").noconvert(), nb::arg("tools").noconvert())
        .def("energies",
             [](const Run &run) {
                 const EnergyRecord record = run.energies();
                 return std::make_tuple(record.kinetic, record.external_work, record.damping_loss);
             })
        .def("take_tool_records",
             [](Run &run) {
                 const std::vector<ToolRecord> records = run.take_tool_records();
                 auto rows =
                     new_array<double>({records.size(), sizeof(ToolRecord) / sizeof(double)});
                 std::copy(records.begin(), records.end(),
                           reinterpret_cast<ToolRecord *>(rows.data()));
                 return rows;
             })
        .def(
            "get_contact_force",
            [](const Run &run, OwnVectors force) { run.get_contact_force(as_span(force)); },
            nb::arg("force").noconvert())
        .def(
            "get_net_force",
            [](const Run &run, OwnVectors force) { run.get_net_force(as_span(force)); },
            nb::arg("force").noconvert())
        .def("self_overlap", &Run::self_overlap)
        .def(
            "internal_force",
            [](Run &run, OwnVectors force) { run.internal_force(as_span(force)); },
            nb::arg("force").noconvert())
        .def_prop_ro("instruction_set", &Run::instruction_set);
}
