#pragma once
// The boxes of up to 64 elements, side by side, and which of them meet other boxes: a bit for each.

#include "collision/extent.hpp"
#include "explicit/step_kernel.hpp"

#include <cstddef>

namespace fastsim {

// Boxes in a table of numbers: row k has its low corner at low + k * stride, its high corner at
// high + k * stride; for points both are the same.
struct BoxTable {
    const double *low, *high;
    std::size_t stride;
};

class BlockBoxes {
  public:
    static constexpr std::size_t capacity = 64;

    // Uses no wider vectors than asked for, nor than the processor has.
    explicit BlockBoxes(InstructionSet at_most);

    // What lies beyond `count` meets nothing.
    void resize(std::size_t count);
    void set(std::size_t k, const Extent &box) {
        for (std::size_t i = 0; i < 3; ++i) {
            _low[i][k] = box.low[i];
            _high[i][k] = box.high[i];
        }
    }

    // For each of these rows of a table, in bits[0], bits[1], ...: bit k is set when box k and the
    // row's, both closed, have a point in common. The answer is the same with all vectors.
    void find_meeting(const BoxTable &table, std::span<const std::uint32_t> rows,
                      std::uint64_t *bits) const {
        _find_meeting(*this, table, rows, bits);
    }

  private:
    friend struct MeetingBoxes;
    using FindMeeting = void (*)(const BlockBoxes &, const BoxTable &,
                                 std::span<const std::uint32_t>, std::uint64_t *);

    alignas(64) std::array<std::array<double, capacity>, 3> _low, _high;
    std::size_t _count = 0;
    FindMeeting _find_meeting;
};

} // namespace fastsim
