#include "slivers/cell_quality.hpp"

#include "predicates/length.hpp"
#include "slivers/cell_step.hpp"
#include "slivers/wide.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

namespace fastsim {

namespace {

// Wanted altitude in parts of the thinnest facet's, and of the mean edge: a regular cell has 0.82.
constexpr double share_of_thinnest = 0.85, share_of_edge = 0.4;

constexpr std::size_t lanes = 4;

// One formula for single cells and for four at once; those are handed over by reference, since
// what returns them depends on the width of registers.
template <typename T> inline __attribute__((always_inline)) void lower(T &a, const T &b) {
    a = b < a ? b : a;
}
template <typename T> inline __attribute__((always_inline)) void raise(T &a, const T &b) {
    a = a < b ? b : a;
}
inline __attribute__((always_inline)) void take_root(double &x) { x = std::sqrt(x); }
inline __attribute__((always_inline)) void take_root(Four &x) {
    std::array<double, lanes> each;
    std::memcpy(each.data(), &x, sizeof x);
    for (double &r : each)
        r = std::sqrt(r);
    std::memcpy(&x, each.data(), sizeof x);
}

/// Of corner i the coordinate j is x[i][j].
template <typename T> struct CellShape {
    T six_volumes;
    T ab, ac, ad, bc, bd, cd; // squared lengths
    T fa, fb, fc, fd;         // four times the squared areas of the facets opposite a, b, c, d

    inline __attribute__((always_inline)) explicit CellShape(const T (&x)[4][3]) {
        T u[3], v[3], w[3], bcv[3], bdv[3], cdv[3];
        for (std::size_t j = 0; j < 3; ++j) {
            u[j] = x[1][j] - x[0][j];
            v[j] = x[2][j] - x[0][j];
            w[j] = x[3][j] - x[0][j];
            bcv[j] = x[2][j] - x[1][j];
            bdv[j] = x[3][j] - x[1][j];
            cdv[j] = x[3][j] - x[2][j];
        }
        T normal_d[3], normal_b[3], normal[3];
        cross(u, v, normal_d);
        cross(v, w, normal_b);
        dot(normal_d, w, six_volumes);
        dot(u, u, ab), dot(v, v, ac), dot(w, w, ad);
        dot(bcv, bcv, bc), dot(bdv, bdv, bd), dot(cdv, cdv, cd);
        cross(bcv, bdv, normal);
        dot(normal, normal, fa);
        dot(normal_b, normal_b, fb);
        cross(u, w, normal);
        dot(normal, normal, fc);
        dot(normal_d, normal_d, fd);
    }

    // sin(dihedral at an edge) = 6 V |edge| / (2 A_i 2 A_j), facets i and j opposite the other
    // edge's ends; squared, and over one denominator, so that one root and one division do.
    inline __attribute__((always_inline)) void find_fraction(T &smallest, T &all) const {
        const T fab = fa * fb, fcd = fc * fd;
        smallest = ab * fab;
        lower<T>(smallest, ac * (fa * fc));
        lower<T>(smallest, ad * (fa * fd));
        lower<T>(smallest, bc * (fb * fc));
        lower<T>(smallest, bd * (fb * fd));
        lower<T>(smallest, cd * fcd);
        all = fab * fcd;
    }

    inline __attribute__((always_inline)) void find_smallest_sine(T &sine) const {
        T smallest, all;
        find_fraction(smallest, all);
        sine = smallest / all;
        take_root(sine);
        sine = six_volumes * sine;
    }

    inline __attribute__((always_inline)) void lower_by_altitude(T &quality,
                                                                 double wanted_altitude) const {
        // 3 V over the largest area.
        T largest = fa;
        raise<T>(largest, fb);
        raise<T>(largest, fc);
        raise<T>(largest, fd);
        take_root(largest);
        const T altitude = six_volumes / largest;
        lower<T>(quality, quality_at_wanted_altitude * altitude / wanted_altitude);
    }

    // As cell_step.
    inline __attribute__((always_inline)) void find_step(T &step) const {
        T sum = (fa + fb) + (fc + fd);
        take_root(sum);
        step = six_volumes / sum;
    }

    // Not below 0 where the longest edge is `ratio` times as long as the shortest, or longer.
    inline __attribute__((always_inline)) void find_excess(T &excess, double squared_ratio) const {
        T shortest = ab, longest = ab;
        lower<T>(shortest, ac), raise<T>(longest, ac);
        lower<T>(shortest, ad), raise<T>(longest, ad);
        lower<T>(shortest, bc), raise<T>(longest, bc);
        lower<T>(shortest, bd), raise<T>(longest, bd);
        lower<T>(shortest, cd), raise<T>(longest, cd);
        excess = longest - squared_ratio * shortest;
    }

  private:
    static inline __attribute__((always_inline)) void cross(const T *a, const T *b, T *out) {
        out[0] = a[1] * b[2] - a[2] * b[1];
        out[1] = a[2] * b[0] - a[0] * b[2];
        out[2] = a[0] * b[1] - a[1] * b[0];
    }
    static inline __attribute__((always_inline)) void dot(const T *a, const T *b, T &out) {
        out = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    }
};

std::array<double, 6> squared_edges(const TetComplex &complex, Index c) {
    const Cell &v = complex.cell(c);
    std::array<double, 6> squared;
    std::size_t edge = 0;
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j) {
            const Point &a = complex.points[TetComplex::at(v[i])];
            const Point &b = complex.points[TetComplex::at(v[j])];
            const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
            squared[edge++] = x * x + y * y + z * z;
        }
    return squared;
}

bool is_told(double sine) { return sine != 0.0 && std::isfinite(sine); }

/// Four cells, corner by corner and axis by axis.
PALPATE_WIDE void rate_four(const std::array<double, lanes> (&corners)[4][3],
                            double wanted_altitude, double squared_ratio, double *sines,
                            double *qualities, double *steps, double *excesses) {
    Four x[4][3];
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            std::memcpy(&x[i][j], corners[i][j].data(), sizeof(Four));
    const CellShape<Four> shape(x);
    Four quality;
    shape.find_smallest_sine(quality);
    std::memcpy(sines, &quality, sizeof quality);
    if (wanted_altitude > 0.0)
        shape.lower_by_altitude(quality, wanted_altitude);
    std::memcpy(qualities, &quality, sizeof quality);
    Four step;
    shape.find_step(step);
    std::memcpy(steps, &step, sizeof step);
    Four excess;
    shape.find_excess(excess, squared_ratio);
    std::memcpy(excesses, &excess, sizeof excess);
}

inline __attribute__((always_inline)) CellShape<double> shape_of(const TetComplex &complex,
                                                                 const Cell &cell) {
    double x[4][3];
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            x[i][j] = complex.points[TetComplex::at(cell[i])][j];
    return CellShape<double>(x);
}

inline __attribute__((always_inline)) double rate(const CellShape<double> &s,
                                                  double wanted_altitude) {
    double quality = 0.0;
    s.find_smallest_sine(quality);
    if (is_told(quality)) {
        if (wanted_altitude > 0.0)
            s.lower_by_altitude(quality, wanted_altitude);
        return quality;
    }
    // Lengths so small or large that products of areas leave the range, or a facet without area:
    // such a cell is as bad as a flat one.
    const double each =
        std::min({s.ab / (s.fc * s.fd), s.ac / (s.fb * s.fd), s.ad / (s.fb * s.fc),
                  s.bc / (s.fa * s.fd), s.bd / (s.fa * s.fc), s.cd / (s.fa * s.fb)});
    return std::isfinite(each) ? s.six_volumes * std::sqrt(each) : 0.0;
}

// A deviation is at most half the range, so at most (longest / shortest - 1) / 2 of the mean.
double squared_ratio_of(double limit) { return (1.0 + 1.99 * limit) * (1.0 + 1.99 * limit); }

/// Four cells at most.
void rate_few(const TetComplex &complex, std::span<const Index> cells, double wanted_altitude,
              CellRatings &ratings) {
    std::array<double, lanes> corners[4][3];
    std::array<double, lanes> sines, qualities, steps, excesses;
    for (std::size_t l = 0; l < lanes; ++l) {
        // What is no cell is rated as another, and that is not looked at.
        const Cell &cell = complex.cell(cells[std::min(l, cells.size() - 1)]);
        for (std::size_t i = 0; i < 4; ++i) {
            const Point &p = complex.points[TetComplex::at(std::max(cell[i], Index{0}))];
            for (std::size_t j = 0; j < 3; ++j)
                corners[i][j][l] = p[j];
        }
    }
    rate_four(corners, wanted_altitude, squared_ratio_of(largest_deviation), sines.data(),
              qualities.data(), steps.data(), excesses.data());
    for (std::size_t l = 0; l < cells.size(); ++l) {
        const std::size_t slot = TetComplex::at(cells[l]);
        if (!is_told(sines[l]) && complex.is_alive(cells[l])) {
            sines[l] = qualities[l] = rate(shape_of(complex, complex.cell(cells[l])), 0.0);
            steps[l] = cell_step(complex, complex.cell(cells[l]));
        }
        ratings.sines[slot] = sines[l];
        ratings.qualities[slot] = qualities[l];
        ratings.steps[slot] = steps[l];
        ratings.is_uneven[slot] = excesses[l] >= 0.0 ? 1 : 0;
    }
}

// Products of areas and volumes that are as far from the ends of the range; and the part of a floor
// that hides no rounding.
constexpr double smallest_safe = 1e-280, part_of_floor = 0.999999;

} // namespace

