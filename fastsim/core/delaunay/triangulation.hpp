#pragma once
// Delaunay tetrahedralisation of points by incremental insertion (Bowyer 1981, Watson 1981).
//
// A vertex at infinity closes the hull: every hull facet has a cell with it, so the result is
// exactly the convex hull of the points, with no corners of a far cube that spoil cells near it.
// Points on one sphere are told apart by a symbolic perturbation in the manner of Edelsbrunner
// and Muecke 1990: point i is lifted by an infinitesimal that grows with the turn at which it is
// inserted, faster than any power. The newest point is thus above every sphere it lies on, and a
// tie is never a conflict. The result is the lower hull of lifted points in general position, so
// no cell is flat, whatever the input. A point in the plane of a hull facet is judged by the cell
// behind that facet.
//
// Speed: points are copied in the order of insertion, so that neighbours in space are neighbours
// in memory. A cell stores its in-sphere determinant, expanded by the row of the point asked
// about: a test is one scalar product of four entries, with a bound for its rounding, and the
// exact predicate where that cannot tell (after the stored minors of Marot, Pellerin, Remacle
// 2019, "One machine, one minute, three billion tetrahedra").

#include "delaunay/directed_edges.hpp"
#include "mesher/watch.hpp"
#include "predicates/predicates.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

struct DelaunayCells {
    std::vector<std::array<std::int32_t, 4>> cells; // positive by the exact predicate
    // Cell beyond the facet opposite each corner, -1 at the hull; filled where it is asked for.
    std::vector<std::array<std::int32_t, 4>> neighbours;
    std::vector<std::int32_t> duplicates; // points left out: an equal one came first
    bool is_flat = false;                 // all points lie in one plane: no cells
};

class Triangulation {
  public:
    explicit Triangulation(std::span<const Point> points);

    /// Inserts all points in an order that keeps neighbours together; deterministic. Looks at the
    /// watch now and then.
    DelaunayCells build(Watch &watch, bool with_neighbours = false);

  private:
    using Index = std::int32_t;
    static constexpr Index infinite = 0; // given points are numbered from 1, by turn

    using Corners = std::array<Index, 4>; // infinity, where there is one, comes last
    // What a conflict test of a cell reads, in one cache line.
    struct alignas(64) Cell {
        // Twice the volume times (offset of the sphere's centre; one half): see fill().
        std::array<double, 3> normal;
        double lift;
        std::array<Index, 4> neighbour; // 4 * cell + facet seen from there
        Index origin;                   // the corner that offsets are taken from
        std::uint32_t mark;             // twice the insertion that saw the cell, + 1 in conflict
        float width;                    // largest offset of a corner along an axis, rounded up
    };
    struct alignas(32) Vertex {
        Point place;
        std::uint32_t stamp; // insertion that last met it
        std::uint32_t local; // its number in that cavity
    };
    // A corner of the cavity, seen from the point that is inserted.
    struct Spoke {
        Point offset;
        double squared;
        double reach;
    };
    struct Opening {
        Index outside;
        std::array<Index, 3> facet;
    };

    // A new cell, with the numbers of its three old corners in the cavity.
    struct Fresh {
        Index cell;
        std::uint32_t p, q, r;
    };

    [[nodiscard]] static std::size_t at(Index i) { return static_cast<std::size_t>(i); }
    [[nodiscard]] const Point &place(Index i) const { return _vertices[at(i)].place; }
    bool start(std::array<Index, 4> &first);
    Index locate(const Point &point);
    [[nodiscard]] bool is_in_conflict(Index c, const Point &point) const;
    [[nodiscard]] bool is_in_conflict_exactly(Index c, const Point &point) const;
    void dig(Index first, const Point &point);
    void fill(Index point);
    [[nodiscard]] Spoke spoke(Index vertex, const Point &centre) const;
    std::uint32_t local_number(Index vertex, const Point &centre);
    void set_sphere(Index c, const Spoke &p, const Spoke &q, const Spoke &r);
    void set_plane(Index c, const Spoke &p, const Spoke &q);
    Index new_cell();
    void collect(DelaunayCells &result, bool with_neighbours);
    void list_neighbours(std::vector<std::array<Index, 4>> &out);

    std::vector<std::int32_t> _order; // turn -> given number
    std::vector<Vertex> _vertices;
    std::vector<Corners> _corners;
    std::vector<Cell> _cells;
    std::vector<Index> _free_cells;
    std::vector<Index> _cavity;
    std::vector<Opening> _openings;
    std::vector<Spoke> _spokes;
    std::vector<Fresh> _fresh;
    DirectedEdges _sides;           // of the cavity's surface -> side of a new cell
    double _smallest_trusted = 0.0; // below this a determinant may have underflowed
    std::uint32_t _stamp = 0;
    Index _hint = 0;
};

} // namespace fastsim
