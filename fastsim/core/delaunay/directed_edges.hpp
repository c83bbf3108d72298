#pragma once
// Numbers by directed edge of a cavity's surface.

#include "mesher/tet_complex.hpp"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fastsim {

/// A table of all pairs of corners is quickest where they are few. A cavity has tens of thousands
/// where the surface of a body is dense and its inside empty: there edges are hashed.
class DirectedEdges {
  public:
    /// Forgets all edges. Corners are numbered from 0; each edge is put in once.
    void start(std::size_t num_corners, std::size_t num_edges) {
        _row = num_corners;
        _is_table = num_corners <= most_corners;
        if (_is_table) {
            if (_values.size() < _row * _row)
                _values.resize(_row * _row);
            return;
        }
        const std::size_t count = std::bit_ceil(2 * num_edges);
        _last = count - 1;
        if (_values.size() < count)
            _values.resize(count);
        _keys.assign(count, vacant);
    }

    /// The number of an edge that is put in, or was.
    std::int32_t &operator()(std::uint32_t from, std::uint32_t to) {
        if (_is_table)
            return _values[from * _row + to];
        const std::uint64_t key = std::uint64_t{from} << 32 | to;
        std::size_t slot = EdgeHash{}(key)&_last;
        while (_keys[slot] != key && _keys[slot] != vacant)
            slot = (slot + 1) & _last;
        _keys[slot] = key;
        return _values[slot];
    }

  private:
    static constexpr std::size_t most_corners = 256; // 256 KiB
    static constexpr std::uint64_t vacant = ~std::uint64_t{0};

    bool _is_table = true;
    std::size_t _row = 0, _last = 0;
    std::vector<std::uint64_t> _keys;
    std::vector<std::int32_t> _values;
};

} // namespace fastsim
