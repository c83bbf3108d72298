// Bindings of the mesher: no logic, no defaults. Python has checked every array.
#include "bind_arrays.hpp"
#include "delaunay/triangulation.hpp"
#include "mesher/boundary_facets.hpp"
#include "mesher/mesh_surface.hpp"
#include "predicates/predicates.hpp"
#include "slivers/star.hpp"
#include "surface/plain_shell.hpp"
#include "surface/self_intersection.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/function.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <functional>
#include <string>
#include <tuple>

using namespace fastsim;

using Points = GivenPoints;
using Cells = GivenCells;
using Facets = GivenFacets;

void bind_mesher(nb::module_ &module);

void bind_mesher(nb::module_ &module) {
    nb::enum_<Lattice>(module, "Lattice")
        .value("cubic", Lattice::cubic)
        .value("body_centred", Lattice::body_centred);

    module.def("orient3d", &orient3d, nb::arg("a"), nb::arg("b"), nb::arg("c"), nb::arg("d"));
    module.def("in_sphere", &in_sphere, nb::arg("a"), nb::arg("b"), nb::arg("c"), nb::arg("d"),
               nb::arg("e"));

    module.def(
        "delaunay",
        [](Points points) {
            const std::span<const Point> rows(reinterpret_cast<const Point *>(points.data()),
                                              points.shape(0));
            DelaunayCells result;
            {
                nb::gil_scoped_release release;
                Watch nobody;
                result = Triangulation(rows).build(nobody);
            }
            return std::make_tuple(as_table<Index, 4>(result.cells), result.duplicates,
                                   result.is_flat);
        },
        nb::arg("points").noconvert());

    module.def(
        "rate_star",
        [](Points points, Facets facets, const Point &place, double altitude) {
            const auto rows = as_rows<Point>(points);
            Star star;
            star.clear(1.0, altitude);
            for (const Triple &f : as_rows<Triple>(facets))
                star.add(rows[TetComplex::at(f[0])], rows[TetComplex::at(f[1])],
                         rows[TetComplex::at(f[2])]);
            std::vector<double> qualities;
            star.list_qualities(place, qualities);
            return std::make_tuple(qualities, star.worst(place, -1.0));
        },
        nb::arg("points").noconvert(), nb::arg("facets").noconvert(), nb::arg("place"),
        nb::arg("altitude"));

    module.def(
        "find_boundary_facets",
        [](Cells cells, std::size_t num_points) {
            const auto rows = as_rows<Cell>(cells);
            std::vector<Triple> facets;
            {
                nb::gil_scoped_release release;
                facets = find_boundary_facets(rows, num_points);
            }
            return as_table<Index, 3>(facets);
        },
        nb::arg("cells").noconvert(), nb::arg("num_points"));

    module.def(
        "is_boundary",
        [](Facets facets, Cells cells) {
            const auto facet_rows = as_rows<Triple>(facets);
            const auto cell_rows = as_rows<Cell>(cells);
            nb::gil_scoped_release release;
            return is_boundary(facet_rows, cell_rows);
        },
        nb::arg("facets").noconvert(), nb::arg("cells").noconvert());

    module.def(
        "is_plain_shell",
        [](Points points, Facets facets) {
            const auto point_rows = as_rows<Point>(points);
            const auto facet_rows = as_rows<Triple>(facets);
            nb::gil_scoped_release release;
            return is_plain_shell(point_rows, facet_rows);
        },
        nb::arg("points").noconvert(), nb::arg("facets").noconvert());

    module.def(
        "find_self_intersections",
        [](Points points, Facets facets, std::size_t most) {
            const auto point_rows = as_rows<Point>(points);
            const auto facet_rows = as_rows<Triple>(facets);
            std::vector<std::array<Index, 2>> pairs;
            {
                nb::gil_scoped_release release;
                pairs = find_self_intersections(point_rows, facet_rows, most);
            }
            return as_table<Index, 2>(pairs);
        },
        nb::arg("points").noconvert(), nb::arg("facets").noconvert(), nb::arg("most"));

    using Mesh = SurfaceMesh;
    nb::class_<Mesh>(module, "SurfaceMesh")
        .def_prop_ro("points",
                     [](const Mesh &mesh) { return as_view(mesh.points, nb::find(mesh)); })
        .def_prop_ro("cells", [](const Mesh &mesh) { return as_view(mesh.cells, nb::find(mesh)); })
        .def_prop_ro("missing_edges", [](const Mesh &mesh) { return mesh.recovery.missing_edges; })
        .def_prop_ro("missing_facets",
                     [](const Mesh &mesh) { return mesh.recovery.missing_facets; })
        .def_ro("equal_points", &Mesh::equal_points)
        .def_prop_ro("recovered_edges",
                     [](const Mesh &mesh) { return mesh.recovery.recovered_edges; })
        .def_prop_ro("recovered_facets",
                     [](const Mesh &mesh) { return mesh.recovery.recovered_facets; })
        .def_prop_ro("sliver_flips", [](const Mesh &mesh) { return mesh.slivers.flips; })
        .def_prop_ro("sliver_moves", [](const Mesh &mesh) { return mesh.slivers.moves; })
        .def_prop_ro("sliver_work", [](const Mesh &mesh) { return mesh.slivers.work; })
        .def_prop_ro("slivers_left", [](const Mesh &mesh) { return mesh.slivers.left; })
        .def_prop_ro("is_cut_short", [](const Mesh &mesh) { return mesh.slivers.is_cut_short; })
        .def_ro("stopped_in", &Mesh::stopped_in)
        .def_prop_ro("sliver_insertions", [](const Mesh &mesh) { return mesh.slivers.insertions; })
        .def_prop_ro("steiner_points",
                     [](const Mesh &mesh) { return mesh.recovery.steiner_points.size(); })
        .def_ro("boundary_steiner_points", &Mesh::num_boundary_steiner);

    module.def(
        "mesh_surface",
        [](Points points, Facets facets, Lattice lattice, double edge_length, double jitter,
           double clearance, std::uint64_t seed, bool grows_inwards, double sliver_target,
           int sliver_passes, double least_altitude, std::size_t least_work, double work_per_cell,
           bool lengthens_step, const SizeGrid &sizes, double seconds,
           const std::function<void(std::string, std::size_t, double)> &tell) {
            const auto point_rows = as_rows<Point>(points);
            const auto facet_rows = as_rows<Triple>(facets);
            Watch watch(seconds, [&](const std::string &stage, std::size_t amount, double done) {
                const nb::gil_scoped_acquire acquire;
                // Python's own wish to stop, by Ctrl-C.
                if (PyErr_CheckSignals() != 0)
                    throw nb::python_error();
                if (amount > 0 || done > 0.0)
                    tell(stage, amount, done);
            });
            nb::gil_scoped_release release;
            return mesh_surface(point_rows, facet_rows,
                                {{lattice, edge_length, jitter, clearance, seed, grows_inwards},
                                 sliver_target,
                                 sliver_passes,
                                 least_altitude,
                                 {least_work, work_per_cell},
                                 lengthens_step},
                                sizes, watch);
        },
        nb::arg("points").noconvert(), nb::arg("facets").noconvert(), nb::arg("lattice"),
        nb::arg("edge_length"), nb::arg("jitter"), nb::arg("clearance"), nb::arg("seed"),
        nb::arg("grows_inwards"), nb::arg("sliver_target"), nb::arg("sliver_passes"),
        nb::arg("least_altitude"), nb::arg("least_work"), nb::arg("work_per_cell"),
        nb::arg("lengthens_step"), nb::arg("sizes"), nb::arg("seconds"), nb::arg("tell"));
}
