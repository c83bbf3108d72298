#pragma once
// The surface in bins: what lies over a place, and what keeps others away from there.

#include "mesher/tet_complex.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <unordered_map>
#include <vector>

namespace fastsim {

/// Number of a bin; those beyond a milliard share the last one, where all are looked at.
inline Index bin_of(double x, double width) {
    return static_cast<Index>(std::clamp(std::floor(x / width), -1e9, 1e9));
}

/// Rows of bins along z, by the bins of x and y. Places are asked about one after the other along
/// z, so that the row last met is mostly the next.
template <typename Row> class Rows {
  public:
    Row &make(Index i, Index j) { return _rows[key(i, j)]; }
    const Row *find(Index i, Index j) const {
        const auto found = _rows.find(key(i, j));
        return found == _rows.end() ? nullptr : &found->second;
    }
    template <typename Change> void for_each(const Change &change) {
        for (auto &[key, row] : _rows)
            change(row);
    }

  private:
    static std::uint64_t key(Index i, Index j) {
        return std::uint64_t{static_cast<std::uint32_t>(i)} << 32 | static_cast<std::uint32_t>(j);
    }

    std::unordered_map<std::uint64_t, Row, EdgeHash> _rows;
};

/// Places with a distance that others keep from them, in cubic bins; one set of bins for each
/// octave of distances, so that few share a bin.
class Guards {
  public:
    void add(const Point &place, double distance) {
        if (!(distance > 0.0))
            return;
        const double width = std::exp2(std::ceil(std::log2(distance)));
        auto layer = std::find_if(_layers.begin(), _layers.end(),
                                  [&](const Layer &l) { return l.width == width; });
        if (layer == _layers.end())
            layer = _layers.emplace(_layers.end(), width);
        const Triple bin = layer->bin(place);
        layer->rows.make(bin[0], bin[1]).push_back({place, distance * distance, bin[2]});
    }

    /// After the last is added, and before the first question.
    void sort() {
        for (Layer &layer : _layers)
            layer.rows.for_each([](std::vector<Guard> &row) {
                std::sort(row.begin(), row.end(),
                          [](const Guard &x, const Guard &y) { return x.height < y.height; });
            });
    }

    bool keep_off(const Point &p) {
        return std::any_of(_layers.begin(), _layers.end(),
                           [&](Layer &layer) { return layer.keeps_off(p); });
    }

  private:
    struct Guard {
        Point place;
        double squared_distance;
        Index height; // its bin along z
    };
    struct Layer {
        explicit Layer(double bin_width) : width(bin_width) {}

        double width;
        Rows<std::vector<Guard>> rows;
        // Rows around the column last asked about, and where in each the last question began.
        struct Near {
            const std::vector<Guard> *row;
            std::size_t first;
        };
        std::array<Near, 9> near{};
        std::array<Index, 2> column{};
        bool has_column = false;

        Triple bin(const Point &p) const {
            return {bin_of(p[0], width), bin_of(p[1], width), bin_of(p[2], width)};
        }

        static Near begin(const std::vector<Guard> *row, Index height) {
            if (row == nullptr)
                return {nullptr, 0};
            const auto first =
                std::lower_bound(row->begin(), row->end(), height - 1,
                                 [](const Guard &x, Index least) { return x.height < least; });
            return {row, static_cast<std::size_t>(first - row->begin())};
        }

        bool keeps_off(const Point &p) {
            const Triple middle = bin(p);
            if (!has_column || column[0] != middle[0] || column[1] != middle[1]) {
                column = {middle[0], middle[1]};
                has_column = true;
                for (Index n = 0; n < 9; ++n)
                    near[TetComplex::at(n)] =
                        begin(rows.find(middle[0] + n / 3 - 1, middle[1] + n % 3 - 1), middle[2]);
            }
            for (auto &[found, first] : near) {
                if (found == nullptr)
                    continue;
                // Places rise along a column: mostly no guard lies between one and the next.
                const std::vector<Guard> &row = *found;
                while (first > 0 && row[first - 1].height >= middle[2] - 1)
                    --first;
                while (first < row.size() && row[first].height < middle[2] - 1)
                    ++first;
                for (std::size_t k = first; k < row.size() && row[k].height <= middle[2] + 1; ++k) {
                    const double dx = row[k].place[0] - p[0], dy = row[k].place[1] - p[1],
                                 dz = row[k].place[2] - p[2];
                    if (dx * dx + dy * dy + dz * dz < row[k].squared_distance)
                        return true;
                }
            }
            return false;
        }
    };

