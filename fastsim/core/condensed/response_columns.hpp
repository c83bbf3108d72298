#pragma once
// Columns of the compliance at the points that are being pushed, each in a piece of its own.
//
// A compliance is kept by rows of its lower half, so that a column is gathered from all over it.
// Contacts last many steps: a column is gathered once and then added in order, some at a time over
// a part of the seen points that stays in the nearest cache. What is kept in single precision stays
// so; sums are in double.

#include "condensed/compliance.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

template <typename Real> class ResponseColumns {
  public:
    explicit ResponseColumns(const Compliance &compliance);

    /// Displacement of every seen point under the forces at some touched ones, each named once.
    void respond(std::span<const Point> forces, std::span<const std::int32_t> at,
                 std::span<Point> seen);

  private:
    struct Slot {
        std::int32_t point = -1;
        std::uint64_t used = 0;    // when last
        std::vector<Real> numbers; // for each component of the force, of all seen points
    };

    const Real *column(std::int32_t point);

    Compliance _compliance;
    std::vector<Slot> _slots;
    std::vector<std::int32_t> _slot_of; // of each touched point, -1 for none
    std::uint64_t _now = 0;
    std::vector<const Real *> _columns; // of the sum at hand
    std::vector<double> _factors;
};

} // namespace fastsim
