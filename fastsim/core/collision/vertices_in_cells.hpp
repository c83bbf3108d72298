#pragma once
// Which vertices lie in which tetrahedra: of another body, or of the same one.

#include "collision/size_classes.hpp"
#include "collision/voxel_hash.hpp"

#include <compare>
#include <utility>

namespace fastsim {

struct VertexInCell {
    std::int32_t vertex; // its number in the body's points
    std::int32_t cell;
    std::array<double, 4> weights; // barycentric, >= 0, sum 1

    auto operator<=>(const VertexInCell &other) const {
        return std::pair(vertex, cell) <=> std::pair(other.vertex, other.cell);
    }
    bool operator==(const VertexInCell &other) const {
        return vertex == other.vertex && cell == other.cell;
    }
};

// The narrow phase, which is also the definition: in the cell's closed box, and with no negative
// weight as computed here. A flat or inverted cell holds nothing.
class CellFrame {
  public:
    CellFrame(std::span<const Position> points, const std::array<std::int32_t, 4> &cell);

    [[nodiscard]] const Extent &box() const { return _box; }
    [[nodiscard]] bool holds(const Position &p, std::array<double, 4> &weights);

  private:
    std::array<const Position *, 4> _corners;
    Extent _box;
    // Rows of the inverse of the edges' matrix; made when a vertex is in the box.
    std::array<Position, 3> _row{};
    bool _is_made = false, _is_positive = false;
};

// Detection from step to step. Cells are sorted once: by class of size, and within a class along a
// curve that fills space, so that a run of them is compact and is passed over as one.
class VerticesInCells {
  public:
    using Index = std::int32_t;
    using Cell = std::array<Index, 4>;

    // Sizes are taken from the points as they are now; pre-condition: at least one cell.
    // `is_same_body`: vertices number the cells' own points, and a cell's corners do not count.
    VerticesInCells(std::span<const Position> cell_points, std::span<const Cell> cells,
                    std::span<const Index> vertices, bool is_same_body);

    // All pairs, ascending; the result is valid until the next call. Throws
    // std::invalid_argument when a vertex or a point of the cells is not finite.
    std::span<const VertexInCell> find(std::span<const Position> vertex_points,
                                       std::span<const Position> cell_points);

    // What the last call did: vertices hashed, cells near vertices, pairs tested.
    struct Work {
        std::size_t hashed = 0, cells_near = 0, pairs_tested = 0;
    };
    [[nodiscard]] const Work &work() const { return _work; }
    [[nodiscard]] std::vector<double> voxel_sizes() const;

  private:
    struct Block {
        std::uint32_t first_cell, last_cell;   // of `_cells` and `_number`
        std::uint32_t first_point, last_point; // of `_block_points`
        std::size_t size_class;
    };
    void make_blocks(std::span<const Position> points, std::span<const Cell> cells,
                     const SizeClasses &classes);
    void look_into(const Block &block, std::span<const Position> vertex_points,
                   std::span<const Position> cell_points);

    std::vector<Index> _vertices, _active;
    std::vector<double> _voxel_sizes; // by class, coarsest first
    VoxelHash _hash;
    std::vector<Index> _number; // of each cell in the mesh
    std::vector<Cell> _cells;   // their corners, in the same order
    std::vector<Block> _blocks;
    std::vector<Index> _block_points; // points of a block's cells, each once
    std::vector<VertexInCell> _found;
    Work _work;
    bool _is_same_body;
};

// The oracle: every vertex against every cell, by the same narrow phase.
std::vector<VertexInCell> find_vertices_in_cells_brute_force(
    std::span<const Position> vertex_points, std::span<const std::int32_t> vertices,
    std::span<const Position> cell_points, std::span<const std::array<std::int32_t, 4>> cells,
    bool is_same_body);

} // namespace fastsim
