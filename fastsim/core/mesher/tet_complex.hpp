#pragma once
// A tetrahedralisation under change: cells, their neighbours, and one operation that replaces a
// set of cells by another with the same outer facets. Every flip and insertion is that operation.

#include "predicates/predicates.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

namespace fastsim {

using Index = std::int32_t;
using Cell = std::array<Index, 4>;
using Triple = std::array<Index, 3>;

constexpr Index none = -1;

/// Facet k lies opposite corner k; counter-clockwise seen from outside a positive cell.
constexpr std::array<std::array<int, 3>, 4> cell_facets{
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

/// The same facet whatever its orientation.
inline Triple sorted_triple(Index a, Index b, Index c) {
    const Index low = std::min(a, b), high = std::max(a, b);
    return {std::min(low, c), std::max(low, std::min(high, c)), std::max(high, c)};
}
/// The same edge whatever its direction.
inline std::uint64_t edge_key(Index a, Index b) {
    const auto low = static_cast<std::uint64_t>(std::min(a, b));
    return (low << 32) | static_cast<std::uint64_t>(std::max(a, b));
}

// What tables need of their keys: a number, and equality (of arrays == asks the library's memcmp).
struct EdgeHash {
    static bool is_same(std::uint64_t a, std::uint64_t b) { return a == b; }
    std::size_t operator()(std::uint64_t key) const {
        key *= 0x9E3779B97F4A7C15ull;
        return static_cast<std::size_t>(key ^ (key >> 32));
    }
};

struct TripleHash {
    static bool is_same(const Triple &a, const Triple &b) {
        return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
    }
    std::size_t operator()(const Triple &t) const {
        std::uint64_t h = static_cast<std::uint64_t>(t[0]) * 0x9E3779B97F4A7C15ull;
        h = (h ^ (h >> 29)) + static_cast<std::uint64_t>(t[1]);
        h *= 0xBF58476D1CE4E5B9ull;
        h = (h ^ (h >> 32)) + static_cast<std::uint64_t>(t[2]);
        h *= 0x94D049BB133111EBull;
        return static_cast<std::size_t>(h ^ (h >> 31));
    }
};

/// A cell's facet.
struct Side {
    Index cell;
    int facet;
};

class TetComplex {
  public:
    std::vector<Point> points;
    /// Altitude below which a cell counts as bad whatever its angles; 0 for none. See cell_quality.
    double wanted_altitude = 0.0;
    /// Where positive, flips rate cells by their time step, and make none of a smaller sine.
    double least_sine = 0.0;

    std::size_t num_slots() const { return _cells.size(); }
    bool is_alive(Index cell) const { return _cells[at(cell)][0] != none; }
    const Cell &cell(Index c) const { return _cells[at(c)]; }
    std::span<const Cell> cells() const { return _cells; } // by slot
    Index neighbour(Index c, int facet) const { return _neighbours[at(c)][slot(facet)]; }
    /// A living cell at a point, or none.
    Index cell_at(Index point) const { return _cell_of_point[at(point)]; }

    void add_point(const Point &point);
    void add_points(std::span<const Point> more);
    /// Start: cells with their neighbours, by facet; none where there is none.
    void set_cells(std::vector<Cell> cells, std::vector<Cell> neighbours);

    static Triple facet_of(const Cell &v, int k) {
        const auto &f = cell_facets[slot(k)];
        return {v[slot(f[0])], v[slot(f[1])], v[slot(f[2])]};
    }
    Triple facet(Index c, int k) const { return facet_of(_cells[at(c)], k); }
    /// -1 when it is not a corner.
    int corner_of(Index c, Index point) const {
        const Cell &v = _cells[at(c)];
        for (int k = 0; k < 4; ++k)
            if (v[slot(k)] == point)
                return k;
        return -1;
    }
    int orientation(const Cell &c) const;

    /// Replaces `dead` by `fresh`. Pre-condition: both have the same outer facets.
    /// The new cells' numbers are left in `fresh_cells`. With `may_change_boundary`, facets
    /// without a neighbour may come and go, and so may a neighbour's.
    void replace(std::span<const Index> dead, std::span<const Cell> fresh,
                 bool may_change_boundary = false);
    const std::vector<Index> &fresh_cells() const { return _fresh_cells; }

    /// All living cells at a point.
    void cells_around(Index point, std::vector<Index> &out) const;
    /// Cells around edge (a, b) in turn, with the ring of other corners: cell i holds ring[i] and
    /// ring[i + 1]. Empty when there is no such edge; `is_closed` false at the outer boundary.
    void edge_ring(Index a, Index b, std::vector<Index> &cells, std::vector<Index> &ring,
                   bool &is_closed) const;
    /// The same from a cell that has the edge.
    void edge_ring_from(Index start, Index a, Index b, std::vector<Index> &cells,
                        std::vector<Index> &ring, bool &is_closed) const;
    bool has_edge(Index a, Index b) const;
    /// A cell with facet (a, b, c) in either orientation; cell none when there is none.
    Side find_facet(Index a, Index b, Index c) const;

    static std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  private:
    static std::size_t slot(int k) { return static_cast<std::size_t>(k); }
    Index new_slot();
    /// The first living cell at a point, in the order of cells_around, that `fits`, or none.
    template <typename Fits> Index first_around(Index point, const Fits &fits) const;
    void close_boundary(std::span<const Index> corners);
    void link(std::span<const Index> cells);

    struct OpenSide {
        Triple key; // sorted
        Side side;
    };

    std::vector<Cell> _cells;
    std::vector<Cell> _neighbours;
    std::vector<Index> _cell_of_point;
    std::vector<Index> _free_slots;
    std::vector<Index> _fresh_cells;
    std::vector<OpenSide> _open;
    mutable std::vector<std::uint32_t> _visit;
    mutable std::uint32_t _visit_stamp = 0;
};

} // namespace fastsim
