#include "slivers/star.hpp"

#include "slivers/wide.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace fastsim {

namespace {

inline void load(const Star::Lane &from, Four &to) {
    static_assert(sizeof(Four) == sizeof(Star::Lane));
    std::memcpy(&to, from.data(), sizeof(Four));
}

/// The cells of a block's facets to a place.
struct CellsOfBlock {
    Four a, b, c;        // squared distances of the facets' corners from the place
    Four fa, fb, fc, fp; // four times the squared areas opposite the corners and the place
    Four ab, bc, ca;     // squared lengths of the facets' sides
    Four signed_square;  // of six volumes: with the sign of the volume

    inline __attribute__((always_inline)) CellsOfBlock(const Star::Block &f, const double *p) {
        Four ux, uy, uz, vx, vy, vz, wx, wy, wz;
        load(f.a[0], ux), load(f.a[1], uy), load(f.a[2], uz);
        load(f.b[0], vx), load(f.b[1], vy), load(f.b[2], vz);
        load(f.c[0], wx), load(f.c[1], wy), load(f.c[2], wz);
        load(f.squared_area, fp), load(f.ab, ab), load(f.bc, bc), load(f.ca, ca);
        ux -= p[0], uy -= p[1], uz -= p[2];
        vx -= p[0], vy -= p[1], vz -= p[2];
        wx -= p[0], wy -= p[1], wz -= p[2];
        const Four ax = vy * wz - vz * wy, ay = vz * wx - vx * wz, az = vx * wy - vy * wx;
        const Four bx = wy * uz - wz * uy, by = wz * ux - wx * uz, bz = wx * uy - wy * ux;
        const Four cx = uy * vz - uz * vy, cy = uz * vx - ux * vz, cz = ux * vy - uy * vx;
        fa = ax * ax + ay * ay + az * az;
        fb = bx * bx + by * by + bz * bz;
        fc = cx * cx + cy * cy + cz * cz;
        const Four volume = ux * ax + uy * ay + uz * az;
        signed_square = volume * (volume < 0.0 ? -volume : volume);
        a = ux * ux + uy * uy + uz * uz;
        b = vx * vx + vy * vy + vz * vz;
        c = wx * wx + wy * wy + wz * wz;
    }
};

/// Signed squares of qualities: q |q|, which orders them alike without a root. See cell_quality for
/// the formula. Without branches.
struct ByQuality {
    double altitude_weight;

