#pragma once
// Which vertices lie in which tetrahedra: of another body, or of the same one.

#include "collision/vertex_hash.hpp"

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

// Detection from step to step. Cells are sorted once into classes of size, a factor of two apart;
// each class has its own hash of the vertices, with voxels to its measure (the paper's adaptive
// voxel size, and several of them where a mesh is graded).
class VerticesInCells {
  public:
    using Index = std::int32_t;
    using Cell = std::array<Index, 4>;

    // Sizes are taken from the points as they are now; pre-condition: at least one cell.
    // `is_same_body`: vertices number the cells' own points, and a cell's corners do not count.
    VerticesInCells(std::span<const Position> cell_points, std::span<const Cell> cells,
                    std::span<const Index> vertices, bool is_same_body);

    // All pairs, ascending; the result is valid until the next call.
    std::span<const VertexInCell> find(std::span<const Position> vertex_points,
                                       std::span<const Position> cell_points);

    // What the last call did: voxel changes, cells near vertices, pairs tested.
    struct Work {
        std::size_t rehashed = 0, cells_near = 0, pairs_tested = 0;
    };
    [[nodiscard]] const Work &work() const { return _work; }
    [[nodiscard]] std::vector<double> voxel_sizes() const;

  private:
    struct SizeClass {
        std::vector<Index> number; // of each cell in the mesh
        std::vector<Cell> cells;   // their corners, side by side
        VertexHash hash;
    };

    std::vector<Index> _vertices;
    std::vector<SizeClass> _classes;
    std::vector<VertexInCell> _found;
    std::vector<std::uint8_t> _side; // of each point of the cells: beyond which sides of a box
    Work _work;
    bool _is_same_body;
};

// The oracle: every vertex against every cell, by the same narrow phase.
std::vector<VertexInCell> find_vertices_in_cells_brute_force(
    std::span<const Position> vertex_points, std::span<const std::int32_t> vertices,
    std::span<const Position> cell_points, std::span<const std::array<std::int32_t, 4>> cells,
    bool is_same_body);

} // namespace fastsim
