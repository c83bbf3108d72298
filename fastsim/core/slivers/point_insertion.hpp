#pragma once
// A new inner point where flips and moves do not help: most slivers left have all four corners on
// the surface, and nothing in them may move (after Klingner and Shewchuk 2007, Aggressive
// tetrahedral mesh improvement, vertex insertion).

#include "mesher/tet_complex.hpp"
#include "slivers/star.hpp"

#include <vector>

namespace fastsim {

class PointInsertion {
  public:
    explicit PointInsertion(TetComplex &complex) : _complex(complex) {}

    /// Replaces a bad cell and some around it by cells to a new point, placed to make the worst
    /// of them as good as can be; only when that beats the worst of the old ones. The point is
    /// always inside: the outer facets of the complex are kept. `quality` holds that of each
    /// living cell by its slot.
    bool insert_at(Index bad_cell, const std::vector<double> &quality);

    /// From now on: larger cavities, and a finer search for the place at every step.
    void be_thorough() { _is_thorough = true; }

  private:
    struct Wall {
        Triple facet;
        Index beyond;
    };

    Point &place() { return _complex.points[TetComplex::at(_point)]; }
    static Cell fresh_cell(const Triple &f, Index point) { return {f[1], f[0], f[2], point}; }
    bool attempt(const std::vector<Index> &seeds, const std::vector<double> &quality);
    void take_in(Index cell, const std::vector<double> &quality);
    bool holds(Index cell) const;
    void place_at_centre();
    void fill_star();
    double optimise(double first_step, double last_step);
    Index next_cell();
    bool is_valid() const;

    TetComplex &_complex;
    bool _is_thorough = false;
    Index _point = none; // a number that no cell uses yet
    double _before = 0.0;
    double _reach = 0.0;
    std::vector<Index> _cavity;
    std::vector<Wall> _walls;
    std::vector<Index> _ring_cells, _ring;
    std::vector<double> _qualities;
    std::vector<Cell> _fresh;
    Star _star;
};

} // namespace fastsim