    inline __attribute__((always_inline)) void operator()(const CellsOfBlock &s,
                                                          double *rating) const {
        Four smallest = s.a * (s.fa * s.fp);
        Four largest = s.fa > s.fb ? s.fa : s.fb;
        const auto lower = [&](const Four &x) { smallest = x < smallest ? x : smallest; };
        lower(s.b * (s.fb * s.fp));
        lower(s.c * (s.fc * s.fp));
        lower(s.ab * (s.fa * s.fb));
        lower(s.bc * (s.fb * s.fc));
        lower(s.ca * (s.fc * s.fa));
        largest = largest > s.fc ? largest : s.fc;
        largest = largest > s.fp ? largest : s.fp;
        // A facet without area is as bad as a flat cell: the product in place of 0 / 0 is 0.
        Four all = (s.fa * s.fb) * (s.fc * s.fp);
        all = all > 0.0 ? all : all + 1.0;
        const Four by_angle = s.signed_square * (smallest / all);
        const Four by_altitude =
            s.signed_square * (altitude_weight / (largest > 0.0 ? largest : largest + 1.0));
        const Four result = by_altitude < by_angle ? by_altitude : by_angle;
        std::memcpy(rating, &result, sizeof(Four));
    }
};

/// Signed squares of time steps; see cell_step.
struct ByStep {
    inline __attribute__((always_inline)) void operator()(const CellsOfBlock &s,
                                                          double *rating) const {
        Four all = (s.fa + s.fb) + (s.fc + s.fp);
        all = all > 0.0 ? all : all + 1.0;
        const Four result = s.signed_square / all;
        std::memcpy(rating, &result, sizeof(Four));
    }
};

/// Smallest rating of the blocks, or some value not above `floor`; `culprit` is asked first, and
/// comes out as the block that went below.
template <typename Rate>
inline __attribute__((always_inline)) double
find_worst(const Star::Block *blocks, std::size_t count, const double *p, const Rate &rate,
           double floor, std::size_t &culprit) {
    double result = std::numeric_limits<double>::infinity();
    alignas(32) Star::Lane rating;
    std::size_t block = culprit;
    for (std::size_t turn = 0; turn < count; ++turn) {
        rate(CellsOfBlock(blocks[block], p), rating.data());
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

// A copy of each for every width of registers.
PALPATE_WIDE double worst_quality(const Star::Block *blocks, std::size_t count, const double *p,
                                  ByQuality rate, double floor, std::size_t &culprit) {
    return find_worst(blocks, count, p, rate, floor, culprit);
}
PALPATE_WIDE double worst_step(const Star::Block *blocks, std::size_t count, const double *p,
                               double floor, std::size_t &culprit) {
    return find_worst(blocks, count, p, ByStep{}, floor, culprit);
}
PALPATE_WIDE void rate_all(const Star::Block *blocks, std::size_t count, const double *p,
                           ByQuality rate, double *ratings) {
    for (std::size_t i = 0; i < count; ++i)
        rate(CellsOfBlock(blocks[i], p), ratings + i * Star::lanes);
}

double signed_root(double x) { return std::copysign(std::sqrt(std::abs(x)), x); }

} // namespace

void Star::clear(double scale, double altitude) {
    _blocks.clear();
    _size = 0;
    int exponent = 0;
    std::frexp(scale, &exponent);
    _unit = std::ldexp(1.0, -std::clamp(exponent, -1000, 1000));
    const double scaled = altitude * _unit;
    // Without altitudes the angle decides; finite, so that flat cells are still told apart.
    _altitude_weight = scaled > 0.0 ? std::min(1.0 / (scaled * scaled), 1e100) : 1e100;
}

void Star::add(const Point &a, const Point &b, const Point &c) {
    const std::size_t first = _size % lanes;
    if (first == 0)
        _blocks.emplace_back();
    Block &block = _blocks.back();
    Point ab, ac, bc;
    for (std::size_t i = 0; i < 3; ++i) {
        ab[i] = (b[i] - a[i]) * _unit;
        ac[i] = (c[i] - a[i]) * _unit;
        bc[i] = (c[i] - b[i]) * _unit;
    }
    const Point n{ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2],
                  ab[0] * ac[1] - ab[1] * ac[0]};
    const auto put = [&](Lane &lane, double x) {
        if (first == 0)
            lane.fill(x); // a new block repeats its first facet
        else
            lane[first] = x;
    };
    for (std::size_t i = 0; i < 3; ++i) {
        put(block.a[i], a[i] * _unit);
        put(block.b[i], b[i] * _unit);
        put(block.c[i], c[i] * _unit);
    }
    put(block.squared_area, n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    put(block.ab, ab[0] * ab[0] + ab[1] * ab[1] + ab[2] * ab[2]);
    put(block.bc, bc[0] * bc[0] + bc[1] * bc[1] + bc[2] * bc[2]);
    put(block.ca, ac[0] * ac[0] + ac[1] * ac[1] + ac[2] * ac[2]);
    ++_size;
}

double Star::worst(const Point &place, double floor, std::size_t &culprit) const {
    const std::array<double, 3> p{place[0] * _unit, place[1] * _unit, place[2] * _unit};
    const double squared_floor = floor * std::abs(floor);
    const double rating = worst_quality(_blocks.data(), _blocks.size(), p.data(),
                                        {_altitude_weight}, squared_floor, culprit);
    return rating > squared_floor ? signed_root(rating) : floor;
}

double Star::shortest_step(const Point &place, double floor, std::size_t &culprit) const {
    const std::array<double, 3> p{place[0] * _unit, place[1] * _unit, place[2] * _unit};
    const double scaled = floor * _unit, squared_floor = scaled * std::abs(scaled);
    const double rating =
        worst_step(_blocks.data(), _blocks.size(), p.data(), squared_floor, culprit);
    return rating > squared_floor ? signed_root(rating) / _unit : floor;
}

void Star::list_qualities(const Point &place, std::vector<double> &out) const {
    const std::array<double, 3> p{place[0] * _unit, place[1] * _unit, place[2] * _unit};
    out.resize(_blocks.size() * lanes);
    rate_all(_blocks.data(), _blocks.size(), p.data(), {_altitude_weight}, out.data());
    out.resize(_size);
    for (double &q : out)
        q = signed_root(q);
}

} // namespace fastsim
