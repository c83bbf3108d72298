#pragma once
// A set in one piece of memory: the surface's edges and facets are put in and asked about by the
// hundred thousand, which takes longer where each has a node of its own.

#include <algorithm>
#include <bit>
#include <cstddef>
#include <vector>

namespace fastsim {

/// Keys are found by Hash, from which on slots are looked at in turn; `vacant` is none of them.
template <typename Key, typename Hash, Key vacant> class FlatSet {
  public:
    void reserve(std::size_t count) {
        if (2 * count > _slots.size())
            grow(std::bit_ceil(std::max<std::size_t>(2 * count, 16)));
    }

    bool contains(const Key &key) const {
        return _size > 0 && Hash::is_same(_slots[slot_of(key)], key);
    }

    void insert(const Key &key) {
        reserve(_size + 1);
        Key &slot = _slots[slot_of(key)];
        _size += Hash::is_same(slot, key) ? 0 : 1;
        slot = key;
    }

    void erase(const Key &key) {
        if (!contains(key))
            return;
        // What follows without a gap, and might not be found any more, moves up.
        std::size_t hole = slot_of(key);
        const std::size_t last = _slots.size() - 1;
        for (std::size_t next = (hole + 1) & last; !is_vacant(next); next = (next + 1) & last) {
            const std::size_t wanted = Hash{}(_slots[next]) & last;
            if (((next - wanted) & last) >= ((next - hole) & last)) {
                _slots[hole] = _slots[next];
                hole = next;
            }
        }
        _slots[hole] = vacant;
        --_size;
    }

  private:
    bool is_vacant(std::size_t slot) const { return Hash::is_same(_slots[slot], vacant); }
    /// Where a key is, or would be.
    std::size_t slot_of(const Key &key) const {
        const std::size_t last = _slots.size() - 1;
        std::size_t slot = Hash{}(key)&last;
        while (!is_vacant(slot) && !Hash::is_same(_slots[slot], key))
            slot = (slot + 1) & last;
        return slot;
    }

    void grow(std::size_t count) {
        std::vector<Key> old(count, vacant);
        old.swap(_slots);
        for (const Key &key : old)
            if (!Hash::is_same(key, vacant))
                _slots[slot_of(key)] = key;
    }

    std::vector<Key> _slots; // a power of two of them, at most half are taken
    std::size_t _size = 0;
};

} // namespace fastsim
