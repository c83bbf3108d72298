#pragma once
// Arrays of numbers between Python and the core, for the bind_*.cpp files.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <initializer_list>
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

// A new array of zeros that Python owns.
template <typename T>
nb::ndarray<nb::numpy, T> new_array(std::initializer_list<std::size_t> shape) {
    std::size_t size = 1;
    for (const std::size_t n : shape)
        size *= n;
    T *numbers = new T[size]();
    nb::capsule owner(numbers, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(numbers, shape, owner);
}

// The numbers of an array, one after the other.
template <typename Array> auto as_span(Array &array) {
    return std::span(array.data(), array.size());
}

// A copy that Python owns.
template <typename T, std::size_t width>
nb::ndarray<nb::numpy, T> as_table(std::span<const std::array<T, width>> rows) {
    T *numbers = new T[rows.size() * width]; // not zeroed first: tables are large
    for (std::size_t r = 0; r < rows.size(); ++r)
        std::copy(rows[r].begin(), rows[r].end(), numbers + r * width);
    nb::capsule owner(numbers, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(numbers, {rows.size(), width}, owner);
}

template <typename T, std::size_t width>
nb::ndarray<nb::numpy, T> as_table(const std::vector<std::array<T, width>> &rows) {
    return as_table(std::span<const std::array<T, width>>(rows));
}

// A table in the memory of its owner, which lives as long as the array does. Nothing is copied.
template <typename T, std::size_t width>
nb::ndarray<nb::numpy, const T> as_view(const std::vector<std::array<T, width>> &rows,
                                        nb::handle owner) {
    return {reinterpret_cast<const T *>(rows.data()), {rows.size(), width}, owner};
}

template <typename T> nb::ndarray<nb::numpy, T> as_column(std::span<const T> values) {
    auto column = new_array<T>({values.size()});
    std::copy(values.begin(), values.end(), column.data());
    return column;
}

} // namespace fastsim
