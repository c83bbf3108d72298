#include "predicates/predicates.hpp"

#include "predicates/double_double.hpp"
#include "predicates/exact_integer.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>

namespace fastsim {

namespace {

constexpr double half_ulp = std::numeric_limits<double>::epsilon() / 2.0; // 2^-53
constexpr double orient_bound = (7.0 + 56.0 * half_ulp) * half_ulp;
constexpr double sphere_bound = (16.0 + 224.0 * half_ulp) * half_ulp;
// Below this a product may have underflowed, and the bounds do not hold.
constexpr double smallest_safe = 1e-250;

using Vector = std::array<ExactInteger, 3>;

int common_exponent(std::initializer_list<const Point *> points) {
    int lowest = std::numeric_limits<int>::max();
    for (const Point *point : points)
        for (const double x : *point)
            if (x != 0.0)
                lowest = std::min(lowest, ExactInteger::lowest_exponent(x));
    return lowest == std::numeric_limits<int>::max() ? 0 : lowest;
}

Vector exact_difference(const Point &a, const Point &b, int exponent) {
    Vector difference;
    for (std::size_t i = 0; i < 3; ++i)
        difference[i] =
            ExactInteger::from_double(a[i], exponent) - ExactInteger::from_double(b[i], exponent);
    return difference;
}

ExactInteger determinant(const Vector &u, const Vector &v, const Vector &w) {
    return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
           u[2] * (v[0] * w[1] - v[1] * w[0]);
}

ExactInteger squared_length(const Vector &u) { return u[0] * u[0] + u[1] * u[1] + u[2] * u[2]; }

int exact_orient3d(const Point &a, const Point &b, const Point &c, const Point &d) {
    const int exponent = common_exponent({&a, &b, &c, &d});
    return determinant(exact_difference(b, a, exponent), exact_difference(c, a, exponent),
                       exact_difference(d, a, exponent))
        .sign();
}

int exact_in_sphere(const Point &a, const Point &b, const Point &c, const Point &d,
                    const Point &e) {
    const int exponent = common_exponent({&a, &b, &c, &d, &e});
    const Vector p = exact_difference(a, e, exponent), q = exact_difference(b, e, exponent),
                 r = exact_difference(c, e, exponent), s = exact_difference(d, e, exponent);
    const ExactInteger sum =
        squared_length(p) * determinant(q, r, s) - squared_length(q) * determinant(p, r, s) +
        squared_length(r) * determinant(p, q, s) - squared_length(s) * determinant(p, q, r);
    return sum.sign();
}

// Second stage, for points on a grid: offsets that are small whole numbers of one unit.
// 19 bits keep a determinant of degree 3 in 64 bits, and one of degree 5 in 128.
constexpr int most_bits = 19;

#ifdef __SIZEOF_INT128__
__extension__ using Wide = __int128;
#endif

/// Writes offsets from the last point as small whole numbers; false when they are not.
template <std::size_t n>
bool small_offsets(const std::array<const Point *, n> &points,
                   std::array<std::array<std::int64_t, 3>, n - 1> &out) {
    std::array<Point, n - 1> offsets;
    int lowest = std::numeric_limits<int>::max(), highest = std::numeric_limits<int>::min();
    const Point &from = *points[n - 1];
    for (std::size_t k = 0; k + 1 < n; ++k)
        for (std::size_t i = 0; i < 3; ++i) {
            const DoubleDouble x = exact_sum((*points[k])[i], -from[i]);
            if (x.low != 0.0 || !std::isfinite(x.high))
                return false;
            offsets[k][i] = x.high;
            if (x.high == 0.0)
                continue;
            const auto pattern = std::bit_cast<std::uint64_t>(x.high);
            const int exponent = static_cast<int>((pattern >> 52) & 0x7ff);
            if (exponent == 0)
                return false;
            const std::uint64_t mantissa = (pattern & 0xfffffffffffffull) | (1ull << 52);
            lowest = std::min(lowest, exponent + std::countr_zero(mantissa) - 52);
            highest = std::max(highest, exponent);
        }
    if (lowest > highest || highest - lowest >= most_bits || lowest <= 1 || lowest >= 2000)
        return false; // all zero, or not small, or the unit's inverse is no double
    // 2^(1023 - lowest), by its bits.
    const auto unit = std::bit_cast<double>(static_cast<std::uint64_t>(2046 - lowest) << 52);
    for (std::size_t k = 0; k + 1 < n; ++k)
        for (std::size_t i = 0; i < 3; ++i)
            out[k][i] = static_cast<std::int64_t>(offsets[k][i] * unit);
    return true;
}

using Small = std::array<std::int64_t, 3>;

std::int64_t determinant(const Small &u, const Small &v, const Small &w) {
    return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
           u[2] * (v[0] * w[1] - v[1] * w[0]);
}

std::int64_t squared_length(const Small &u) { return u[0] * u[0] + u[1] * u[1] + u[2] * u[2]; }

template <typename T> int sign_of(T x) { return (x > 0) - (x < 0); }

// Third stage, for points near a sphere: the same sum with 106 bits. The longest chain has eight
// roundings of at most 7 u^2; underflow stays below the bound where offsets are moderate.
constexpr double wide_bound = 200.0 * half_ulp * half_ulp;
constexpr double largest_moderate = 1e50;
constexpr double smallest_moderate = 1e-100;

using WideVector = std::array<DoubleDouble, 3>;

WideVector wide_offset(const Point &a, const Point &e) {
    return {exact_sum(a[0], -e[0]), exact_sum(a[1], -e[1]), exact_sum(a[2], -e[2])};
}

DoubleDouble determinant(const WideVector &u, const WideVector &v, const WideVector &w) {
    return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
           u[2] * (v[0] * w[1] - v[1] * w[0]);
}

DoubleDouble squared_length(const WideVector &u) { return u[0] * u[0] + u[1] * u[1] + u[2] * u[2]; }

/// Sign of the in-sphere determinant, 0 when 106 bits cannot tell.
int wide_in_sphere(const Point &a, const Point &b, const Point &c, const Point &d, const Point &e,
                   double permanent) {
    const WideVector p = wide_offset(a, e), q = wide_offset(b, e), r = wide_offset(c, e),
                     s = wide_offset(d, e);
    for (const WideVector &offset : {p, q, r, s})
        for (const DoubleDouble &x : offset)
            if (!(std::abs(x.high) < largest_moderate))
                return 0;
    if (!(permanent > smallest_moderate))
        return 0;
    const DoubleDouble sum =
        squared_length(p) * determinant(q, r, s) - squared_length(q) * determinant(p, r, s) +
        squared_length(r) * determinant(p, q, s) - squared_length(s) * determinant(p, q, r);
    return std::abs(sum.high) > wide_bound * permanent ? sign_of(sum.high) : 0;
}

} // namespace

int orient3d(const Point &a, const Point &b, const Point &c, const Point &d) {
    const double bx = b[0] - a[0], by = b[1] - a[1], bz = b[2] - a[2];
    const double cx = c[0] - a[0], cy = c[1] - a[1], cz = c[2] - a[2];
    const double dx = d[0] - a[0], dy = d[1] - a[1], dz = d[2] - a[2];
    const double cydz = cy * dz, czdy = cz * dy, czdx = cz * dx;
    const double cxdz = cx * dz, cxdy = cx * dy, cydx = cy * dx;
    const double det = bx * (cydz - czdy) + by * (czdx - cxdz) + bz * (cxdy - cydx);
    const double permanent = std::abs(bx) * (std::abs(cydz) + std::abs(czdy)) +
                             std::abs(by) * (std::abs(czdx) + std::abs(cxdz)) +
                             std::abs(bz) * (std::abs(cxdy) + std::abs(cydx));
    const double bound = orient_bound * permanent;
    if (permanent > smallest_safe && (det > bound || -det > bound))
        return det > 0.0 ? 1 : -1;
    // A plane across an axis, of which drawn bodies have many; differences are 0 only of equals.
    if ((bx == 0.0 && cx == 0.0 && dx == 0.0) || (by == 0.0 && cy == 0.0 && dy == 0.0) ||
        (bz == 0.0 && cz == 0.0 && dz == 0.0))
        return 0;
    std::array<Small, 3> small;
    if (small_offsets<4>({&b, &c, &d, &a}, small))
        return sign_of(determinant(small[0], small[1], small[2]));
    return exact_orient3d(a, b, c, d);
}

int in_sphere(const Point &a, const Point &b, const Point &c, const Point &d, const Point &e) {
    const double ax = a[0] - e[0], ay = a[1] - e[1], az = a[2] - e[2];
    const double bx = b[0] - e[0], by = b[1] - e[1], bz = b[2] - e[2];
    const double cx = c[0] - e[0], cy = c[1] - e[1], cz = c[2] - e[2];
    const double dx = d[0] - e[0], dy = d[1] - e[1], dz = d[2] - e[2];
    const double axby = ax * by, bxay = bx * ay, bxcy = bx * cy, cxby = cx * by;
    const double cxdy = cx * dy, dxcy = dx * cy, dxay = dx * ay, axdy = ax * dy;
    const double axcy = ax * cy, cxay = cx * ay, bxdy = bx * dy, dxby = dx * by;
    const double ab = axby - bxay, bc = bxcy - cxby, cd = cxdy - dxcy;
    const double da = dxay - axdy, ac = axcy - cxay, bd = bxdy - dxby;
    const double abc = az * bc - bz * ac + cz * ab;
    const double bcd = bz * cd - cz * bd + dz * bc;
    const double cda = cz * da + dz * ac + az * cd;
    const double dab = dz * ab + az * bd + bz * da;
    const double a2 = ax * ax + ay * ay + az * az, b2 = bx * bx + by * by + bz * bz;
    const double c2 = cx * cx + cy * cy + cz * cz, d2 = dx * dx + dy * dy + dz * dz;
    // det of rows (x, y, z, x^2 + y^2 + z^2), expanded by the last column.
    const double det = (a2 * bcd - b2 * cda) + (c2 * dab - d2 * abc);
    const double za = std::abs(az), zb = std::abs(bz), zc = std::abs(cz), zd = std::abs(dz);
    const double nab = std::abs(axby) + std::abs(bxay), nbc = std::abs(bxcy) + std::abs(cxby);
    const double ncd = std::abs(cxdy) + std::abs(dxcy), nda = std::abs(dxay) + std::abs(axdy);
    const double nac = std::abs(axcy) + std::abs(cxay), nbd = std::abs(bxdy) + std::abs(dxby);
    const double permanent =
        (ncd * zb + nbd * zc + nbc * zd) * a2 + (nda * zc + nac * zd + ncd * za) * b2 +
        (nab * zd + nbd * za + nda * zb) * c2 + (nbc * za + nac * zb + nab * zc) * d2;
    const double bound = sphere_bound * permanent;
    if (permanent > smallest_safe && (det > bound || -det > bound))
        return det > 0.0 ? 1 : -1;
#ifdef __SIZEOF_INT128__
    std::array<Small, 4> small;
    if (small_offsets<5>({&a, &b, &c, &d, &e}, small)) {
        const auto &[p, q, r, s] = small;
        const auto term = [](std::int64_t square, std::int64_t volume) {
            return static_cast<Wide>(square) * volume;
        };
        return sign_of(term(squared_length(p), determinant(q, r, s)) -
                       term(squared_length(q), determinant(p, r, s)) +
                       term(squared_length(r), determinant(p, q, s)) -
                       term(squared_length(s), determinant(p, q, r)));
    }
#endif
    if (const int sign = wide_in_sphere(a, b, c, d, e, permanent))
        return sign;
    return exact_in_sphere(a, b, c, d, e);
}

} // namespace fastsim
