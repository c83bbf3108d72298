// Bindings of local refinement: no logic, no defaults. Python has checked every array.
#include "bind_arrays.hpp"
#include "grading/bisected_mesh.hpp"
#include "grading/symbolic_cube.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

using namespace fastsim;

using Index = BisectedMesh::Index;
using Points = GivenPoints;
using Cells = GivenCells;
using Marks = GivenColumn<std::uint8_t>;

void bind_grading(nb::module_ &module);

void bind_grading(nb::module_ &module) {
    nb::class_<BisectedMesh>(module, "BisectedMesh")
        .def(
            "__init__",
            [](BisectedMesh *self, Points points, Cells cells, Cells facet_tags) {
                new (self) BisectedMesh(as_rows<BisectedMesh::Point>(points),
                                        as_rows<BisectedMesh::Cell>(cells),
                                        as_rows<BisectedMesh::Cell>(facet_tags));
            },
            nb::arg("points").noconvert(), nb::arg("cells").noconvert(),
            nb::arg("facet_tags").noconvert())
        .def(
            "refine",
            [](BisectedMesh &self, Marks marked) {
                nb::gil_scoped_release release;
                self.refine({marked.data(), marked.shape(0)});
            },
            nb::arg("marked").noconvert())
        .def("leaves",
             [](const BisectedMesh &self) {
                 BisectedMesh::Leaves leaves;
                 {
                     nb::gil_scoped_release release;
                     leaves = self.leaves();
                 }
                 return std::make_tuple(
                     as_table<Index, 4>(leaves.cells), as_table<Index, 4>(leaves.facet_tags),
                     as_column<Index>(leaves.given_cell), as_column<Index>(leaves.generation));
             })
        .def("points", [](const BisectedMesh &self) { return as_table<double, 3>(self.points()); })
        .def("point_parents",
             [](const BisectedMesh &self) { return as_table<Index, 2>(self.point_parents()); });

    nb::class_<CellName>(module, "CellName")
        .def_ro("generation", &CellName::generation)
        .def_ro("corner", &CellName::corner)
        .def_ro("axis", &CellName::axis)
        .def("corners", &CellName::corners)
        .def("children", &CellName::children)
        .def("parent", &CellName::parent)
        .def("neighbour", &CellName::neighbour, nb::arg("k"))
        .def("is_inside", &CellName::is_inside)
        .def("code", &CellName::code);
    nb::class_<SymbolicCube>(module, "SymbolicCube")
        .def(nb::init<>())
        .def(
            "refine",
            [](SymbolicCube &self, Marks marked) {
                nb::gil_scoped_release release;
                return self.refine({marked.data(), marked.shape(0)});
            },
            nb::arg("marked").noconvert())
        .def("cells", &SymbolicCube::cells)
        .def("num_cells", &SymbolicCube::num_cells)
        .def("corners", [](const SymbolicCube &self) {
            std::vector<std::array<Index, 12>> rows;
            {
                nb::gil_scoped_release release;
                for (const CellName &cell : self.cells()) {
                    std::array<Index, 12> row;
                    const auto corners = cell.corners();
                    for (std::size_t k = 0; k < 12; ++k)
                        row[k] = corners[k / 3][k % 3];
                    rows.push_back(row);
                }
            }
            return as_table<Index, 12>(rows);
        });
}
