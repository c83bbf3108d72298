#pragma once
// The boxes of up to 64 elements, side by side, and which of them meet another box: a bit for each.

#include "collision/extent.hpp"

#include <cstddef>

namespace fastsim {

class BlockBoxes {
  public:
    static constexpr std::size_t capacity = 64;

    BlockBoxes();

    // What lies beyond `count` meets nothing.
    void resize(std::size_t count);
    void set(std::size_t k, const Extent &box) {
        for (std::size_t i = 0; i < 3; ++i) {
            _low[i][k] = box.low[i];
            _high[i][k] = box.high[i];
        }
    }
    [[nodiscard]] Extent get(std::size_t k) const {
        return {{_low[0][k], _low[1][k], _low[2][k]}, {_high[0][k], _high[1][k], _high[2][k]}};
    }

    // Bit k is set when box k and the given one, both closed, have a point in common. With the
    // widest vectors that the processor has; the answer is the same with all.
    [[nodiscard]] std::uint64_t meeting(const Extent &box) const { return _meeting(*this, box); }

  private:
    friend struct MeetingBoxes;
    using Meeting = std::uint64_t (*)(const BlockBoxes &, const Extent &);

    alignas(64) std::array<std::array<double, capacity>, 3> _low, _high;
    std::size_t _count = 0;
    Meeting _meeting;
};

} // namespace fastsim
