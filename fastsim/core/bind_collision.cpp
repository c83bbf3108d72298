// Bindings of collision detection: no logic, no defaults. Python has checked the shapes; a point
// that is not finite is refused by the core.
#include "bind_arrays.hpp"
#include "collision/edges_near_edges.hpp"
#include "collision/vertices_in_cells.hpp"
#include "collision/vertices_near_facets.hpp"

#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

using namespace fastsim;

using Index = std::int32_t;
using Cell = std::array<Index, 4>;
using Facet = std::array<Index, 3>;
using Edge = std::array<Index, 2>;
using Points = GivenPoints;
using Cells = GivenCells;
using Facets = GivenFacets;
using Edges = GivenTable<Index, 2>;
using Indices = GivenColumn<Index>;

namespace {

std::span<const Index> as_span(const Indices &column) { return {column.data(), column.shape(0)}; }

auto as_arrays(std::span<const VertexInCell> pairs) {
    std::vector<std::array<Index, 2>> rows;
    std::vector<std::array<double, 4>> weights;
    for (const VertexInCell &pair : pairs) {
        rows.push_back({pair.vertex, pair.cell});
        weights.push_back(pair.weights);
    }
    return std::make_tuple(as_table(rows), as_table(weights));
}

auto as_arrays(std::span<const VertexNearFacet> pairs) {
    std::vector<std::array<Index, 2>> rows;
    std::vector<std::array<double, 3>> weights;
    std::vector<double> squared;
    for (const VertexNearFacet &pair : pairs) {
        rows.push_back({pair.vertex, pair.facet});
        weights.push_back(pair.weights);
        squared.push_back(pair.distance_squared);
    }
    return std::make_tuple(as_table(rows), as_table(weights),
                           as_column(std::span<const double>(squared)));
}

auto as_arrays(std::span<const EdgeNearEdge> pairs) {
    std::vector<std::array<Index, 2>> rows;
    std::vector<std::array<double, 2>> parameters;
    std::vector<double> squared;
    for (const EdgeNearEdge &pair : pairs) {
        rows.push_back({pair.first, pair.second});
        parameters.push_back(pair.parameters);
        squared.push_back(pair.distance_squared);
    }
    return std::make_tuple(as_table(rows), as_table(parameters),
                           as_column(std::span<const double>(squared)));
}

/// Runs without the interpreter's lock, then makes arrays of what was found.
template <typename Find> auto found_by(Find &&find) {
    using Found = decltype(find());
    Found pairs;
    {
        nb::gil_scoped_release release;
        pairs = find();
    }
    if constexpr (requires { as_arrays(pairs); })
        return as_arrays(pairs);
    else
        return as_table(pairs);
}

void bind_vertices_in_cells(nb::module_ &module) {
    nb::class_<VerticesInCells>(module, "VerticesInCells")
        .def(
            "__init__",
            [](VerticesInCells *self, Points cell_points, Cells cells, Indices vertices,
               bool is_same_body, std::size_t num_threads, InstructionSet at_most) {
                new (self) VerticesInCells(as_rows<Position>(cell_points), as_rows<Cell>(cells),
                                           as_span(vertices), is_same_body, num_threads, at_most);
            },
            nb::arg("cell_points").noconvert(), nb::arg("cells").noconvert(),
            nb::arg("vertices").noconvert(), nb::arg("is_same_body"), nb::arg("num_threads"),
            nb::arg("at_most"))
        .def(
            "find",
            [](VerticesInCells &self, Points vertex_points, Points cell_points) {
                return found_by([&] {
                    return self.find(as_rows<Position>(vertex_points),
                                     as_rows<Position>(cell_points));
                });
            },
            nb::arg("vertex_points").noconvert(), nb::arg("cell_points").noconvert())
        .def("work",
             [](const VerticesInCells &self) {
                 return std::make_tuple(self.work().hashed, self.work().cells_near,
                                        self.work().pairs_tested);
             })
        .def("voxel_sizes", &VerticesInCells::voxel_sizes);

    module.def(
        "find_vertices_in_cells_brute_force",
        [](Points vertex_points, Indices vertices, Points cell_points, Cells cells,
           bool is_same_body) {
            const auto pairs = [&] {
                nb::gil_scoped_release release;
                return find_vertices_in_cells_brute_force(
                    as_rows<Position>(vertex_points), as_span(vertices),
                    as_rows<Position>(cell_points), as_rows<Cell>(cells), is_same_body);
            }();
            return as_arrays(std::span<const VertexInCell>(pairs));
        },
        nb::arg("vertex_points").noconvert(), nb::arg("vertices").noconvert(),
        nb::arg("cell_points").noconvert(), nb::arg("cells").noconvert(), nb::arg("is_same_body"));
}

void bind_vertices_near_facets(nb::module_ &module) {
    nb::class_<VerticesNearFacets>(module, "VerticesNearFacets")
        .def(
            "__init__",
            [](VerticesNearFacets *self, Points facet_points, Facets facets, Indices vertices,
               bool is_same_body, std::size_t num_threads, InstructionSet at_most) {
                new (self)
                    VerticesNearFacets(as_rows<Position>(facet_points), as_rows<Facet>(facets),
                                       as_span(vertices), is_same_body, num_threads, at_most);
            },
            nb::arg("facet_points").noconvert(), nb::arg("facets").noconvert(),
            nb::arg("vertices").noconvert(), nb::arg("is_same_body"), nb::arg("num_threads"),
            nb::arg("at_most"))
        .def(
            "find",
            [](VerticesNearFacets &self, Points vertex_points, Points facet_points,
               double distance) {
                return found_by([&] {
                    return self.find(as_rows<Position>(vertex_points),
                                     as_rows<Position>(facet_points), distance);
                });
            },
            nb::arg("vertex_points").noconvert(), nb::arg("facet_points").noconvert(),
            nb::arg("distance"))
        .def(
            "find_candidates",
            [](VerticesNearFacets &self, Points vertex_points, Points facet_points,
               double distance) {
                return found_by([&] {
                    return self.find_candidates(as_rows<Position>(vertex_points),
                                                as_rows<Position>(facet_points), distance);
                });
            },
            nb::arg("vertex_points").noconvert(), nb::arg("facet_points").noconvert(),
            nb::arg("distance"))
        .def("voxel_sizes", &VerticesNearFacets::voxel_sizes);

    module.def(
        "find_vertices_near_facets_brute_force",
        [](Points vertex_points, Indices vertices, Points facet_points, Facets facets,
           double distance, bool is_same_body, bool only_candidates) {
            const auto pairs = [&] {
                nb::gil_scoped_release release;
                return find_vertices_near_facets_brute_force(
                    as_rows<Position>(vertex_points), as_span(vertices),
                    as_rows<Position>(facet_points), as_rows<Facet>(facets), distance, is_same_body,
                    only_candidates);
            }();
            return as_arrays(std::span<const VertexNearFacet>(pairs));
        },
        nb::arg("vertex_points").noconvert(), nb::arg("vertices").noconvert(),
        nb::arg("facet_points").noconvert(), nb::arg("facets").noconvert(), nb::arg("distance"),
        nb::arg("is_same_body"), nb::arg("only_candidates"));
}

void bind_edges_near_edges(nb::module_ &module) {
    nb::class_<EdgesNearEdges>(module, "EdgesNearEdges")
        .def(
            "__init__",
            [](EdgesNearEdges *self, Points first_points, Edges first, Points second_points,
               Edges second, bool is_same_body, std::size_t num_threads, InstructionSet at_most) {
                new (self) EdgesNearEdges(as_rows<Position>(first_points), as_rows<Edge>(first),
                                          as_rows<Position>(second_points), as_rows<Edge>(second),
                                          is_same_body, num_threads, at_most);
            },
            nb::arg("first_points").noconvert(), nb::arg("first").noconvert(),
            nb::arg("second_points").noconvert(), nb::arg("second").noconvert(),
            nb::arg("is_same_body"), nb::arg("num_threads"), nb::arg("at_most"))
        .def(
            "find",
            [](EdgesNearEdges &self, Points first_points, Points second_points, double distance) {
                return found_by([&] {
                    return self.find(as_rows<Position>(first_points),
                                     as_rows<Position>(second_points), distance);
                });
            },
            nb::arg("first_points").noconvert(), nb::arg("second_points").noconvert(),
            nb::arg("distance"))
        .def(
            "find_candidates",
            [](EdgesNearEdges &self, Points first_points, Points second_points, double distance) {
                return found_by([&] {
                    return self.find_candidates(as_rows<Position>(first_points),
                                                as_rows<Position>(second_points), distance);
                });
            },
            nb::arg("first_points").noconvert(), nb::arg("second_points").noconvert(),
            nb::arg("distance"));

    module.def(
        "find_edges_near_edges_brute_force",
        [](Points first_points, Edges first, Points second_points, Edges second, double distance,
           bool is_same_body, bool only_candidates) {
            const auto pairs = [&] {
                nb::gil_scoped_release release;
                return find_edges_near_edges_brute_force(
                    as_rows<Position>(first_points), as_rows<Edge>(first),
                    as_rows<Position>(second_points), as_rows<Edge>(second), distance, is_same_body,
                    only_candidates);
            }();
            return as_arrays(std::span<const EdgeNearEdge>(pairs));
        },
        nb::arg("first_points").noconvert(), nb::arg("first").noconvert(),
        nb::arg("second_points").noconvert(), nb::arg("second").noconvert(), nb::arg("distance"),
        nb::arg("is_same_body"), nb::arg("only_candidates"));
}

} // namespace

void bind_collision(nb::module_ &module);

void bind_collision(nb::module_ &module) {
    bind_vertices_in_cells(module);
    bind_vertices_near_facets(module);
    bind_edges_near_edges(module);
}
