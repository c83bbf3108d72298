#include "slivers/cell_quality.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

// Wanted altitude in parts of the thinnest facet's, and of the mean edge: a regular cell has 0.82.
constexpr double share_of_thinnest = 0.85, share_of_edge = 0.4;

} // namespace

double cell_quality(const TetComplex &complex, const Cell &cell) {
    const Point &a = complex.points[TetComplex::at(cell[0])];
    const Point &b = complex.points[TetComplex::at(cell[1])];
    const Point &c = complex.points[TetComplex::at(cell[2])];
    const Point &d = complex.points[TetComplex::at(cell[3])];
    const Point ab = minus(b, a), ac = minus(c, a), ad = minus(d, a);
    const Point bc = minus(c, b), bd = minus(d, b), cd = minus(d, c);
    const Point normal_d = cross(ab, ac), normal_b = cross(ac, ad);
    const double six_volumes = dot(normal_d, ad);
    const auto squared = [](const Point &v) { return dot(v, v); };
    // Four times the squared areas of the facets opposite a, b, c, d.
    const double fa = squared(cross(bc, bd)), fb = squared(normal_b);
    const double fc = squared(cross(ab, ad)), fd = squared(normal_d);
    // sin(dihedral at an edge) = 6 V |edge| / (2 A_i 2 A_j), facets i and j opposite the other
    // edge's ends; squared, and over one denominator, so that one root and one division do.
    const double fab = fa * fb, fcd = fc * fd;
    const double smallest =
        std::min({squared(ab) * fab, squared(ac) * (fa * fc), squared(ad) * (fa * fd),
                  squared(bc) * (fb * fc), squared(bd) * (fb * fd), squared(cd) * fcd});
    const double sine = six_volumes * std::sqrt(smallest / (fab * fcd));
    if (sine != 0.0 && std::isfinite(sine)) {
        if (complex.wanted_altitude <= 0.0)
            return sine;
        // 3 V over the largest area.
        const double altitude = six_volumes / std::sqrt(std::max({fa, fb, fc, fd}));
        return std::min(sine, quality_at_wanted_altitude * altitude / complex.wanted_altitude);
    }
    // Lengths so small or large that products of areas leave the range, or a facet without area:
    // such a cell is as bad as a flat one.
    const double each =
        std::min({squared(ab) / fcd, squared(ac) / (fb * fd), squared(ad) / (fb * fc),
                  squared(bc) / (fa * fd), squared(bd) / (fa * fc), squared(cd) / fab});
    return std::isfinite(each) ? six_volumes * std::sqrt(each) : 0.0;
}

double find_wanted_altitude(const TetComplex &complex) {
    double thinnest = std::numeric_limits<double>::infinity(), sum = 0.0, count = 0.0;
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot) {
        const auto c = static_cast<Index>(slot);
        for (int k = 0; k < 4; ++k) {
            if (!complex.is_alive(c) || complex.neighbour(c, k) != none)
                continue;
            const Triple f = complex.facet(c, k);
            double longest = 0.0;
            Point edges[2];
            for (std::size_t m = 0; m < 3; ++m) {
                const Point &a = complex.points[TetComplex::at(f[m])];
                const Point &b = complex.points[TetComplex::at(f[(m + 1) % 3])];
                for (std::size_t i = 0; i < 3; ++i)
                    edges[m % 2][i] = b[i] - a[i];
                const Point &e = edges[m % 2];
                const double length = std::hypot(e[0], e[1], e[2]);
                longest = std::max(longest, length);
                sum += length;
                count += 1.0;
            }
            const auto &[u, v] = edges;
            const double area = std::hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                                           u[0] * v[1] - u[1] * v[0]);
            thinnest = std::min(thinnest, area / longest);
        }
    }
    return count > 0.0 ? std::min(share_of_thinnest * thinnest, share_of_edge * sum / count) : 0.0;
}

double edge_length_deviation(const TetComplex &complex, Index c) {
    const Cell &v = complex.cell(c);
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j) {
            const Point &a = complex.points[TetComplex::at(v[i])];
            const Point &b = complex.points[TetComplex::at(v[j])];
            const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
            squares += x * x + y * y + z * z;
            sum += std::sqrt(x * x + y * y + z * z);
        }
    const double mean = sum / 6.0;
    return std::sqrt(std::max(squares / 6.0 - mean * mean, 0.0)) / mean;
}

} // namespace fastsim
