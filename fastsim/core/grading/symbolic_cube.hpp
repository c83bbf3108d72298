#pragma once
// Hebert's symbolic refinement of a cube (1994, "Symbolic local refinement of tetrahedral grids",
// J. Symbolic Computation 17): a cell is a name, and children, parents and neighbours are worked
// out from names, with no stored adjacency.
//
// A name is a generation g, a corner and three signed axes a, b, c of length h = 2^-(g div 3):
//   g mod 3 = 0: corner, +a, +a+b, +a+b+c          (a path along a cube of side h)
//   g mod 3 = 1: corner, +a, +a+b, +(a+b+c)/2      (two sides of a face and the cube's centre)
//   g mod 3 = 2: corner, +a, +(a+b)/2, +(a+b+c)/2  (a side, the face's centre, the cube's)
// Each cell has two names, from either end of its refinement edge; parity tells which one counts.

#include <array>
#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

namespace fastsim {

struct CellName {
    // Coordinates are whole numbers in units of 2^-finest of the cube's side.
    static constexpr int finest = 16;
    using Place = std::array<std::int32_t, 3>;

    std::int32_t generation = 0;
    Place corner{};
    // Axis 1 to 3 with its sign.
    std::array<std::int8_t, 3> axis{1, 2, 3};

    bool operator==(const CellName &) const = default;

    [[nodiscard]] std::array<Place, 4> corners() const;
    // The same cell's name from the other end of its refinement edge, which is the edge from
    // `corner` to its far end (corner 3, 2 or 1 for g mod 3 = 0, 1 or 2).
    [[nodiscard]] CellName from_other_end() const;
    [[nodiscard]] CellName canonical() const;
    // Two cells of the next generation, canonical.
    [[nodiscard]] std::array<CellName, 2> children() const;
    // The cell whose child this is, canonical. Pre-condition: canonical, generation > 0.
    [[nodiscard]] CellName parent() const;
    // The cell of the same generation across the facet opposite corner k, canonical; it may lie
    // outside the cube. Pre-condition: canonical.
    [[nodiscard]] CellName neighbour(int k) const;
    [[nodiscard]] bool is_inside() const;
    // One number for a canonical name: 6 bits generation, 6 bits axes, 3 x 17 bits corner.
    [[nodiscard]] std::uint64_t code() const;

  private:
    [[nodiscard]] Place step(const Place &from, int axis_number, std::int32_t length) const;
    [[nodiscard]] std::int32_t side() const { return std::int32_t{1} << (finest - generation / 3); }
};

class SymbolicCube {
  public:
    // Kuhn's six tetrahedra along the diagonal from the origin.
    SymbolicCube();

    // Bisects the marked cells (in the order of `cells()`), and others until no point hangs.
    // Returns false when the finest generation does not suffice.
    bool refine(std::span<const std::uint8_t> marked);

    // Cells in ascending order of their codes.
    [[nodiscard]] std::vector<CellName> cells() const;
    [[nodiscard]] std::size_t num_cells() const { return _codes.size(); }

  private:
    bool bisect(const CellName &cell);

    // Leaves by code; names are rebuilt from codes.
    std::unordered_set<std::uint64_t> _codes;
};

CellName cell_of_code(std::uint64_t code);

} // namespace fastsim
