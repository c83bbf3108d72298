#pragma once
// Cells in compact blocks of up to 64, so that far ones are passed over together and near ones are
// tested side by side.

#include "collision/block_boxes.hpp"
#include "collision/size_classes.hpp"

#include <span>
#include <utility>
#include <vector>

namespace fastsim {

class CellBlocks {
  public:
    using Index = std::int32_t;
    using Cell = std::array<Index, 4>;

    struct Block {
        std::uint32_t first, last;             // cells, in the blocks' own order
        std::uint32_t first_point, last_point; // of `_points`
    };

    // Sizes and order are taken from the points as they are now.
    // Pre-condition: cells_in_block is 1 to the capacity of BlockBoxes.
    CellBlocks(std::span<const Position> points, std::span<const Cell> cells,
               std::size_t cells_in_block);

    [[nodiscard]] std::size_t num_classes() const { return _mean_size.size(); }
    [[nodiscard]] std::span<const Block> blocks(std::size_t size_class) const {
        const auto [first, last] = _class_blocks[size_class];
        return std::span(_blocks).subspan(first, last - first);
    }
    [[nodiscard]] const std::vector<Cell> &cells() const { return _cells; }
    // The cell's number, from its place in the blocks.
    [[nodiscard]] Index number(std::size_t k) const { return _number[k]; }
    // Mean size of the blocks of each class, at the time of construction [m]; > 0.
    [[nodiscard]] const std::vector<double> &mean_size() const { return _mean_size; }

    [[nodiscard]] Extent extent(const Block &block, std::span<const Position> points) const {
        Extent box = Extent::nothing();
        for (std::size_t k = block.first_point; k < block.last_point; ++k)
            box.add(points[static_cast<std::size_t>(_points[k])]);
        return box;
    }

    // Where points are in the block that was marked last; other blocks' places are outside its own.
    class Marks {
      public:
        explicit Marks(const CellBlocks &blocks)
            : _place(blocks._num_points, std::numeric_limits<std::uint32_t>::max()) {}

      private:
        friend class CellBlocks;
        std::vector<std::uint32_t> _place;
    };
    void mark(const Block &block, Marks &marks) const {
        for (std::uint32_t k = block.first_point; k < block.last_point; ++k)
            marks._place[static_cast<std::size_t>(_points[k])] = k;
    }
    // Of the block's cells, those that have a point of their own mesh as a corner: a bit for each.
    // Pre-condition: the block is marked.
    [[nodiscard]] std::uint64_t with_corner(const Block &block, Index point,
                                            const Marks &marks) const {
        const std::uint32_t k = marks._place[static_cast<std::size_t>(point)];
        return k - block.first_point < block.last_point - block.first_point ? _incident[k] : 0;
    }

    // Boxes of a block's cells.
    void fit(const Block &block, std::span<const Position> points, BlockBoxes &boxes) const;

  private:
    void make_blocks(const SizeClasses &classes, std::size_t cells_in_block);
    void measure(std::span<const Position> points);

    std::vector<Cell> _cells;                        // as given
    std::vector<Index> _number;                      // of each cell, in the order of the blocks
    std::vector<std::array<std::uint8_t, 4>> _local; // corners in the block's own points
    std::vector<Index> _points;                      // of each block, each once
    std::vector<std::uint64_t> _incident;            // cells of the block that have the point
    std::vector<Block> _blocks;
    std::vector<std::pair<std::size_t, std::size_t>> _class_blocks; // first and end
    std::vector<double> _mean_size;
    std::size_t _num_points;
};

} // namespace fastsim
