#include "delaunay/hilbert_order.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace fastsim {
namespace {

constexpr int bits = 19; // 57 for three axes; 7 are left for the round
constexpr std::size_t first_round = 1000;

// Position along the Hilbert curve of order `bits` (J. Skilling, Programming the Hilbert curve,
// AIP Conf. Proc. 707, 2004): transpose form, then interleaved.
std::uint64_t hilbert_position(std::array<std::uint32_t, 3> x) {
    for (std::uint32_t q = 1u << (bits - 1); q > 1; q >>= 1) {
        const std::uint32_t p = q - 1;
        for (std::size_t i = 0; i < 3; ++i) {
            if (x[i] & q) {
                x[0] ^= p;
            } else {
                const std::uint32_t t = (x[0] ^ x[i]) & p;
                x[0] ^= t;
                x[i] ^= t;
            }
        }
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    std::uint32_t t = 0;
    for (std::uint32_t q = 1u << (bits - 1); q > 1; q >>= 1) {
        if (x[2] & q) {
            t ^= q - 1;
        }
    }
    std::uint64_t position = 0;
    for (int b = bits - 1; b >= 0; --b) {
        for (std::size_t i = 0; i < 3; ++i) {
            position = (position << 1) | (((x[i] ^ t) >> b) & 1u);
        }
    }
    return position;
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
