#pragma once
// What one thread needs to look hashed points or boxes up in blocks of elements.

#include "collision/element_blocks.hpp"
#include "collision/voxel_hash.hpp"

#include <bit>

namespace fastsim {

template <std::size_t corners, typename Pair> class BlockSearch {
  public:
    using Blocks = ElementBlocks<corners>;
    using Block = typename Blocks::Block;

    // Room for that many hashed points.
    BlockSearch(const Blocks &blocks, std::size_t most, InstructionSet at_most)
        : _marks(blocks.num_points()), _boxes(at_most), _near(most + 1), _bits(most + 1) {}

    // Places in the hash of what lies in the box and keep(place) is true for.
    template <typename Keep>
    std::span<const std::uint32_t> look_up(const VoxelHash &hash, const Extent &box, Keep &&keep) {
        std::size_t count = 0;
        for (const std::uint32_t k : hash.near(box, _near)) {
            _near[count] = k;
            count += keep(k) ? 1 : 0;
        }
        return {_near.data(), count};
    }

    // Calls visit(place, element) where the row of the table at one of the places meets the box
    // of one of the block's elements, grown. `without(place)` are elements left out, a bit each.
    template <typename Without, typename Visit>
    void test(const Blocks &blocks, const Block &block, std::span<const Position> points,
              double grown, const BoxTable &table, std::span<const std::uint32_t> places,
              Without &&without, Visit &&visit) {
        blocks.fit(block, points, grown, _boxes);
        _boxes.find_meeting(table, places, _bits.data());
        for (std::size_t j = 0; j < places.size(); ++j)
            for (std::uint64_t bits = _bits[j] & ~without(places[j]); bits != 0; bits &= bits - 1)
                visit(places[j], blocks.number(block.first +
                                               static_cast<std::size_t>(std::countr_zero(bits))));
    }

    // The block's elements that have a point as a corner, after `mark` of this block.
    void mark(const Blocks &blocks, const Block &block) { blocks.mark(block, _marks); }
    [[nodiscard]] std::uint64_t with_corner(const Blocks &blocks, const Block &block,
                                            std::int32_t point) const {
        return blocks.with_corner(block, point, _marks);
    }

    std::vector<Pair> found;

  private:
    typename Blocks::Marks _marks;
    BlockBoxes _boxes;
    std::vector<std::uint32_t> _near;
    std::vector<std::uint64_t> _bits;
};

} // namespace fastsim
