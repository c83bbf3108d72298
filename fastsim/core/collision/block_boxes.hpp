#pragma once
// The boxes of up to 64 cells, side by side, and which of them hold a point: a bit for each.

#include "collision/extent.hpp"
#include "explicit/step_kernel.hpp"

#include <cstddef>

namespace fastsim {

// Points in a table of numbers: that of row k is at first + k * stride.
struct PointTable {
    const double *first;
    std::size_t stride;
};

class BlockBoxes {
  public:
    static constexpr std::size_t capacity = 64;

    // Uses no wider vectors than asked for, nor than the processor has.
    explicit BlockBoxes(InstructionSet at_most);

    // What lies beyond `count` holds nothing.
    void resize(std::size_t count);
    void set(std::size_t k, const Extent &box) {
        for (std::size_t i = 0; i < 3; ++i) {
            _low[i][k] = box.low[i];
            _high[i][k] = box.high[i];
        }
    }

    // For each of these rows of a table, in bits[0], bits[1], ...: bit k is set when box k, closed,
    // holds the row's point. The answer is the same with all vectors.
    void find_holding(const PointTable &table, std::span<const std::uint32_t> rows,
                      std::uint64_t *bits) const {
        _find_holding(*this, table, rows, bits);
    }

  private:
    friend struct HoldingBoxes;
    using FindHolding = void (*)(const BlockBoxes &, const PointTable &,
                                 std::span<const std::uint32_t>, std::uint64_t *);

    alignas(64) std::array<std::array<double, capacity>, 3> _low, _high;
    std::size_t _count = 0;
    FindHolding _find_holding;
};

} // namespace fastsim