double cell_quality(const TetComplex &complex, const Cell &cell) {
    return rate(shape_of(complex, cell), complex.wanted_altitude);
}

double cell_quality_above(const TetComplex &complex, const Cell &cell, double floor) {
    const CellShape<double> s = shape_of(complex, cell);
    if (s.six_volumes <= 0.0)
        return 0.0;
    // By squares: no root, and no division.
    double smallest = 0.0, all = 0.0;
    s.find_fraction(smallest, all);
    const double product = s.six_volumes * s.six_volumes * smallest;
    const double wanted = part_of_floor * floor * floor * all;
    if (product > smallest_safe && product < wanted && wanted < 1.0 / smallest_safe)
        return 0.0;
    return rate(s, complex.wanted_altitude);
}

CellRatings rate_all_cells(const TetComplex &complex, double wanted_altitude) {
    const std::size_t count = complex.num_slots();
    CellRatings ratings{std::vector<double>(count), std::vector<double>(count),
                        std::vector<double>(count), std::vector<char>(count)};
    for (std::size_t first = 0; first < count; first += lanes) {
        std::array<Index, lanes> slots{};
        const std::size_t size = std::min(lanes, count - first);
        for (std::size_t l = 0; l < size; ++l)
            slots[l] = static_cast<Index>(first + l);
        rate_few(complex, std::span(slots).first(size), wanted_altitude, ratings);
    }
    return ratings;
}

