#include "mechanics/cell_bounds.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

double bound_cell_stiffness(std::span<const Point> points,
                            std::span<const std::array<std::int32_t, 4>> cells, double lmbda,
                            double mu, std::span<double> upper, std::span<double> lower) {
    double largest_cosine = -1.0;
    for (std::size_t c = 0; c < cells.size(); ++c) {
        const auto at = [&](std::size_t k) -> const Point & {
            return points[static_cast<std::size_t>(cells[c][k])];
        };
        const Point u = minus(at(1), at(0)), v = minus(at(2), at(0)), w = minus(at(3), at(0));
        // Gradients of the shape functions.
        std::array<Point, 4> g{Point{}, cross(v, w), cross(w, u), cross(u, v)};
        const double six_volumes = dot(u, g[1]);
        for (std::size_t k = 1; k < 4; ++k)
            for (std::size_t i = 0; i < 3; ++i) {
                g[k][i] /= six_volumes;
                g[0][i] -= g[k][i];
            }
        std::array<double, 4> length;
        double trace = 0.0, squares = 0.0;
        for (std::size_t a = 0; a < 4; ++a) {
            const double product = dot(g[a], g[a]);
            length[a] = std::sqrt(product);
            trace += product;
            squares += product * product;
            for (std::size_t b = 0; b < a; ++b) {
                const double mixed = dot(g[a], g[b]);
                squares += 2.0 * mixed * mixed;
                largest_cosine = std::max(largest_cosine, -mixed / (length[a] * length[b]));
            }
        }
        upper[c] = std::sqrt((lmbda * lmbda + mu * mu) * trace * trace +
                             (5.0 * mu * mu + 4.0 * lmbda * mu) * squares);
        lower[c] = lmbda * trace + 2.0 * mu * squares / trace;
    }
    return largest_cosine;
}

} // namespace fastsim
