// Bindings of the surface's algorithms: no logic, no defaults. Python has checked every array.
#include "bind_arrays.hpp"
#include "surface/closest_point.hpp"
#include "surface/remesh.hpp"
#include "surface/wrap.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/function.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

using namespace fastsim;

using Points = GivenPoints;
using Facets = GivenFacets;

void bind_surface(nb::module_ &module);

void bind_surface(nb::module_ &module) {
    nb::class_<SurfaceDistance>(module, "SurfaceDistance")
        .def(
            "__init__",
            [](SurfaceDistance *self, Points points, Facets facets) {
                const auto point_rows = as_rows<Point>(points);
                const auto facet_rows = as_rows<EditableSurface::Facet>(facets);
                new (self) SurfaceDistance({point_rows.begin(), point_rows.end()},
                                           {facet_rows.begin(), facet_rows.end()});
            },
            nb::arg("points").noconvert(), nb::arg("facets").noconvert())
        .def(
            "distances",
            [](const SurfaceDistance &self, Points places) {
                auto found = new_array<double>({places.shape(0)});
                nb::gil_scoped_release release;
                std::ranges::transform(as_rows<Point>(places), found.data(),
                                       [&](const Point &place) {
                                           return std::sqrt(self.closest(place).distance_squared);
                                       });
                return found;
            },
            nb::arg("places").noconvert())
        .def(
            "farthest",
            [](const SurfaceDistance &self, Points points, Facets facets, double accuracy) {
                auto found = new_array<double>({facets.shape(0)});
                nb::gil_scoped_release release;
                const auto rows = as_rows<Point>(points);
                std::ranges::transform(as_rows<EditableSurface::Facet>(facets), found.data(),
                                       [&](const EditableSurface::Facet &f) {
                                           return self.farthest(
                                               {rows[static_cast<std::size_t>(f[0])],
                                                rows[static_cast<std::size_t>(f[1])],
                                                rows[static_cast<std::size_t>(f[2])]},
                                               accuracy);
                                       });
                return found;
            },
            nb::arg("points").noconvert(), nb::arg("facets").noconvert(), nb::arg("accuracy"));

    nb::class_<SizeGrid>(module, "SizeGrid")
        .def(nb::init<double>(), nb::arg("edge_length"))
        .def(
            "__init__",
            [](SizeGrid *self, const Point &low, double edge, const std::array<Index, 3> &count,
               GivenCells leaves, GivenColumn<double> sizes) {
                new (self) SizeGrid(low, edge, count, as_rows<SizeGrid::Leaf>(leaves),
                                    {sizes.data(), sizes.shape(0)});
            },
            nb::arg("low"), nb::arg("edge"), nb::arg("count"), nb::arg("leaves").noconvert(),
            nb::arg("sizes").noconvert())
        .def(
            "at",
            [](const SizeGrid &self, Points places) {
                std::vector<double> found;
                for (const Point &place : as_rows<Point>(places))
                    found.push_back(self.at(place));
                return as_column<double>(found);
            },
            nb::arg("places").noconvert());

    nb::class_<RemeshedSurface>(module, "RemeshedSurface")
        .def_prop_ro(
            "points", [](const RemeshedSurface &made) { return as_table(made.points); },
            nb::rv_policy::move)
        .def_prop_ro(
            "facets", [](const RemeshedSurface &made) { return as_table(made.facets); },
            nb::rv_policy::move)
        .def_ro("splits", &RemeshedSurface::splits)
        .def_ro("collapses", &RemeshedSurface::collapses)
        .def_ro("flips", &RemeshedSurface::flips)
        .def_ro("moves", &RemeshedSurface::moves);

    module.def(
        "remesh_surface",
        [](Points points, Facets facets, const SizeGrid &sizes, double distance, int passes,
           const std::function<void(double)> &tell) {
            const auto point_rows = as_rows<Point>(points);
            const auto facet_rows = as_rows<EditableSurface::Facet>(facets);
            const auto watch = [&](double done) {
                const nb::gil_scoped_acquire acquire;
                if (PyErr_CheckSignals() != 0)
                    throw nb::python_error();
                tell(done);
            };
            nb::gil_scoped_release release;
            return remesh_surface(point_rows, facet_rows, {sizes, distance, passes}, watch);
        },
        nb::arg("points").noconvert(), nb::arg("facets").noconvert(), nb::arg("sizes"),
        nb::arg("distance"), nb::arg("passes"), nb::arg("tell"));

    nb::class_<WrappedSurface>(module, "WrappedSurface")
        .def_prop_ro(
            "points", [](const WrappedSurface &made) { return as_table(made.points); },
            nb::rv_policy::move)
        .def_prop_ro(
            "facets", [](const WrappedSurface &made) { return as_table(made.facets); },
            nb::rv_policy::move)
        .def_ro("is_too_fine", &WrappedSurface::is_too_fine);

    module.def(
        "wrap_surface",
        [](Points points, Facets facets, double spacing, std::size_t most_cubes,
           const std::function<void(std::size_t)> &tell) {
            const auto point_rows = as_rows<Point>(points);
            const auto facet_rows = as_rows<EditableSurface::Facet>(facets);
            const auto watch = [&](std::size_t cubes) {
                const nb::gil_scoped_acquire acquire;
                if (PyErr_CheckSignals() != 0)
                    throw nb::python_error();
                tell(cubes);
            };
            nb::gil_scoped_release release;
            return wrap_surface(point_rows, facet_rows, spacing, most_cubes, watch);
        },
        nb::arg("points").noconvert(), nb::arg("facets").noconvert(), nb::arg("spacing"),
        nb::arg("most_cubes"), nb::arg("tell"));
}
