#include "collision/size_classes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr std::size_t most_classes = 40; // a factor of 10^12 in size
// A class of so few beside its neighbour is not worth a table of its own.
constexpr std::size_t few = 16;

} // namespace

SizeClasses sort_by_size(std::span<const double> sizes) {
    double largest = 0.0;
    for (const double size : sizes)
        largest = std::max(largest, size);
    const auto level_of = [&](double size) -> std::size_t {
        if (!(size > 0.0))
            return 0;
        // The least number above the largest, so that a mesh of equal cells is one class.
        const int octaves = std::ilogb(1.001 * largest / size);
        return std::min(static_cast<std::size_t>(std::max(octaves, 0)), most_classes - 1);
    };
    std::array<std::size_t, most_classes> members{};
    for (const double size : sizes)
        ++members[level_of(size)];
    // Which class each level goes to: the ends are drawn in while they hold next to nothing.
    std::size_t first = 0, last = most_classes - 1;
    while (last > 0 && members[last] == 0)
        --last;
    for (; first < last && members[first] * few < members[first + 1]; ++first)
        members[first + 1] += members[first];
    for (; last > first && members[last] * few < members[last - 1]; --last)
        members[last - 1] += members[last];
    SizeClasses classes;
    classes.of.reserve(sizes.size());
    std::array<std::size_t, most_classes> name{};
    for (std::size_t level = first; level <= last; ++level)
        if (members[level] > 0 || level == first) {
            name[level] = classes.mean.size();
            classes.mean.push_back(0.0);
        }
    std::vector<double> counted(classes.mean.size(), 0.0);
    for (const double size : sizes) {
        const std::size_t k = name[std::clamp(level_of(size), first, last)];
        classes.of.push_back(static_cast<std::uint8_t>(k));
        classes.mean[k] += size;
        counted[k] += 1.0;
    }
    for (std::size_t k = 0; k < classes.mean.size(); ++k)
        classes.mean[k] = std::max(classes.mean[k] / std::max(counted[k], 1.0),
                                   std::numeric_limits<double>::min());
    return classes;
}

} // namespace fastsim
