#pragma once
// Bodies that touch each other, or themselves: boundary vertices found inside cells are pushed out.
//
// How deep a place is inside is measured in the rest state (Hirota, Fisher, State, Lee and Fuchs
// 2001, "An implicit finite element method for elastic solids in contact": material depth): with
// weights w_a in the cell where vertex v is, the depth d is the distance of X = sum w_a X_a from
// the body's own surface at rest. Its gradient there is n, in space g = F^-T n, and the energy k A
// d^2 / 2 gives
//   f_v = -k A d g,   f_a = w_a k A d g at the cell's corners,
// whose sum and moment vanish.

#include "collision/vertices_in_cells.hpp"
#include "surface/closest_point.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

struct PointForce {
    std::int32_t point;
    Position force;
};

class BodyTouch {
  public:
    using Cell = std::array<std::int32_t, 4>;

    using Facet = std::array<std::int32_t, 3>;

    /// `parts`: which body each point is of, from 0. `facets`: the boundary at rest.
    /// `stiffnesses`: k A of each vertex [N/m].
    BodyTouch(std::span<const Position> rest, std::span<const Cell> cells,
              std::span<const std::int32_t> vertices, std::span<const Facet> facets,
              std::span<const std::int32_t> parts, std::span<const double> stiffnesses,
              InstructionSet at_most);

    /// Forces where the points are now, several for a point perhaps; valid until the next call.
    std::span<const PointForce> find_forces(std::span<const Position> points);

    /// Of the last call: vertices inside a cell, and the deepest [m].
    [[nodiscard]] std::size_t num_touching() const { return _num_touching; }
    [[nodiscard]] double deepest() const { return _deepest; }

  private:
    std::vector<Cell> _cells;
    VerticesInCells _detection;
    std::vector<Position> _rest;
    std::vector<std::int32_t> _part_of;     // by point
    std::vector<SurfaceDistance> _surfaces; // of each part
    std::vector<double> _stiffness_of;      // by point
    std::vector<PointForce> _forces;
    std::size_t _num_touching = 0;
    double _deepest = 0.0;
};

} // namespace fastsim
