#include "collision/extent.hpp"

#include <cmath>

namespace fastsim {

namespace {

[[noreturn]] void refuse() { throw std::invalid_argument("a point is not finite"); }

// What comparisons with NaN pass over is still in the sum.
bool is_finite(double checksum) { return std::isfinite(checksum); }

} // namespace

Extent extent_of_all(std::span<const Position> points) {
    if (points.empty())
        return Extent::nothing();
    // Two points at a time, six numbers side by side: the compiler takes them in vectors.
    constexpr double far = std::numeric_limits<double>::infinity();
    std::array<double, 6> low, high, sum{};
    low.fill(far);
    high.fill(-far);
    const double *x = points.front().data();
    const std::size_t pairs = points.size() / 2;
    for (std::size_t k = 0; k < pairs; ++k, x += 6)
        for (std::size_t i = 0; i < 6; ++i) {
            low[i] = x[i] < low[i] ? x[i] : low[i];
            high[i] = x[i] > high[i] ? x[i] : high[i];
            sum[i] += 0.0 * x[i];
        }
    Extent box{{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
    box.add({low[3], low[4], low[5]});
    box.add({high[3], high[4], high[5]});
    if (points.size() == 1)
        box = {points[0], points[0]};
    box.add(points.back());
    const Position &last = points.back();
    for (const double s : sum)
        if (!is_finite(s))
            refuse();
    if (!is_finite(0.0 * last[0] + 0.0 * last[1] + 0.0 * last[2]))
        refuse();
    return box;
}

Extent extent_of_some(std::span<const Position> points, std::span<const std::int32_t> chosen) {
    Extent box = Extent::nothing();
    Position sum{};
    for (const std::int32_t v : chosen) {
        const Position &p = points[static_cast<std::size_t>(v)];
        box.add(p);
        for (std::size_t i = 0; i < 3; ++i)
            sum[i] += 0.0 * p[i];
    }
    if (!is_finite(sum[0] + sum[1] + sum[2]))
        refuse();
    return box;
}

Extent keep_within(const Extent &box, std::span<const Position> points,
                   std::span<const std::int32_t> chosen, std::vector<std::int32_t> &kept) {
    kept.clear();
    Extent own = Extent::nothing();
    for (const std::int32_t v : chosen)
        if (const Position &p = points[static_cast<std::size_t>(v)]; box.contains(p)) {
            kept.push_back(v);
            own.add(p);
        }
    return own;
}

} // namespace fastsim
