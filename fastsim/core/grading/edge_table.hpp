#pragma once
// From an edge to the point in its middle: open addressing, one allocation, no removal.

#include <cstdint>
#include <vector>

namespace fastsim {

class EdgeTable {
  public:
    using Index = std::int32_t;

    explicit EdgeTable(std::size_t expected = 16) { resize(2 * expected); }

    // The middle's number, or -1.
    [[nodiscard]] Index find(Index a, Index b) const {
        const std::uint64_t k = key(a, b);
        for (std::size_t i = hash(k) & _mask;; i = (i + 1) & _mask) {
            if (_slots[i].key == k)
                return _slots[i].middle;
            if (_slots[i].key == empty)
                return -1;
        }
    }

    // Pre-condition: the edge is not there.
    void insert(Index a, Index b, Index middle) {
        if (2 * (_size + 1) > _slots.size()) {
            const std::vector<Slot> old = std::move(_slots);
            resize(2 * old.size());
            for (const Slot &s : old)
                if (s.key != empty)
                    place(s);
        }
        place({key(a, b), middle});
        ++_size;
    }

  private:
    struct Slot {
        std::uint64_t key = empty;
        Index middle = -1;
    };
    static constexpr std::uint64_t empty = ~std::uint64_t{0};

    static std::uint64_t key(Index a, Index b) {
        return a < b ? (static_cast<std::uint64_t>(a) << 32) | static_cast<std::uint32_t>(b)
                     : (static_cast<std::uint64_t>(b) << 32) | static_cast<std::uint32_t>(a);
    }
    // Multiplicative hashing with the golden ratio; the high bits are the mixed ones.
    static std::size_t hash(std::uint64_t k) {
        return static_cast<std::size_t>((k ^ (k >> 29)) * 0x9E3779B97F4A7C15ull >> 17);
    }
    void resize(std::size_t at_least) {
        std::size_t size = 16;
        while (size < at_least)
            size *= 2;
        _slots.assign(size, {});
        _mask = size - 1;
    }
    void place(const Slot &s) {
        std::size_t i = hash(s.key) & _mask;
        while (_slots[i].key != empty)
            i = (i + 1) & _mask;
        _slots[i] = s;
    }

    std::vector<Slot> _slots;
    std::size_t _mask = 0, _size = 0;
};

} // namespace fastsim
