// Bindings of the surface's algorithms: no logic, no defaults. Python has checked every array.
#include "surface/closest_point.hpp"
#include "surface/remesh.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <tuple>

namespace nb = nanobind;
using namespace fastsim;

namespace {

using Points =
    nb::ndarray<const double, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Facets =
    nb::ndarray<const std::int32_t, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

template <typename T>
nb::ndarray<nb::numpy, T> as_table(const std::vector<std::array<T, 3>> &rows) {
    T *copy = new T[rows.size() * 3];
    std::memcpy(copy, rows.data(), rows.size() * 3 * sizeof(T));
    nb::capsule owner(copy, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(copy, {rows.size(), std::size_t{3}}, owner);
}

template <typename Row, typename Array> std::vector<Row> as_rows(const Array &array) {
    std::vector<Row> rows(array.shape(0));
    if (!rows.empty())
        std::memcpy(rows.data(), array.data(), rows.size() * sizeof(Row));
    return rows;
}

} // namespace

void bind_surface(nb::module_ &module);

void bind_surface(nb::module_ &module) {
    nb::class_<SurfaceDistance>(module, "SurfaceDistance")
        .def(
            "__init__",
            [](SurfaceDistance *self, Points points, Facets facets) {
                new (self) SurfaceDistance(as_rows<Point>(points),
                                           as_rows<EditableSurface::Facet>(facets));
            },
            nb::arg("points").noconvert(), nb::arg("facets").noconvert())
        .def(
            "closest",
            [](const SurfaceDistance &self, Points places) {
                const auto rows = as_rows<Point>(places);
                std::vector<Point> found(rows.size());
                auto *distance = new double[rows.size()];
                nb::capsule own_distance(
                    distance, [](void *p) noexcept { delete[] static_cast<double *>(p); });
                auto *facet = new std::int32_t[rows.size()];
                nb::capsule own_facet(
                    facet, [](void *p) noexcept { delete[] static_cast<std::int32_t *>(p); });
                {
                    nb::gil_scoped_release release;
                    for (std::size_t k = 0; k < rows.size(); ++k) {
                        const ClosestPoint closest = self.closest(rows[k]);
                        found[k] = closest.point;
                        distance[k] = std::sqrt(closest.distance_squared);
                        facet[k] = closest.facet;
                    }
                }
                return std::make_tuple(
                    as_table(found),
                    nb::ndarray<nb::numpy, double>(distance, {rows.size()}, own_distance),
                    nb::ndarray<nb::numpy, std::int32_t>(facet, {rows.size()}, own_facet));
            },
            nb::arg("places").noconvert());

    module.def(
        "remesh_surface",
        [](Points points, Facets facets, double edge_length, double distance, int passes) {
            const auto point_rows = as_rows<Point>(points);
            const auto facet_rows = as_rows<EditableSurface::Facet>(facets);
            RemeshedSurface made;
            {
                nb::gil_scoped_release release;
                made = remesh_surface(point_rows, facet_rows, {edge_length, distance, passes});
            }
            return std::make_tuple(as_table(made.points), as_table(made.facets), made.distance,
                                   made.splits, made.collapses, made.flips, made.moves);
        },
        nb::arg("points").noconvert(), nb::arg("facets").noconvert(), nb::arg("edge_length"),
        nb::arg("distance"), nb::arg("passes"));
}
