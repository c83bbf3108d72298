#pragma once
// The cells between one point that may move and the facets around it: what smoothing and the
// insertion of a point ask about many places of the point.

#include "mesher/tet_complex.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace fastsim {

class Star {
  public:
    /// Forgets all facets. `scale` is a length of the star's size; it keeps products in range.
    /// `altitude` is that of a cell rated 1, or 0 where altitudes do not count.
    void clear(double scale, double altitude);
    /// A facet; with the point behind it, seen counter-clockwise from beyond, its cell is positive.
    void add(const Point &a, const Point &b, const Point &c);
    void add(const TetComplex &complex, const Triple &facet) {
        const auto at = [&](std::size_t k) -> const Point & {
            return complex.points[TetComplex::at(facet[k])];
        };
        add(at(0), at(1), at(2));
    }
    std::size_t size() const { return _size; }

    /// Worst quality (as cell_quality) with the point at a place; some value not above `floor` as
    /// soon as that is certain. Block number `culprit` is asked first, and comes out as the one
    /// that spoiled the place: mostly it spoils the next one in that direction.
    double worst(const Point &place, double floor, std::size_t &culprit) const;
    double worst(const Point &place, double floor) const {
        std::size_t first = 0;
        return worst(place, floor, first);
    }
    /// The same of the shortest step, as cell_step.
    double shortest_step(const Point &place, double floor, std::size_t &culprit) const;
    /// Quality of each cell, in the order of `add`.
    void list_qualities(const Point &place, std::vector<double> &out) const;

    static constexpr std::size_t lanes = 4;
    using Lane = std::array<double, lanes>;
    // Four facets, entry by entry, so that the compiler computes them at once.
    struct Block {
        std::array<Lane, 3> a, b, c;
        Lane squared_area; // four times the square
        Lane ab, bc, ca;   // squared lengths
    };

  private:
    std::vector<Block> _blocks;
    std::size_t _size = 0;
    double _altitude_weight = 0.0; // 1 / altitude^2
    double _unit = 1.0;            // power of two: scaling rounds nothing
};

} // namespace fastsim
