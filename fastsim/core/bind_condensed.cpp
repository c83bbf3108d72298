// Bindings of the condensed model: no logic, no defaults. Python has checked every array.
#include "bind_arrays.hpp"
#include "condensed/condensed_contact.hpp"

#include <nanobind/stl/vector.h>

#include <numeric>
#include <utility>
#include <vector>

using namespace fastsim;

void bind_condensed(nb::module_ &module);

namespace {

template <typename Real>
Compliance of(const GivenTable<Real, 9> &blocks, std::size_t num_touched,
              std::size_t num_only_seen) {
    return {std::span<const Real>(blocks.data(), blocks.size()), num_only_seen, num_touched};
}

template <typename Number> std::vector<Number> in_vector(const GivenColumn<Number> &column) {
    return {column.data(), column.data() + column.size()};
}

template <typename Real> void def_init(nb::class_<Compliance> &type) {
    type.def(
        "__init__",
        [](Compliance *self, GivenTable<Real, 9> blocks, std::size_t num_touched,
           std::size_t num_only_seen) {
            new (self) Compliance(of<Real>(blocks, num_touched, num_only_seen));
        },
        nb::arg("blocks").noconvert(), nb::arg("num_touched"), nb::arg("num_only_seen"),
        nb::keep_alive<1, 2>());
}

} // namespace

void bind_condensed(nb::module_ &module) {
    nb::class_<Compliance> compliance(module, "Compliance");
    def_init<float>(compliance);
    def_init<double>(compliance);
    compliance.def(
        "response",
        [](const Compliance &self, GivenPoints forces) {
            auto out = new_array<double>({self.num_seen(), 3});
            const auto rows = as_rows<Point>(forces);
            const std::span<Point> seen{reinterpret_cast<Point *>(out.data()), self.num_seen()};
            nb::gil_scoped_release release;
            std::vector<std::int32_t> all(rows.size());
            std::iota(all.begin(), all.end(), 0);
            self.add_response(rows, all, seen);
            return out;
        },
        nb::arg("forces").noconvert());

    nb::class_<CondensedTool>(module, "CondensedTool")
        .def(
            "__init__",
            [](CondensedTool *self, const ToolShape &shape, double stiffness,
               GivenColumn<double> areas, GivenColumn<std::int32_t> centres, double spread,
               std::size_t num_corners, GivenColumn<std::int32_t> corners, GivenPoints rest,
               GivenColumn<std::int32_t> constraints, GivenColumn<double> shares,
               GivenColumn<double> shape_functions) {
                const auto rows = as_rows<Point>(rest);
                const auto num_points = shape_functions.size() / num_corners;
                const auto num_patches = corners.size() / num_corners;
                new (self) CondensedTool{shape,
                                         stiffness,
                                         in_vector(areas),
                                         in_vector(centres),
                                         spread,
                                         num_corners,
                                         num_points,
                                         num_patches == 0 ? 0 : constraints.size() / num_patches,
                                         in_vector(corners),
                                         {rows.begin(), rows.end()},
                                         in_vector(constraints),
                                         in_vector(shares),
                                         in_vector(shape_functions)};
            },
            nb::arg("shape"), nb::arg("stiffness"), nb::kw_only(), nb::arg("areas").noconvert(),
            nb::arg("centres").noconvert(), nb::arg("spread"), nb::arg("num_corners"),
            nb::arg("corners").noconvert(), nb::arg("rest").noconvert(),
            nb::arg("constraints").noconvert(), nb::arg("shares").noconvert(),
            nb::arg("shape_functions").noconvert());

    nb::class_<ContactOutcome>(module, "ContactOutcome")
        .def_ro("is_settled", &ContactOutcome::is_settled)
        .def_ro("iterations", &ContactOutcome::iterations)
        .def_ro("touching", &ContactOutcome::touching)
        .def_ro("error", &ContactOutcome::error);

    nb::class_<CondensedContact>(module, "CondensedContact")
        .def(
            "__init__",
            [](CondensedContact *self, const Compliance &model, GivenPoints places,
               std::vector<CondensedTool> tools, bool is_penalty, double reach) {
                const auto rows = as_rows<Point>(places);
                new (self) CondensedContact(model, {rows.begin(), rows.end()}, std::move(tools),
                                            is_penalty, reach);
            },
            nb::arg("compliance"), nb::arg("places").noconvert(), nb::arg("tools"),
            nb::arg("is_penalty"), nb::arg("reach"), nb::keep_alive<1, 2>())
        .def(
            "step",
            [](CondensedContact &self, GivenTable<double, 12> poses, GivenPoints base,
               double relative_tolerance, int max_iterations) {
                nb::gil_scoped_release release;
                return self.step(as_rows<Pose>(poses), as_rows<Point>(base), relative_tolerance,
                                 max_iterations);
            },
            nb::arg("poses").noconvert(), nb::arg("base").noconvert(),
            nb::arg("relative_tolerance"), nb::arg("max_iterations"))
        .def("clear", &CondensedContact::clear)
        .def("response", [](const CondensedContact &self) { return as_table(self.response()); })
        .def("forces", [](const CondensedContact &self) { return as_table(self.forces()); })
        .def("loads", [](const CondensedContact &self) {
            auto out = new_array<double>({self.loads().size(), 6});
            double *row = out.data();
            for (const ToolLoad &load : self.loads()) {
                row = std::copy(load.force.begin(), load.force.end(), row);
                row = std::copy(load.moment.begin(), load.moment.end(), row);
            }
            return out;
        });
}
