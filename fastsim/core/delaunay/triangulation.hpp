#pragma once
// Delaunay tetrahedralisation of points by incremental insertion (Bowyer 1981, Watson 1981).
//
// A vertex at infinity closes the hull: every hull facet has a cell with it, so the result is
// exactly the convex hull of the points, with no corners of a far cube that spoil cells near it.
// Points on one sphere are told apart by a symbolic perturbation: point i is lifted by an
// infinitesimal that grows with i faster than any power, in the manner of Edelsbrunner and Muecke
// 1990. It is the lower hull of lifted points in general position, so no cell is flat, whatever
// the input. A point in the plane of a hull facet is judged by the cell behind that facet.

#include "mesher/predicates.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

struct DelaunayCells {
    std::vector<std::array<std::int32_t, 4>> cells; // positive by the exact predicate
    std::vector<std::int32_t> duplicates;           // points left out: an equal one came first
    bool is_flat = false;                           // all points lie in one plane: no cells
};

class Triangulation {
  public:
    explicit Triangulation(std::span<const Point> points) : _points(points) {}

    // Inserts points 0 to n - 1 in an order that keeps neighbours together; deterministic.
    DelaunayCells build();

  private:
    using Index = std::int32_t;
    static constexpr Index infinite = -1;
    // A cell with its neighbours. neighbour[k] = 4 * cell + facet seen from there.
    struct Cell {
        std::array<Index, 4> vertex;
        std::array<Index, 4> neighbour;
    };
    struct Opening {
        Index outside;
        std::array<Index, 3> facet;
    };
    struct EdgeSlot {
        std::uint64_t key;
        std::uint32_t stamp;
        Index side;
    };

    [[nodiscard]] const Point &at(Index i) const { return _points[static_cast<std::size_t>(i)]; }
    Cell &cell(Index i) { return _cells[static_cast<std::size_t>(i)]; }
    bool start(const std::vector<Index> &order, std::array<Index, 4> &first);
    Index locate(const Point &point);
    bool is_in_conflict(Index c, Index point);
    [[nodiscard]] int side_of_sphere(const std::array<Index, 4> &v, Index point) const;
    void dig(Index first, Index point);
    void fill(Index point);
    void join(Index a, Index b, Index side);
    Index new_cell();

    std::span<const Point> _points;
    std::vector<Cell> _cells;
    std::vector<std::uint32_t> _mark; // twice the insertion that saw the cell, + 1 in conflict
    std::vector<Index> _free_cells;
    std::vector<Index> _cavity;
    std::vector<Opening> _openings;
    std::vector<EdgeSlot> _edges;
    std::uint32_t _stamp = 0;
    Index _hint = 0;
};

// The facet that shows a triangulation is not Delaunay, if any: cell and facet, or cell -1.
struct DelaunayFault {
    std::int32_t cell = -1;
    std::int32_t facet = -1;
    std::int32_t point = -1;
};
DelaunayFault find_delaunay_fault(std::span<const Point> points,
                                  std::span<const std::array<std::int32_t, 4>> cells);

} // namespace fastsim
