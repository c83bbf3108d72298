#pragma once
// Pairs in ascending order, without taking memory.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fastsim {

// Sorts by one number of a pair, then by the other: by counting where there are many.
template <typename Pair> class PairOrder {
  public:
    // Room for keys below `num_keys`.
    explicit PairOrder(std::size_t num_keys) : _end(num_keys + 1) {}

    // key(pair) is the number sorted by first, other(pair) the second.
    template <typename Key, typename Other>
    void sort(std::vector<Pair> &pairs, Key &&key, Other &&other) {
        const auto less = [&](const Pair &a, const Pair &b) {
            return key(a) != key(b) ? key(a) < key(b) : other(a) < other(b);
        };
        if (8 * pairs.size() < _end.size()) {
            std::sort(pairs.begin(), pairs.end(), less);
            return;
        }
        std::fill(_end.begin(), _end.end(), 0u);
        for (const Pair &pair : pairs)
            ++_end[static_cast<std::size_t>(key(pair)) + 1];
        for (std::size_t k = 1; k < _end.size(); ++k)
            _end[k] += _end[k - 1];
        // The entry of a key is where the next pair of it goes.
        _sorted.resize(pairs.size());
        for (const Pair &pair : pairs)
            _sorted[_end[static_cast<std::size_t>(key(pair))]++] = pair;
        pairs.swap(_sorted);
        for (std::size_t first = 0, last = 0; first < pairs.size(); first = last) {
            while (last < pairs.size() && key(pairs[last]) == key(pairs[first]))
                ++last;
            if (last - first > 1)
                std::sort(pairs.begin() + static_cast<std::ptrdiff_t>(first),
                          pairs.begin() + static_cast<std::ptrdiff_t>(last), less);
        }
    }

  private:
    std::vector<std::uint32_t> _end;
    std::vector<Pair> _sorted;
};

} // namespace fastsim
