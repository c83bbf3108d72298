#pragma once
// Elements (cells, facets or edges) in compact blocks of up to 64, so that far ones are passed
// over together and near ones are tested side by side.

#include "collision/block_boxes.hpp"
#include "collision/size_classes.hpp"

#include <span>
#include <utility>
#include <vector>

namespace fastsim {

// Order by class of size, the coarsest first, and within it so that each run of as many as are in a
// block is compact. Pre-condition: a middle and a class for each element.
std::vector<std::int32_t> compact_order(std::span<const Position> middles,
                                        const SizeClasses &classes, std::size_t elements_in_block);

template <std::size_t corners> class ElementBlocks {
  public:
    using Index = std::int32_t;
    using Element = std::array<Index, corners>;
    static constexpr std::size_t most_points = corners * BlockBoxes::capacity;

    struct Block {
        std::uint32_t first, last;             // elements, in the blocks' own order
        std::uint32_t first_point, last_point; // of `_points`
    };

    // Sizes and order are taken from the points as they are now.
    // Pre-condition: elements_in_block is 1 to the capacity of BlockBoxes.
    ElementBlocks(std::span<const Position> points, std::span<const Element> elements,
                  std::size_t elements_in_block)
        : _elements(elements.begin(), elements.end()) {
        std::vector<double> sizes;
        std::vector<Position> middles;
        for (const Element &element : elements) {
            const Extent box = extent_of(points, element);
            sizes.push_back(box.longest());
            middles.push_back(box.middle());
        }
        const SizeClasses classes = sort_by_size(sizes);
        _number = compact_order(middles, classes, elements_in_block);
        make_blocks(classes, elements_in_block);
        _num_points = points.size();
        measure(points);
    }

    [[nodiscard]] std::size_t num_classes() const { return _mean_size.size(); }
    [[nodiscard]] std::span<const Block> blocks(std::size_t size_class) const {
        const auto [first, last] = _class_blocks[size_class];
        return std::span(_blocks).subspan(first, last - first);
    }
    [[nodiscard]] const std::vector<Element> &elements() const { return _elements; }
    // The element's number, from its place in the blocks.
    [[nodiscard]] Index number(std::size_t k) const { return _number[k]; }
    // Mean size of the blocks of each class, at the time of construction [m]; > 0.
    [[nodiscard]] const std::vector<double> &mean_size() const { return _mean_size; }

    [[nodiscard]] Extent extent(const Block &block, std::span<const Position> points) const {
        Extent box = Extent::nothing();
        for (std::size_t k = block.first_point; k < block.last_point; ++k)
            box.add(points[static_cast<std::size_t>(_points[k])]);
        return box;
    }

    [[nodiscard]] std::size_t num_points() const { return _num_points; }

    // Where points are in the block that was marked last; other blocks' places are outside its own.
    class Marks {
      public:
        explicit Marks(std::size_t num_points)
            : _place(num_points, std::numeric_limits<std::uint32_t>::max()) {}

      private:
        friend class ElementBlocks;
        std::vector<std::uint32_t> _place;
    };
    void mark(const Block &block, Marks &marks) const {
        for (std::uint32_t k = block.first_point; k < block.last_point; ++k)
            marks._place[static_cast<std::size_t>(_points[k])] = k;
    }
    // Of the block's elements, those that have a point of their own mesh as a corner: a bit for
    // each. Pre-condition: the block is marked.
    [[nodiscard]] std::uint64_t with_corner(const Block &block, Index point,
                                            const Marks &marks) const {
        const std::uint32_t k = marks._place[static_cast<std::size_t>(point)];
        return k - block.first_point < block.last_point - block.first_point ? _incident[k] : 0;
    }

    // Boxes of a block's elements, grown.
    void fit(const Block &block, std::span<const Position> points, double grown,
             BlockBoxes &boxes) const {
        std::array<Position, most_points> own;
        for (std::size_t k = block.first_point; k < block.last_point; ++k)
            own[k - block.first_point] = points[static_cast<std::size_t>(_points[k])];
        boxes.resize(block.last - block.first);
        for (std::size_t k = block.first; k < block.last; ++k) {
            const std::array<std::uint8_t, corners> &at = _local[k];
            Extent box{own[at[0]], own[at[0]]};
            for (std::size_t c = 1; c < corners; ++c)
                box.add(own[at[c]]);
            boxes.set(k - block.first, box.grown(grown));
        }
    }

  private:
    void make_blocks(const SizeClasses &classes, std::size_t elements_in_block) {
        const auto class_of = [&](std::size_t k) {
            return classes.of[static_cast<std::size_t>(_number[k])];
        };
        _local.resize(_elements.size());
        _class_blocks.assign(classes.count(), {0, 0});
        std::vector<Index> own;
        for (std::size_t first = 0, last = 0; first < _number.size(); first = last) {
            own.clear();
            while (last < _number.size() && last < first + elements_in_block &&
                   class_of(last) == class_of(first)) {
                const Element &element = _elements[static_cast<std::size_t>(_number[last++])];
                own.insert(own.end(), element.begin(), element.end());
            }
            std::sort(own.begin(), own.end());
            own.erase(std::unique(own.begin(), own.end()), own.end());
            for (std::size_t k = first; k < last; ++k)
                for (std::size_t c = 0; c < corners; ++c) {
                    const Index point = _elements[static_cast<std::size_t>(_number[k])][c];
                    _local[k][c] = static_cast<std::uint8_t>(
                        std::lower_bound(own.begin(), own.end(), point) - own.begin());
                }
            _blocks.push_back({static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last),
                               static_cast<std::uint32_t>(_points.size()),
                               static_cast<std::uint32_t>(_points.size() + own.size())});
            _class_blocks[class_of(first)].second = _blocks.size();
            for (std::size_t k = class_of(first) + 1; k < _class_blocks.size(); ++k)
                _class_blocks[k] = {_blocks.size(), _blocks.size()};
            _points.insert(_points.end(), own.begin(), own.end());
            _incident.resize(_points.size(), 0);
            for (std::size_t k = first; k < last; ++k)
                for (std::size_t c = 0; c < corners; ++c)
                    _incident[_blocks.back().first_point + _local[k][c]] |= std::uint64_t{1}
                                                                            << (k - first);
        }
        _points.shrink_to_fit();
        _incident.shrink_to_fit();
    }
    void measure(std::span<const Position> points) {
        for (std::size_t k = 0; k < _class_blocks.size(); ++k) {
            double sum = 0.0;
            for (const Block &block : blocks(k))
                sum += extent(block, points).longest();
            const double count = static_cast<double>(std::max<std::size_t>(blocks(k).size(), 1));
            _mean_size.push_back(std::max(sum / count, std::numeric_limits<double>::min()));
        }
    }

    std::vector<Element> _elements; // as given
    std::vector<Index> _number;     // of each element, in the order of the blocks
    std::vector<std::array<std::uint8_t, corners>> _local; // corners in the block's own points
    std::vector<Index> _points;                            // of each block, each once
    std::vector<std::uint64_t> _incident; // elements of the block that have the point
    std::vector<Block> _blocks;
    std::vector<std::pair<std::size_t, std::size_t>> _class_blocks; // first and end
    std::vector<double> _mean_size;
    std::size_t _num_points = 0;
};

} // namespace fastsim
