#include "collision/element_blocks.hpp"

#include <numeric>

namespace fastsim {

namespace {

/// Halves the longest side of the middles again and again, at whole blocks.
void split(std::span<std::int32_t> numbers, std::span<const Position> middles,
           std::size_t elements_in_block) {
    while (numbers.size() > elements_in_block) {
        Extent box = Extent::nothing();
        for (const std::int32_t k : numbers)
            box.add(middles[static_cast<std::size_t>(k)]);
        std::size_t axis = 0;
        for (std::size_t i = 1; i < 3; ++i)
            if (box.high[i] - box.low[i] > box.high[axis] - box.low[axis])
                axis = i;
        const std::size_t num_blocks = (numbers.size() + elements_in_block - 1) / elements_in_block;
        const std::size_t half = num_blocks / 2 * elements_in_block;
        std::nth_element(numbers.begin(), numbers.begin() + static_cast<std::ptrdiff_t>(half),
                         numbers.end(), [&](std::int32_t a, std::int32_t b) {
                             const double x = middles[static_cast<std::size_t>(a)][axis];
                             const double y = middles[static_cast<std::size_t>(b)][axis];
                             return x != y ? x < y : a < b;
                         });
        split(numbers.first(half), middles, elements_in_block);
        numbers = numbers.subspan(half);
    }
}

} // namespace

std::vector<std::int32_t> compact_order(std::span<const Position> middles,
                                        const SizeClasses &classes, std::size_t elements_in_block) {
    std::vector<std::int32_t> numbers(middles.size());
    std::iota(numbers.begin(), numbers.end(), 0);
    const auto class_of = [&](std::int32_t k) { return classes.of[static_cast<std::size_t>(k)]; };
    std::stable_sort(numbers.begin(), numbers.end(),
                     [&](std::int32_t a, std::int32_t b) { return class_of(a) < class_of(b); });
    for (std::size_t first = 0, last = 0; first < numbers.size(); first = last) {
        while (last < numbers.size() && class_of(numbers[last]) == class_of(numbers[first]))
            ++last;
        split(std::span(numbers).subspan(first, last - first), middles, elements_in_block);
    }
    return numbers;
}

} // namespace fastsim
