#include "collision/extent.hpp"

#include "errors.hpp"

#include <cmath>
#include <ranges>
#include <utility>

namespace fastsim {

namespace {

// What comparisons with NaN pass over is still in the sum of 0 x.
double checksum(const Position &p) { return 0.0 * p[0] + 0.0 * p[1] + 0.0 * p[2]; }

/// Names the points that are not finite, if any.
template <typename Numbers>
void require_finite(std::span<const Position> points, const Numbers &chosen) {
    std::vector<std::int32_t> guilty;
    for (const std::int32_t v : chosen)
        if (!std::isfinite(checksum(points[static_cast<std::size_t>(v)])))
            guilty.push_back(v);
    if (!guilty.empty())
        throw NonFiniteError(std::move(guilty));
}

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
    double total = checksum(points.back());
    for (const double s : sum)
        total += s;
    if (!std::isfinite(total))
        require_finite(points, std::views::iota(0, static_cast<std::int32_t>(points.size())));
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
    if (!std::isfinite(sum[0] + sum[1] + sum[2]))
        require_finite(points, chosen);
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