void rate_cells(const TetComplex &complex, std::span<const Index> cells, CellRatings &ratings) {
    ratings.sines.resize(complex.num_slots());
    ratings.qualities.resize(complex.num_slots());
    ratings.steps.resize(complex.num_slots());
    ratings.is_uneven.resize(complex.num_slots());
    for (std::size_t first = 0; first < cells.size(); first += lanes)
        rate_few(complex, cells.subspan(first, std::min(lanes, cells.size() - first)),
                 complex.wanted_altitude, ratings);
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
                const double length = length_of(e[0], e[1], e[2]);
                longest = std::max(longest, length);
                sum += length;
                count += 1.0;
            }
            const auto &[u, v] = edges;
            const double area = length_of(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                                          u[0] * v[1] - u[1] * v[0]);
            thinnest = std::min(thinnest, area / longest);
        }
    }
    return count > 0.0 ? std::min(share_of_thinnest * thinnest, share_of_edge * sum / count) : 0.0;
}

double edge_length_deviation(const TetComplex &complex, Index c) {
    const std::array<double, 6> squared = squared_edges(complex, c);
    double sum = 0.0, squares = 0.0;
    for (const double x : squared) {
        squares += x;
        sum += std::sqrt(x);
    }
    const double mean = sum / 6.0;
    return std::sqrt(std::max(squares / 6.0 - mean * mean, 0.0)) / mean;
}

bool is_edge_length_deviation_above(const TetComplex &complex, Index c, double limit) {
    // Most cells are told by the longest and the shortest edge, without a root.
    const std::array<double, 6> squared = squared_edges(complex, c);
    const auto [shortest, longest] = std::minmax_element(squared.begin(), squared.end());
    return *longest >= squared_ratio_of(limit) * *shortest &&
           edge_length_deviation(complex, c) > limit;
}

} // namespace fastsim