    std::vector<Layer> _layers;
};

/// Facets over or under one another, seen along z.
class Column {
  public:
    void add(const Point &a, const Point &b, const Point &c) {
        const std::size_t lane = _count % lanes;
        if (lane == 0)
            _blocks.emplace_back(); // of zeros: the line meets no such facet
        Block &block = _blocks.back();
        const std::array<const Point *, 3> corners{&a, &b, &c};
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t i = 0; i < 3; ++i)
                block.corner[k][i][lane] = (*corners[k])[i];
        block.highest = std::max({block.highest, a[2], b[2], c[2]});
        ++_count;
    }

    /// Whether a point is inside, by the number of crossings above it.
    bool has_odd_above(const Point &p) const {
        bool is_odd = false;
        for (const Block &block : _blocks) {
            if (!(block.highest > p[2]))
                continue;
            const auto &[a, b, c] = block.corner;
            std::array<double, lanes> ab, bc, ca;
            for (std::size_t l = 0; l < lanes; ++l) {
                ab[l] = cross(a[0][l] - p[0], a[1][l] - p[1], b[0][l] - p[0], b[1][l] - p[1]);
                bc[l] = cross(b[0][l] - p[0], b[1][l] - p[1], c[0][l] - p[0], c[1][l] - p[1]);
                ca[l] = cross(c[0][l] - p[0], c[1][l] - p[1], a[0][l] - p[0], a[1][l] - p[1]);
            }
            for (std::size_t l = 0; l < lanes; ++l) {
                const bool is_hit =
                    (ab[l] > 0 && bc[l] > 0 && ca[l] > 0) || (ab[l] < 0 && bc[l] < 0 && ca[l] < 0);
                if (!is_hit)
                    continue;
                const double z =
                    (bc[l] * a[2][l] + ca[l] * b[2][l] + ab[l] * c[2][l]) / (ab[l] + bc[l] + ca[l]);
                if (z > p[2])
                    is_odd = !is_odd;
            }
        }
        return is_odd;
    }

  private:
    static constexpr std::size_t lanes = 4;
    struct Block {
        std::array<std::array<std::array<double, lanes>, 3>, 3> corner{}; // by axis, by facet
        double highest = -std::numeric_limits<double>::infinity();
    };

    static double cross(double ux, double uy, double vx, double vy) { return ux * vy - uy * vx; }

    std::vector<Block> _blocks;
    std::size_t _count = 0;
};

/// The surface by columns of bins.
class Columns {
  public:
    Columns(std::span<const Point> points, std::span<const Triple> facets, double width)
        : _width(width) {
        for (const Triple &f : facets) {
            const Point &a = points[TetComplex::at(f[0])], &b = points[TetComplex::at(f[1])],
                        &c = points[TetComplex::at(f[2])];
            std::array<Index, 2> first, last;
            for (std::size_t i = 0; i < 2; ++i) {
                first[i] = bin_of(std::min({a[i], b[i], c[i]}), width);
                last[i] = bin_of(std::max({a[i], b[i], c[i]}), width);
            }
            for (Index i = first[0]; i <= last[0]; ++i)
                for (Index j = first[1]; j <= last[1]; ++j)
                    _columns.make(i, j).add(a, b, c);
        }
    }

    /// Rounding may err for a line through an edge: harmless, since the cells outside are carved
    /// off later.
    bool is_inside(const Point &p) {
        const std::array<Index, 2> at{bin_of(p[0], _width), bin_of(p[1], _width)};
        if (!_has_met || at != _met) {
            _met = at;
            _has_met = true;
            _here = _columns.find(at[0], at[1]);
        }
        return _here != nullptr && _here->has_odd_above(p);
    }

  private:
    double _width;
    Rows<Column> _columns;
    std::array<Index, 2> _met{};
    bool _has_met = false;
    const Column *_here = nullptr;
};

} // namespace fastsim
