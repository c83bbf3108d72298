// Bindings of collision detection: no logic, no defaults. Python has checked the shapes; a point
// that is not finite is refused by the core.
#include "bind_arrays.hpp"
#include "collision/vertices_in_cells.hpp"

#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

using namespace fastsim;

using Index = std::int32_t;
using Cell = std::array<Index, 4>;
using Points = GivenPoints;
using Cells = GivenCells;
using Indices = GivenColumn<Index>;

namespace {

/// Runs without the interpreter's lock, then makes arrays of what was found.
template <typename Find> auto found_by(Find &&find) {
    using Found = decltype(find());
    Found pairs;
    {
        nb::gil_scoped_release release;
        pairs = find();
    }
    std::vector<std::array<Index, 2>> rows;
    std::vector<std::array<double, 4>> weights;
    for (const VertexInCell &pair : pairs) {
        rows.push_back({pair.vertex, pair.cell});
        weights.push_back(pair.weights);
    }
    return std::make_tuple(as_table(rows), as_table(weights));
}

} // namespace

void bind_collision(nb::module_ &module);

void bind_collision(nb::module_ &module) {
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
            return found_by([&] {
                return find_vertices_in_cells_brute_force(
                    as_rows<Position>(vertex_points), as_span(vertices),
                    as_rows<Position>(cell_points), as_rows<Cell>(cells), is_same_body);
            });
        },
        nb::arg("vertex_points").noconvert(), nb::arg("vertices").noconvert(),
        nb::arg("cell_points").noconvert(), nb::arg("cells").noconvert(), nb::arg("is_same_body"));
}
