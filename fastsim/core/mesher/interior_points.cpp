#include "mesher/interior_points.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

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

/// Points in cubic bins, to find those near a place.
class Bins {
  public:
    Bins(std::vector<Point> points, double width) : _points(std::move(points)), _width(width) {
        for (std::size_t i = 0; i < _points.size(); ++i)
            _bins[key(_points[i])].push_back(i);
    }

    bool any_within(const Point &p, double distance) const {
        const auto middle = key(p);
        for (Index i = -1; i <= 1; ++i)
            for (Index j = -1; j <= 1; ++j)
                for (Index k = -1; k <= 1; ++k) {
                    const auto found = _bins.find({middle[0] + i, middle[1] + j, middle[2] + k});
                    if (found == _bins.end())
                        continue;
                    for (const std::size_t q : found->second) {
                        const double dx = _points[q][0] - p[0], dy = _points[q][1] - p[1],
                                     dz = _points[q][2] - p[2];
                        if (dx * dx + dy * dy + dz * dz < distance * distance)
                            return true;
                    }
                }
        return false;
    }

  private:
    Triple key(const Point &p) const {
        return {static_cast<Index>(std::floor(p[0] / _width)),
                static_cast<Index>(std::floor(p[1] / _width)),
                static_cast<Index>(std::floor(p[2] / _width))};
    }

    std::vector<Point> _points;
    double _width;
    std::unordered_map<Triple, std::vector<std::size_t>, TripleHash> _bins;
};

/// Crossings of the surface by the line through (x, y) along z, in order of height.
class Columns {
  public:
    Columns(std::span<const Point> points, std::span<const Triple> facets, double width)
        : _points(points), _facets(facets), _width(width) {
        for (std::size_t f = 0; f < facets.size(); ++f) {
            double low[2], high[2];
            for (std::size_t i = 0; i < 2; ++i) {
                low[i] = std::numeric_limits<double>::infinity();
                high[i] = -low[i];
                for (const Index v : facets[f]) {
                    low[i] = std::min(low[i], points[TetComplex::at(v)][i]);
                    high[i] = std::max(high[i], points[TetComplex::at(v)][i]);
                }
            }
            for (Index i = bin(low[0]); i <= bin(high[0]); ++i)
                for (Index j = bin(low[1]); j <= bin(high[1]); ++j)
                    _bins[edge(i, j)].push_back(f);
        }
    }

    /// Whether a point is inside, by the number of crossings above it. Rounding may err for a
    /// line through an edge: harmless, since the cells outside are carved off later.
    bool is_inside(const Point &p) const {
        const auto found = _bins.find(edge(bin(p[0]), bin(p[1])));
        if (found == _bins.end())
            return false;
        bool inside = false;
        for (const std::size_t f : found->second) {
            const Point &a = corner(f, 0), &b = corner(f, 1), &c = corner(f, 2);
            const double ab = cross(a, b, p), bc = cross(b, c, p), ca = cross(c, a, p);
            const bool is_hit = (ab > 0 && bc > 0 && ca > 0) || (ab < 0 && bc < 0 && ca < 0);
            if (!is_hit)
                continue;
            const double z = (bc * a[2] + ca * b[2] + ab * c[2]) / (ab + bc + ca);
            if (z > p[2])
                inside = !inside;
        }
        return inside;
    }

  private:
    Index bin(double x) const { return static_cast<Index>(std::floor(x / _width)); }
    static Triple edge(Index i, Index j) { return {i, j, 0}; }
    const Point &corner(std::size_t f, std::size_t k) const {
        return _points[TetComplex::at(_facets[f][k])];
    }
    static double cross(const Point &a, const Point &b, const Point &p) {
        return (a[0] - p[0]) * (b[1] - p[1]) - (a[1] - p[1]) * (b[0] - p[0]);
    }

    std::span<const Point> _points;
    std::span<const Triple> _facets;
    double _width;
    std::unordered_map<Triple, std::vector<std::size_t>, TripleHash> _bins;
};

} // namespace

std::vector<Point> interior_points(std::span<const Point> surface_points,
                                   std::span<const Triple> facets, LatticeSettings settings) {
    const double h = settings.edge_length;
    // Body-centred cells have edges a and sqrt(3)/2 a, 0.923 a in the mean.
    const double cube = settings.lattice == Lattice::body_centred ? h / 0.923 : h;
    Point low = surface_points.front(), high = low;
    for (const Point &p : surface_points)
        for (std::size_t i = 0; i < 3; ++i) {
            low[i] = std::min(low[i], p[i]);
            high[i] = std::max(high[i], p[i]);
        }
    std::vector<Point> guarded(surface_points.begin(), surface_points.end());
    for (const Triple &f : facets) {
        Point centroid{};
        for (const Index v : f)
            for (std::size_t i = 0; i < 3; ++i)
                centroid[i] += surface_points[TetComplex::at(v)][i] / 3.0;
        guarded.push_back(centroid);
    }
    const double clearance = settings.clearance * h;
    const Bins bins(std::move(guarded), std::max(clearance, 1e-300));
    const Columns columns(surface_points, facets, h);
    Random random(settings.seed);
    std::vector<Point> points;
    const int centres = settings.lattice == Lattice::body_centred ? 2 : 1;
    std::array<long, 3> count{};
    for (std::size_t i = 0; i < 3; ++i)
        count[i] = static_cast<long>(std::ceil((high[i] - low[i]) / cube));
    for (long i = 0; i <= count[0]; ++i)
        for (long j = 0; j <= count[1]; ++j)
            for (long k = 0; k <= count[2]; ++k)
                for (int centre = 0; centre < centres; ++centre) {
                    const std::array<double, 3> step{static_cast<double>(i), static_cast<double>(j),
                                                     static_cast<double>(k)};
                    Point p;
                    for (std::size_t axis = 0; axis < 3; ++axis) {
                        // The lattice is centred on the box.
                        const double slack =
                            static_cast<double>(count[axis]) * cube - (high[axis] - low[axis]);
                        p[axis] = low[axis] - 0.5 * slack + (step[axis] + 0.5 * centre) * cube +
                                  settings.jitter * h * random.next();
                    }
                    if (columns.is_inside(p) && !bins.any_within(p, clearance))
                        points.push_back(p);
                }
    return points;
}

} // namespace fastsim
