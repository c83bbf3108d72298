#include "mesher/star.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

// Wider registers where the processor has them; contraction is off, so the results are the same.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) &&                             \
    !defined(__SANITIZE_ADDRESS__)
#define PALPATE_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define PALPATE_WIDE
#endif

namespace fastsim {

namespace {

/// Signed squares of the qualities of a block's cells: q |q|, which orders them alike without a
/// root. See cell_quality for the formula.
inline void rate_block(const Star::Block &f, const double *p, double altitude_weight,
                       double *rating) {
    for (std::size_t l = 0; l < Star::lanes; ++l) {
        const double ux = f.a[0][l] - p[0], uy = f.a[1][l] - p[1], uz = f.a[2][l] - p[2];
        const double vx = f.b[0][l] - p[0], vy = f.b[1][l] - p[1], vz = f.b[2][l] - p[2];
        const double wx = f.c[0][l] - p[0], wy = f.c[1][l] - p[1], wz = f.c[2][l] - p[2];
        const double ax = vy * wz - vz * wy, ay = vz * wx - vx * wz, az = vx * wy - vy * wx;
        const double bx = wy * uz - wz * uy, by = wz * ux - wx * uz, bz = wx * uy - wy * ux;
        const double cx = uy * vz - uz * vy, cy = uz * vx - ux * vz, cz = ux * vy - uy * vx;
        const double fa = ax * ax + ay * ay + az * az;
        const double fb = bx * bx + by * by + bz * bz;
        const double fc = cx * cx + cy * cy + cz * cz;
        const double fp = f.squared_area[l];
        const double volume = ux * ax + uy * ay + uz * az;
        const double pa = (ux * ux + uy * uy + uz * uz) * (fa * fp);
        const double pb = (vx * vx + vy * vy + vz * vz) * (fb * fp);
        const double pc = (wx * wx + wy * wy + wz * wz) * (fc * fp);
        const double ab = f.ab[l] * (fa * fb);
        const double bc = f.bc[l] * (fb * fc);
        const double ca = f.ca[l] * (fc * fa);
        const double smallest =
            std::min(std::min(std::min(pa, pb), std::min(pc, ab)), std::min(bc, ca));
        const double all = (fa * fb) * (fc * fp);
        const double squared = volume * std::abs(volume) * smallest;
        // A facet without area: as bad as a flat cell.
        const double by_angle = all > 0.0 ? squared / all : 0.0;
        const double largest = std::max(std::max(fa, fb), std::max(fc, fp));
        const double by_altitude = volume * std::abs(volume) * altitude_weight;
        // Compared without another division.
        rating[l] = by_altitude < by_angle * largest ? by_altitude / largest : by_angle;
    }
}

/// Smallest rating of the blocks, or some value not above `floor`; `culprit` is asked first, and
/// comes out as the block that went below.
PALPATE_WIDE double worst_rating(const Star::Block *blocks, std::size_t count, const double *p,
                                 double altitude_weight, double floor, std::size_t &culprit) {
    double result = std::numeric_limits<double>::infinity();
    Star::Lane rating;
    std::size_t block = culprit;
    for (std::size_t turn = 0; turn < count; ++turn) {
        rate_block(blocks[block], p, altitude_weight, rating.data());
        result = std::min(result,
                          std::min(std::min(rating[0], rating[1]), std::min(rating[2], rating[3])));
        if (!(result > floor)) {
            culprit = block;
            return result;
        }
        // The others in order.
        block = turn == 0 ? 0 : block + 1;
        if (block == culprit)
            ++block;
    }
    return result;
}

PALPATE_WIDE void rate_all(const Star::Block *blocks, std::size_t count, const double *p,
                           double altitude_weight, double *ratings) {
    for (std::size_t i = 0; i < count; ++i)
        rate_block(blocks[i], p, altitude_weight, ratings + i * Star::lanes);
}

double signed_root(double x) { return std::copysign(std::sqrt(std::abs(x)), x); }

} // namespace

void Star::clear(double scale, double altitude) {
    _blocks.clear();
    _size = 0;
    _culprit = 0;
    int exponent = 0;
    std::frexp(scale, &exponent);
    _unit = std::ldexp(1.0, -std::clamp(exponent, -1000, 1000));
    const double scaled = altitude * _unit;
    // Without altitudes the angle decides; finite, so that flat cells are still told apart.
    _altitude_weight = scaled > 0.0 ? std::min(1.0 / (scaled * scaled), 1e100) : 1e100;
}

void Star::add(const Point &a, const Point &b, const Point &c) {
    const std::size_t l = _size % lanes;
    const std::array<Point, 3> corners{a, b, c};
    Point ab, ac, bc;
    if (l == 0)
        _blocks.emplace_back();
    Block &block = _blocks.back();
    const std::size_t last = l == 0 ? lanes : l + 1; // a new block repeats its first facet
    for (std::size_t lane = l; lane < last; ++lane) {
        for (std::size_t i = 0; i < 3; ++i) {
            block.a[i][lane] = corners[0][i] * _unit;
            block.b[i][lane] = corners[1][i] * _unit;
            block.c[i][lane] = corners[2][i] * _unit;
            ab[i] = (b[i] - a[i]) * _unit;
            ac[i] = (c[i] - a[i]) * _unit;
            bc[i] = (c[i] - b[i]) * _unit;
        }
        const Point n{ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2],
                      ab[0] * ac[1] - ab[1] * ac[0]};
        block.squared_area[lane] = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        block.ab[lane] = ab[0] * ab[0] + ab[1] * ab[1] + ab[2] * ab[2];
        block.bc[lane] = bc[0] * bc[0] + bc[1] * bc[1] + bc[2] * bc[2];
        block.ca[lane] = ac[0] * ac[0] + ac[1] * ac[1] + ac[2] * ac[2];
    }
    ++_size;
}

double Star::worst(const Point &place, double floor) {
    const std::array<double, 3> p{place[0] * _unit, place[1] * _unit, place[2] * _unit};
    const double squared_floor = floor * std::abs(floor);
    return signed_root(worst_rating(_blocks.data(), _blocks.size(), p.data(), _altitude_weight,
                                    squared_floor, _culprit));
}

void Star::list_qualities(const Point &place, std::vector<double> &out) const {
    const std::array<double, 3> p{place[0] * _unit, place[1] * _unit, place[2] * _unit};
    out.resize(_blocks.size() * lanes);
    rate_all(_blocks.data(), _blocks.size(), p.data(), _altitude_weight, out.data());
    out.resize(_size);
    for (double &q : out)
        q = signed_root(q);
}

} // namespace fastsim
