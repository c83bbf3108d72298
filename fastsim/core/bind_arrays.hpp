#pragma once
// Arrays of numbers between Python and the core, for the bind_*.cpp files.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

namespace nb = nanobind;

// Given: C-ordered, of just this type.
template <typename T, nb::ssize_t width>
using GivenTable =
    nb::ndarray<const T, nb::numpy, nb::shape<-1, width>, nb::c_contig, nb::device::cpu>;
template <typename T>
using GivenColumn = nb::ndarray<const T, nb::numpy, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

using GivenPoints = GivenTable<double, 3>;
using GivenFacets = GivenTable<std::int32_t, 3>;
using GivenCells = GivenTable<std::int32_t, 4>;

// A given table as rows; it must outlive them.
template <typename Row, typename Table> std::span<const Row> as_rows(const Table &table) {
    return {reinterpret_cast<const Row *>(table.data()), table.shape(0)};
}

// A new array that Python owns.
template <typename T, std::size_t width>
nb::ndarray<nb::numpy, T> as_table(std::span<const std::array<T, width>> rows) {
    T *copy = new T[rows.size() * width];
    for (std::size_t r = 0; r < rows.size(); ++r)
        std::copy(rows[r].begin(), rows[r].end(), copy + r * width);
    nb::capsule owner(copy, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(copy, {rows.size(), width}, owner);
}

template <typename T, std::size_t width>
nb::ndarray<nb::numpy, T> as_table(const std::vector<std::array<T, width>> &rows) {
    return as_table(std::span<const std::array<T, width>>(rows));
}

template <typename T> nb::ndarray<nb::numpy, T> as_column(std::span<const T> values) {
    T *copy = new T[values.size()];
    std::copy(values.begin(), values.end(), copy);
    nb::capsule owner(copy, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(copy, {values.size()}, owner);
}

} // namespace fastsim
