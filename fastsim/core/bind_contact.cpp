// Bindings of the shapes and paths of rigid tools: no logic, no defaults. Python has checked every
// array.
#include "bind_arrays.hpp"
#include "contact/tool_path.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <tuple>
#include <vector>

using namespace fastsim;

void bind_contact(nb::module_ &module);

void bind_contact(nb::module_ &module) {
    nb::class_<ToolShape>(module, "ToolShape")
        .def_static(
            "sphere", [](double radius) { return ToolShape{Sphere{radius}}; }, nb::arg("radius"))
        .def_static(
            "capsule",
            [](double radius, double half_length) {
                return ToolShape{Capsule{radius, half_length}};
            },
            nb::arg("radius"), nb::arg("half_length"))
        .def_static(
            "box", [](double x, double y, double z) { return ToolShape{SharpBox{{x, y, z}}}; },
            nb::arg("x"), nb::arg("y"), nb::arg("z"))
        .def_static("half_space", [] { return ToolShape{HalfSpace{}}; })
        .def_static(
            "surface",
            [](GivenPoints points, GivenFacets facets) {
                const auto point_rows = as_rows<Point>(points);
                const auto facet_rows = as_rows<ClosedSurface::Facet>(facets);
                return ToolShape{std::make_shared<const ClosedSurface>(
                    std::vector<Point>{point_rows.begin(), point_rows.end()},
                    std::vector<ClosedSurface::Facet>{facet_rows.begin(), facet_rows.end()})};
            },
            nb::arg("points").noconvert(), nb::arg("facets").noconvert())
        .def(
            "gaps",
            [](const ToolShape &shape, GivenPoints places, GivenTable<double, 12> pose_row) {
                const auto rows = as_rows<Point>(places);
                const Pose &pose = as_rows<Pose>(pose_row)[0];
                std::vector<double> distances(rows.size()), curvatures(rows.size());
                std::vector<Point> normals(rows.size()), axes(rows.size());
                {
                    nb::gil_scoped_release release;
                    for (std::size_t k = 0; k < rows.size(); ++k) {
                        const Gap gap = gap_at(shape, pose, rows[k]);
                        distances[k] = gap.distance;
                        normals[k] = gap.normal;
                        curvatures[k] = gap.curvature;
                        axes[k] = gap.axis;
                    }
                }
                return std::make_tuple(as_column<double>(distances), as_table(normals),
                                       as_column<double>(curvatures), as_table(axes));
            },
            nb::arg("places").noconvert(), nb::arg("pose").noconvert());

    nb::class_<ToolPath>(module, "ToolPath")
        .def(
            "__init__",
            [](ToolPath *self, GivenColumn<double> times, GivenPoints positions,
               GivenTable<double, 4> rotations) {
                new (self) ToolPath(as_span(times), as_rows<Point>(positions),
                                    as_rows<Quaternion>(rotations));
            },
            nb::arg("times").noconvert(), nb::arg("positions").noconvert(),
            nb::arg("rotations").noconvert())
        .def("way_to", &ToolPath::way_to, nb::arg("position"), nb::arg("rotation").none(),
             nb::arg("begin"), nb::arg("end"))
        .def("fastest_point", &ToolPath::fastest_point, nb::arg("reach"))
        .def(
            "poses_at",
            [](const ToolPath &path, GivenColumn<double> times) {
                auto rows = new_array<double>({times.size(), sizeof(Pose) / sizeof(double)});
                for (std::size_t k = 0; k < times.size(); ++k)
                    reinterpret_cast<Pose *>(rows.data())[k] = path.pose_at(times.data()[k]);
                return rows;
            },
            nb::arg("times").noconvert());
}
