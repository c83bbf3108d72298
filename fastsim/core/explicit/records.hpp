#pragma once
// How the explicit step lays out its memory: points in reverse Cuthill-McKee order, in records of
// four numbers (the fourth is padding); cells by their points, in batches as wide as the kernel's
// vectors; and what each thread does of both.

#include "explicit/step_kernel.hpp"
#include "mechanics/tet4.hpp"

#include <cstddef>
#include <new>
#include <span>
#include <vector>

namespace fastsim {

/// Allocator for vectors that are loaded whole.
template <typename T> struct Aligned {
    using value_type = T;
    Aligned() = default;
    template <typename U> Aligned(const Aligned<U> &) noexcept {}
    T *allocate(std::size_t n) {
        return static_cast<T *>(::operator new(n * sizeof(T), std::align_val_t{64}));
    }
    void deallocate(T *p, std::size_t) noexcept { ::operator delete(p, std::align_val_t{64}); }
    template <typename U> bool operator==(const Aligned<U> &) const noexcept { return true; }
};

template <typename T> using AlignedVector = std::vector<T, Aligned<T>>;

/// The points' new numbers and back. Tables in and out have the caller's, three numbers a point.
struct PointRecords {
    std::vector<std::size_t> record_of, point_of;

    PointRecords(std::size_t num_points, std::span<const Index> cells);
    /// The same, those of the last class first.
    PointRecords(std::size_t num_points, std::span<const Index> cells,
                 std::span<const Index> class_of_points);

    std::size_t size() const { return record_of.size(); }
    /// Of the record of a point.
    std::size_t first_entry(Index point) const {
        return 4 * record_of[static_cast<std::size_t>(point)];
    }
    /// Entries of the records: one point more than there are, for the corners of the cells that
    /// fill up the last batch, and then whole packs.
    std::size_t padded_size() const {
        return (4 * (size() + 1) + longest_pack - 1) / longest_pack * longest_pack;
    }

    template <typename From, typename To> void pack(std::span<From> table, To *records) const {
        for (std::size_t i = 0; i < size(); ++i)
            for (std::size_t j = 0; j < 3; ++j)
                records[4 * record_of[i] + j] = static_cast<To>(table[3 * i + j]);
    }
    template <typename Real> void unpack(const Real *records, std::span<double> table) const {
        for (std::size_t i = 0; i < size(); ++i)
            for (std::size_t j = 0; j < 3; ++j)
                table[3 * i + j] = static_cast<double>(records[4 * record_of[i] + j]);
    }
};

/// The cells by the sum of their corners' new numbers: those that share points are neighbours.
std::vector<Index> cells_in_order(std::span<const Index> cells, const PointRecords &records);

template <typename Real> struct CellBatches {
    std::size_t width, count;
    AlignedVector<std::int32_t> corners; // each batch: 4 corners x width, first entries
    AlignedVector<Real> rest;            // each batch: 9 gradient entries and the volume, x width
    AlignedVector<Real> moduli;          // each batch: lmbda, mu and c01, x width; if they differ

    CellBatches(const ElasticCells &body, const PointRecords &records, std::size_t kernel_width);
};

/// What a thread does: batches, the points that their cells touch, and the points it moves.
struct Portion {
    std::size_t first_batch, last_batch;
    std::size_t first_touched, last_touched;
    std::size_t first_owned, last_owned;
};

/// The first point that a thread moves, a whole pack's first.
std::size_t first_owned(std::size_t thread, std::size_t num_threads, std::size_t num_points);

/// Portions for at most so many threads.
template <typename Real>
std::vector<Portion> divide(const CellBatches<Real> &batches, std::size_t num_points,
                            std::size_t num_threads);

} // namespace fastsim
