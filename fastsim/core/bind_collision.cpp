// Bindings of collision detection: no logic, no defaults. Python has checked every array.
#include "collision/vertices_in_cells.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

namespace nb = nanobind;
using namespace fastsim;

namespace {

using Index = std::int32_t;
using Cell = std::array<Index, 4>;
using Points =
    nb::ndarray<const double, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Cells = nb::ndarray<const Index, nb::numpy, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const Index, nb::numpy, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

template <typename Row, typename Array> std::span<const Row> as_rows(const Array &array) {
    return {reinterpret_cast<const Row *>(array.data()), array.shape(0)};
}

auto as_arrays(std::span<const VertexInCell> pairs) {
    auto *rows = new Index[2 * pairs.size()];
    nb::capsule own_rows(rows, [](void *p) noexcept { delete[] static_cast<Index *>(p); });
    auto *weights = new double[4 * pairs.size()];
    nb::capsule own_weights(weights, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    for (std::size_t k = 0; k < pairs.size(); ++k) {
        rows[2 * k] = pairs[k].vertex;
        rows[2 * k + 1] = pairs[k].cell;
        for (std::size_t i = 0; i < 4; ++i)
            weights[4 * k + i] = pairs[k].weights[i];
    }
    return std::make_tuple(
        nb::ndarray<nb::numpy, Index>(rows, {pairs.size(), std::size_t{2}}, own_rows),
        nb::ndarray<nb::numpy, double>(weights, {pairs.size(), std::size_t{4}}, own_weights));
}

} // namespace

void bind_collision(nb::module_ &module);

void bind_collision(nb::module_ &module) {
    nb::class_<VerticesInCells>(module, "VerticesInCells")
        .def(
            "__init__",
            [](VerticesInCells *self, Points cell_points, Cells cells, Indices vertices,
               bool is_same_body) {
                new (self) VerticesInCells(as_rows<Position>(cell_points), as_rows<Cell>(cells),
                                           {vertices.data(), vertices.shape(0)}, is_same_body);
            },
            nb::arg("cell_points").noconvert(), nb::arg("cells").noconvert(),
            nb::arg("vertices").noconvert(), nb::arg("is_same_body"))
        .def(
            "find",
            [](VerticesInCells &self, Points vertex_points, Points cell_points) {
                std::span<const VertexInCell> pairs;
                {
                    nb::gil_scoped_release release;
                    pairs =
                        self.find(as_rows<Position>(vertex_points), as_rows<Position>(cell_points));
                }
                return as_arrays(pairs);
            },
            nb::arg("vertex_points").noconvert(), nb::arg("cell_points").noconvert())
        .def("work",
             [](const VerticesInCells &self) {
                 return std::make_tuple(self.work().rehashed, self.work().cells_near,
                                        self.work().pairs_tested);
             })
        .def("voxel_sizes", &VerticesInCells::voxel_sizes);

    module.def(
        "find_vertices_in_cells_brute_force",
        [](Points vertex_points, Indices vertices, Points cell_points, Cells cells,
           bool is_same_body) {
            std::vector<VertexInCell> pairs;
            {
                nb::gil_scoped_release release;
                pairs = find_vertices_in_cells_brute_force(
                    as_rows<Position>(vertex_points), {vertices.data(), vertices.shape(0)},
                    as_rows<Position>(cell_points), as_rows<Cell>(cells), is_same_body);
            }
            return as_arrays(pairs);
        },
        nb::arg("vertex_points").noconvert(), nb::arg("vertices").noconvert(),
        nb::arg("cell_points").noconvert(), nb::arg("cells").noconvert(), nb::arg("is_same_body"));
}
