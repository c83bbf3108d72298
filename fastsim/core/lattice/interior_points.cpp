#include "lattice/interior_points.hpp"

#include "lattice/graded_lattice.hpp"
#include "lattice/surface_bins.hpp"
#include "predicates/length.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace fastsim {

namespace {

// Body-centred cells have edges a and sqrt(3)/2 a, 0.923 a in the mean.
constexpr double body_centred_edge = 0.923;
// Bounds the places that guard one facet, where the wanted size is far below its own.
constexpr double most_parts = 256.0;

/// splitmix64: the same sequence on every machine.
class Random {
  public:
    explicit Random(std::uint64_t seed) : _state(seed) {}
    /// Uniform in [-1, 1).
    double next() {
        _state += 0x9E3779B97F4A7C15ull;
        std::uint64_t z = _state;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
        z ^= z >> 31;
        return static_cast<double>(z >> 11) * 0x1.0p-52 - 1.0;
    }

  private:
    std::uint64_t _state;
};

double distance(const Point &a, const Point &b) {
    return length_of(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/// Mean length of the edges at each point of the surface, `longest` at most.
std::vector<double> local_sizes(std::span<const Point> points, std::span<const Triple> facets,
                                double longest) {
    std::vector<double> sum(points.size(), 0.0), count(points.size(), 0.0);
    for (const Triple &f : facets)
        for (std::size_t k = 0; k < 3; ++k) {
            const std::size_t a = TetComplex::at(f[k]), b = TetComplex::at(f[(k + 1) % 3]);
            const double length = distance(points[a], points[b]);
            for (const std::size_t end : {a, b}) {
                sum[end] += length;
                count[end] += 1.0;
            }
        }
    for (std::size_t v = 0; v < sum.size(); ++v)
        sum[v] = count[v] > 0.0 ? std::min(sum[v] / count[v], longest) : longest;
    return sum;
}

/// Guards the surface: its points, and the facets by places not farther apart than the size.
Guards guard_surface(std::span<const Point> points, std::span<const Triple> facets,
                     std::span<const double> sizes, double clearance) {
    Guards guards;
    for (std::size_t v = 0; v < points.size(); ++v)
        guards.add(points[v], clearance * sizes[v]);
    for (const Triple &f : facets) {
        const Point &a = points[TetComplex::at(f[0])], &b = points[TetComplex::at(f[1])],
                    &c = points[TetComplex::at(f[2])];
        const double size = (sizes[TetComplex::at(f[0])] + sizes[TetComplex::at(f[1])] +
                             sizes[TetComplex::at(f[2])]) /
                            3.0;
        const double longest = std::max({distance(a, b), distance(b, c), distance(c, a)});
        const auto parts =
            static_cast<int>(std::clamp(std::ceil(longest / (1.5 * size)), 1.0, most_parts));
        // Centroids of the triangles that the facet is cut into, parts of each edge to a side.
        for (int i = 0; i < parts; ++i)
            for (int j = 0; i + j < parts; ++j)
                for (int turned = 0; turned < (i + j + 1 < parts ? 2 : 1); ++turned) {
                    const double third = (1.0 + turned) / 3.0;
                    const double u = (i + third) / parts, v = (j + third) / parts;
                    Point place;
                    for (std::size_t axis = 0; axis < 3; ++axis)
                        place[axis] = a[axis] + u * (b[axis] - a[axis]) + v * (c[axis] - a[axis]);
                    guards.add(place, clearance * size);
                }
    }
    guards.sort();
    return guards;
}

} // namespace

std::vector<Point> interior_points(std::span<const Point> surface_points,
                                   std::span<const Triple> facets, LatticeSettings settings,
                                   const SizeGrid &asked) {
    const double h = settings.edge_length;
    const bool is_graded = settings.lattice == Lattice::body_centred;
    const double cube = is_graded ? h / body_centred_edge : h;
    CubeGrid grid{surface_points.front(), cube, {}};
    Point high = grid.low;
    for (const Point &p : surface_points)
        for (std::size_t i = 0; i < 3; ++i) {
            grid.low[i] = std::min(grid.low[i], p[i]);
            high[i] = std::max(high[i], p[i]);
        }
    for (std::size_t i = 0; i < 3; ++i) {
        const double count = std::ceil((high[i] - grid.low[i]) / cube);
        grid.count[i] = static_cast<Index>(count);
        // The lattice is centred on the box.
        grid.low[i] -= 0.5 * (count * cube - (high[i] - grid.low[i]));
    }
    // The paper's cubes are all alike, and know the surface by one distance.
    const std::vector<double> sizes = is_graded ? local_sizes(surface_points, facets, h)
                                                : std::vector<double>(surface_points.size(), h);
    std::vector<double> wanted(sizes);
    for (double &edge : wanted)
        edge /= is_graded ? body_centred_edge : 1.0;
    std::vector<Point> places(surface_points.begin(), surface_points.end());
    asked.visit([&](const Point &place, double size) {
        places.push_back(place);
        wanted.push_back(size / body_centred_edge);
    });
    const GradedLattice lattice(grid, places, wanted, surface_points.size(),
                                settings.grows_inwards ? for_growing : for_uniform);
    Guards guards = guard_surface(surface_points, facets, sizes, settings.clearance);
    const double mean =
        std::accumulate(sizes.begin(), sizes.end(), 0.0) / static_cast<double>(sizes.size());
    Columns columns(surface_points, facets, mean);
    Random random(settings.seed);
    std::vector<Point> points;
    lattice.visit(is_graded, [&](const Point &place, double edge) {
        Point p = place;
        for (double &x : p)
            x += settings.jitter * edge * random.next();
        if (columns.is_inside(p) && !guards.keep_off(p))
            points.push_back(p);
    });
    return points;
}

} // namespace fastsim
