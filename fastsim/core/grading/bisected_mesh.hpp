#pragma once
// Local refinement of tetrahedra by bisection, conforming and with finitely many shapes: the marked
// tetrahedra of Arnold, Mukherjee and Pouly 2000 ("Locally adapted tetrahedral meshes using
// bisection", SIAM J. Sci. Comput. 22). On Kuhn's six tetrahedra of a cube this is Maubach's, and
// Hebert's symbolic, bisection (see symbolic_cube.hpp).

#include "grading/edge_table.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

class BisectedMesh {
  public:
    using Index = std::int32_t;
    using Cell = std::array<Index, 4>;
    using Point = std::array<double, 3>;

    // Pre-condition: a conforming mesh of positive cells. `facet_tags` holds a number >= 0 for
    // facets to be followed (opposite each corner), else -1.
    BisectedMesh(std::span<const Point> points, std::span<const Cell> cells,
                 std::span<const Cell> facet_tags);

    // Bisects the marked cells (in the order of `cells()`), and others until no point hangs.
    void refine(std::span<const std::uint8_t> marked);

    // The mesh as it is: cells in the order of the given ones, each with its descendants.
    struct Leaves {
        std::vector<Cell> cells;
        std::vector<Cell> facet_tags;
        std::vector<Index> given_cell; // in which each lies
        std::vector<Index> generation; // bisections since
    };
    [[nodiscard]] Leaves leaves() const;
    [[nodiscard]] std::span<const Point> points() const { return _points; }
    // Ends of the edge in whose middle each point was made; -1, -1 for given ones.
    [[nodiscard]] std::span<const std::array<Index, 2>> point_parents() const { return _parents; }

  private:
    // Corners 0 and 1 span the refinement edge. The facet of corner s in {0, 1} without the other
    // has its own marked edge: (s, 2), (s, 3) or (2, 3), coded 0, 1, 2.
    struct Node {
        Cell corner;
        Cell facet_tag;
        Index parent = -1;
        Index child = -1; // the first of two; -1 for a leaf
        std::uint16_t generation = 0;
        std::uint8_t marked[2]{0, 0};
        bool is_flagged = false;  // second planar generation
        bool is_mirrored = false; // corners in this order are a negative cell
    };
    static std::size_t at(Index i) { return static_cast<std::size_t>(i); }
    static bool is_planar(const Node &n) { return n.marked[0] == n.marked[1] && n.marked[0] < 2; }

    Node marked_root(const Cell &cell, const Cell &tags) const;
    void bisect(Index node);
    [[nodiscard]] bool has_cut_edge(const Cell &corner) const;
    std::vector<Index> leaf_numbers() const;

    std::vector<Point> _points;
    std::vector<std::array<Index, 2>> _parents;
    std::vector<Cell> _given;
    std::vector<Node> _nodes; // the given cells first
    EdgeTable _middles;
    // By point: the sweep in which an edge at it was last cut.
    std::vector<std::uint32_t> _cut_in_sweep;
    std::uint32_t _sweep = 0, _first_sweep = 0;
};

} // namespace fastsim
