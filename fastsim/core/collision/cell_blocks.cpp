#include "collision/cell_blocks.hpp"

#include <numeric>

namespace fastsim {

namespace {

/// Halves the longest side of the middles again and again, at whole blocks.
void split(std::span<std::int32_t> numbers, std::span<const Position> middles,
           std::size_t cells_in_block) {
    while (numbers.size() > cells_in_block) {
        Extent box = Extent::nothing();
        for (const std::int32_t k : numbers)
            box.add(middles[static_cast<std::size_t>(k)]);
        std::size_t axis = 0;
        for (std::size_t i = 1; i < 3; ++i)
            if (box.high[i] - box.low[i] > box.high[axis] - box.low[axis])
                axis = i;
        const std::size_t num_blocks = (numbers.size() + cells_in_block - 1) / cells_in_block;
        const std::size_t half = num_blocks / 2 * cells_in_block;
        std::nth_element(numbers.begin(), numbers.begin() + static_cast<std::ptrdiff_t>(half),
                         numbers.end(), [&](std::int32_t a, std::int32_t b) {
                             const double x = middles[static_cast<std::size_t>(a)][axis];
                             const double y = middles[static_cast<std::size_t>(b)][axis];
                             return x != y ? x < y : a < b;
                         });
        split(numbers.first(half), middles, cells_in_block);
        numbers = numbers.subspan(half);
    }
}

/// Order by class of size, the coarsest first, and within it so that each run of as many as are in
/// a block is compact.
std::vector<std::int32_t> compact_order(std::span<const Position> middles,
                                        const SizeClasses &classes, std::size_t cells_in_block) {
    std::vector<std::int32_t> numbers(middles.size());
    std::iota(numbers.begin(), numbers.end(), 0);
    const auto class_of = [&](std::int32_t k) { return classes.of[static_cast<std::size_t>(k)]; };
    std::stable_sort(numbers.begin(), numbers.end(),
                     [&](std::int32_t a, std::int32_t b) { return class_of(a) < class_of(b); });
    for (std::size_t first = 0, last = 0; first < numbers.size(); first = last) {
        while (last < numbers.size() && class_of(numbers[last]) == class_of(numbers[first]))
            ++last;
        split(std::span(numbers).subspan(first, last - first), middles, cells_in_block);
    }
    return numbers;
}

} // namespace

CellBlocks::CellBlocks(std::span<const Position> points, std::span<const Cell> cells,
                       std::size_t cells_in_block)
    : _cells(cells.begin(), cells.end()), _num_points(points.size()) {
    std::vector<double> sizes;
    std::vector<Position> middles;
    for (const Cell &cell : cells) {
        const Extent box = extent_of(points, cell);
        sizes.push_back(box.longest());
        middles.push_back(box.middle());
    }
    const SizeClasses classes = sort_by_size(sizes);
    _number = compact_order(middles, classes, cells_in_block);
    make_blocks(classes, cells_in_block);
    measure(points);
}

void CellBlocks::fit(const Block &block, std::span<const Position> points,
                     BlockBoxes &boxes) const {
    std::array<Position, 4 * BlockBoxes::capacity> own;
    for (std::size_t k = block.first_point; k < block.last_point; ++k)
        own[k - block.first_point] = points[static_cast<std::size_t>(_points[k])];
    boxes.resize(block.last - block.first);
    for (std::size_t k = block.first; k < block.last; ++k) {
        const std::array<std::uint8_t, 4> &at = _local[k];
        Extent box{own[at[0]], own[at[0]]};
        for (std::size_t c = 1; c < 4; ++c)
            box.add(own[at[c]]);
        boxes.set(k - block.first, box);
    }
}

void CellBlocks::make_blocks(const SizeClasses &classes, std::size_t cells_in_block) {
    const auto class_of = [&](std::size_t k) {
        return classes.of[static_cast<std::size_t>(_number[k])];
    };
    const auto cell_at = [&](std::size_t k) -> const Cell & {
        return _cells[static_cast<std::size_t>(_number[k])];
    };
    _local.resize(_cells.size());
    _class_blocks.assign(classes.count(), {0, 0});
    std::vector<Index> own;
    for (std::size_t first = 0, last = 0; first < _number.size(); first = last) {
        own.clear();
        while (last < _number.size() && last < first + cells_in_block &&
               class_of(last) == class_of(first)) {
            own.insert(own.end(), cell_at(last).begin(), cell_at(last).end());
            ++last;
        }
        std::sort(own.begin(), own.end());
        own.erase(std::unique(own.begin(), own.end()), own.end());
        const auto first_point = static_cast<std::uint32_t>(_points.size());
        _points.insert(_points.end(), own.begin(), own.end());
        _incident.resize(_points.size(), 0);
        for (std::size_t k = first; k < last; ++k)
            for (std::size_t c = 0; c < 4; ++c) {
                const auto place = std::lower_bound(own.begin(), own.end(), cell_at(k)[c]);
                _local[k][c] = static_cast<std::uint8_t>(place - own.begin());
                _incident[first_point + _local[k][c]] |= std::uint64_t{1} << (k - first);
            }
        _blocks.push_back({static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last),
                           first_point, static_cast<std::uint32_t>(_points.size())});
        _class_blocks[class_of(first)].second = _blocks.size();
        for (std::size_t k = class_of(first) + 1; k < _class_blocks.size(); ++k)
            _class_blocks[k] = {_blocks.size(), _blocks.size()};
    }
    _points.shrink_to_fit();
    _incident.shrink_to_fit();
}

void CellBlocks::measure(std::span<const Position> points) {
    for (std::size_t k = 0; k < _class_blocks.size(); ++k) {
        double sum = 0.0;
        for (const Block &block : blocks(k))
            sum += extent(block, points).longest();
        const double count = static_cast<double>(std::max<std::size_t>(blocks(k).size(), 1));
        _mean_size.push_back(std::max(sum / count, std::numeric_limits<double>::min()));
    }
}

} // namespace fastsim
