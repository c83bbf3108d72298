#include "recovery/polygon_triangulation.hpp"

#include "recovery/segment_geometry.hpp"

#include <algorithm>
#include <limits>

namespace fastsim {

namespace {

/// Area over the sum of squared edges, times the normal's length; positive when the triangle
/// turns the right way.
double shape(const Point &a, const Point &b, const Point &c, const Point &normal) {
    const Point ab = minus(b, a), ac = minus(c, a), bc = minus(c, b);
    return dot(cross(ab, ac), normal) / (dot(ab, ab) + dot(ac, ac) + dot(bc, bc));
}

} // namespace

std::vector<Triple> triangulate_polygon(std::span<const Point> points,
                                        std::span<const Index> polygon, const Point &normal) {
    const std::size_t n = polygon.size();
    std::vector<Triple> triangles;
    if (n < 3)
        return triangles;
    const auto place = [&](std::size_t i) -> const Point & {
        return points[TetComplex::at(polygon[i])];
    };
    // best[i][j]: best worst shape of the polygon i, i+1, ..., j.
    std::vector<double> best(n * n, std::numeric_limits<double>::infinity());
    std::vector<std::size_t> split(n * n, 0);
    for (std::size_t width = 2; width < n; ++width)
        for (std::size_t i = 0; i + width < n; ++i) {
            const std::size_t j = i + width;
            double &here = best[i * n + j];
            here = -std::numeric_limits<double>::infinity();
            for (std::size_t k = i + 1; k < j; ++k) {
                const double worst = std::min({best[i * n + k], best[k * n + j],
                                               shape(place(i), place(k), place(j), normal)});
                if (worst > here) {
                    here = worst;
                    split[i * n + j] = k;
                }
            }
        }
    if (!(best[n - 1] > 0.0))
        return triangles;
    std::vector<std::array<std::size_t, 2>> open{{0, n - 1}};
    while (!open.empty()) {
        const auto [i, j] = open.back();
        open.pop_back();
        if (j < i + 2)
            continue;
        const std::size_t k = split[i * n + j];
        triangles.push_back({polygon[i], polygon[k], polygon[j]});
        open.push_back({i, k});
        open.push_back({k, j});
    }
    return triangles;
}

} // namespace fastsim
