#include "delaunay/hilbert_order.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace fastsim {
namespace {

constexpr int bits = 19; // 57 for three axes; 7 are left for the round
constexpr std::size_t first_round = 1000;

// Of 21 bits at most every third: powers of two become powers of eight.
std::uint64_t spread(std::uint64_t x) {
    x = (x | x << 32) & 0x001F00000000FFFFull;
    x = (x | x << 16) & 0x001F0000FF0000FFull;
    x = (x | x << 8) & 0x100F00F00F00F00Full;
    x = (x | x << 4) & 0x10C30C30C30C30C3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

// Position along the Hilbert curve of order `bits` (J. Skilling, Programming the Hilbert curve,
// AIP Conf. Proc. 707, 2004): transpose form, then interleaved.
std::uint64_t hilbert_position(std::array<std::uint32_t, 3> x) {
    // Without branches, of which half would be guessed wrong.
    for (int b = bits - 1; b > 0; --b) {
        const std::uint32_t p = (1u << b) - 1;
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint32_t is_set = 0u - ((x[i] >> b) & 1u); // all bits or none
            const std::uint32_t t = (x[0] ^ x[i]) & p & ~is_set;
            x[0] ^= t | (p & is_set);
            x[i] ^= t;
        }
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    std::uint32_t t = 0;
    for (int b = bits - 1; b > 0; --b) {
        t ^= ((1u << b) - 1) & (0u - ((x[2] >> b) & 1u));
    }
    return spread(x[0] ^ t) << 2 | spread(x[1] ^ t) << 1 | spread(x[2] ^ t);
}

std::uint64_t scramble(std::uint64_t x) { // splitmix64
    x += 0x9E3779B97F4A7C15ull;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
    return x ^ (x >> 31);
}

} // namespace

std::vector<std::int32_t> insertion_order(std::span<const Point> points) {
    Point low{}, high{};
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
    for (const Point &p : points) {
        for (std::size_t i = 0; i < 3; ++i) {
            low[i] = std::min(low[i], p[i]);
            high[i] = std::max(high[i], p[i]);
        }
    }
    double width = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
        width = std::max(width, high[i] - low[i]);
    }
    const double scale = width > 0.0 ? static_cast<double>((1u << bits) - 1) / width : 0.0;
    unsigned last_round = 0;
    while (last_round < 17 && (first_round << (3 * last_round)) < points.size()) {
        ++last_round;
    }
    std::vector<std::pair<std::uint64_t, std::int32_t>> keys(points.size());
    for (std::size_t p = 0; p < points.size(); ++p) {
        std::array<std::uint32_t, 3> x{};
        for (std::size_t i = 0; i < 3; ++i) {
            x[i] = static_cast<std::uint32_t>((points[p][i] - low[i]) * scale);
        }
        // Seven of eight points come in the last round, of the others again seven of eight in the
        // one before, and so on.
        unsigned round = last_round;
        for (std::uint64_t coin = scramble(p); round > 0 && (coin & 7u) == 0; coin >>= 3) {
            --round;
        }
        keys[p] = {(static_cast<std::uint64_t>(round) << (3 * bits)) | hilbert_position(x),
                   static_cast<std::int32_t>(p)};
    }
    std::sort(keys.begin(), keys.end());
    std::vector<std::int32_t> order(points.size());
    for (std::size_t p = 0; p < points.size(); ++p) {
        order[p] = keys[p].second;
    }
    return order;
}

} // namespace fastsim
