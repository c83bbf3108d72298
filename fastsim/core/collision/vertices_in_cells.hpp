#pragma once
// Which vertices lie in which tetrahedra: of another body, or of the same one.

#include "collision/cell_blocks.hpp"
#include "collision/voxel_hash.hpp"
#include "threads/workers.hpp"

namespace fastsim {

struct VertexInCell {
    std::int32_t vertex; // its number in the body's points
    std::int32_t cell;
    std::array<double, 4> weights; // barycentric, >= 0, sum 1
};

// The narrow phase for a vertex in the cell's closed box: whether no weight, as computed here, is
// negative. A flat or inverted cell holds nothing.
bool is_in_cell(const Position &p, std::span<const Position> points,
                const std::array<std::int32_t, 4> &cell, std::array<double, 4> &weights);

// Detection from step to step: boundary vertices are hashed, and blocks of cells look up what is
// in their boxes.
class VerticesInCells {
  public:
    using Index = std::int32_t;
    using Cell = std::array<Index, 4>;

    // Sizes are taken from the points as they are now; pre-condition: at least one cell.
    // `is_same_body`: vertices number the cells' own points, and a cell's corners do not count.
    VerticesInCells(std::span<const Position> cell_points, std::span<const Cell> cells,
                    std::span<const Index> vertices, bool is_same_body, std::size_t num_threads,
                    InstructionSet at_most);

    // All pairs, ascending; the result is valid until the next call. Throws
    // std::invalid_argument when a vertex or a point of the cells is not finite.
    std::span<const VertexInCell> find(std::span<const Position> vertex_points,
                                       std::span<const Position> cell_points);

    // What the last call did: vertices hashed, cells near vertices, pairs tested.
    struct Work {
        std::size_t hashed = 0, cells_near = 0, pairs_tested = 0;
    };
    [[nodiscard]] const Work &work() const { return _work; }
    // Of each class of cells, ascending.
    [[nodiscard]] std::vector<double> voxel_sizes() const;

  private:
    // What one thread needs to look hashed vertices up in blocks of cells.
    struct Search {
        Search(const CellBlocks &cells, std::size_t num_vertices, InstructionSet at_most)
            : marks(cells), boxes(at_most), near(num_vertices + 1), bits(num_vertices + 1) {}

        CellBlocks::Marks marks;
        BlockBoxes boxes;
        std::vector<std::uint32_t> near;
        std::vector<std::uint64_t> bits;
        std::vector<VertexInCell> found;
        std::size_t cells_near = 0, pairs_tested = 0;
    };
    void look_into(const CellBlocks::Block &block, const Extent &near,
                   std::span<const Position> cell_points, Search &search) const;
    void sort_found();

    CellBlocks _cells;
    std::vector<Index> _vertices, _active;
    VoxelHash _hash;
    std::vector<Search> _searches; // one for each thread
    Workers _workers;
    std::vector<VertexInCell> _found, _sorted;
    std::vector<std::uint32_t> _end; // where the pairs of a vertex end among the sorted
    Work _work;
    bool _is_same_body;
};

// The oracle: every vertex against every cell, by the same narrow phase.
std::vector<VertexInCell> find_vertices_in_cells_brute_force(
    std::span<const Position> vertex_points, std::span<const std::int32_t> vertices,
    std::span<const Position> cell_points, std::span<const std::array<std::int32_t, 4>> cells,
    bool is_same_body);

} // namespace fastsim
