#pragma once
// The constraint of a rigid tool, averaged over facets, in explicit steps (ContactRule of Python).
//
// Gaps g of constraints are averages over the facets at their vertices. A step that would end at x*
// without the tool ends with the multipliers p [N] that leave no average inside:
//
//     p_i >= 0,   g_i(x*) + sum_j G_i W G_j^T p_j >= 0,   one of them 0 for every i,
//
// with the gradients G of the averages at x*, and the mobility W of the vertices [m/N]; the force
// on the body is G^T p. Of vertices alone, where no two constraints share one, it is the formula of
// Carpenter, Taylor and Katona 1991; neighbouring averages share vertices, and p is found together.
//
// Friction of at most mu p_i stops the average of the slip over the tool, with the same weights as
// the gap, across the average of the normals. The dual functions average positions over the facets
// at a vertex to its own, and spread a force on the average to it alone: so it is the slip of the
// vertex, once p acts, and the friction of neighbours is independent.

#include "condensed/complementarity.hpp"
#include "explicit/tool_touch.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

template <typename Real> class FacetConstraint {
  public:
    /// Corners of `facets` (3 each) with rest areas [m2], and the numbers of their constraints, -1
    /// for a corner without one; `areas` are of the constraints [m2].
    FacetConstraint(const PointRecords &records, std::span<const double> points,
                    std::span<const Index> facets, std::span<const double> facet_areas,
                    std::span<const Index> constraints, std::span<const double> areas);

    /// Takes the forces of the step ahead off the body's, and adds them to the push; from one
    /// thread, once all other forces are known. The records of pushed vertices are added to those
    /// of thread 0. `gap` is the smallest average, where it would have been.
    Reaction touch(const TouchSettings &tool, const Pose &now, const Pose &next,
                   Motion<Real> &motion, Push<Real> &push);
    /// Whether the last multipliers were found: no gradient depends on the others.
    bool is_solved() const { return _is_solved; }

  private:
    struct Vertex {
        std::size_t entry; // of its record
        Point rest;
        double edge = 0.0; // the longest at rest [m]
    };
    struct Corner {
        std::uint32_t vertex;
        std::int32_t constraint;
        double share; // A / (12 a) of the facet and the constraint
    };
    using Facet = std::array<Corner, 3>;
    struct Ahead { // of a vertex
        Point place{}, mobility{}, force{};
        bool is_known = false, is_near = false;
    };
    struct Part {
        std::uint32_t vertex;
        Point gradient;
    };
    struct Row { // of a constraint that may push
        std::uint32_t vertex;
        double gap = 0.0;
        std::vector<Part> parts{};
        bool is_active = false;
        double multiplier = 0.0;
    };

    bool look(const TouchSettings &tool, const Pose &now, const Pose &next,
              const Motion<Real> &motion, Reaction &reaction);
    const Ahead &ahead(std::uint32_t vertex, const Motion<Real> &motion);
    void average(const TouchSettings &tool, const Pose &next, const Motion<Real> &motion);
    void differentiate(const TouchSettings &tool, const Pose &next, const Motion<Real> &motion);
    std::array<Point, 3> places_of(const Facet &facet, const Pose &next,
                                   const Motion<Real> &motion);
    Row &row_of(const Corner &corner);
    void solve();
    void drag(const TouchSettings &tool, const Pose &now, const Pose &next,
              const Motion<Real> &motion);
    bool add_active();
    void act(const Pose &now, Motion<Real> &motion, Push<Real> &push, Reaction &reaction) const;

    std::vector<Vertex> _vertices;
    std::vector<Facet> _facets;
    double _margin = 0.0;              // beside the tool, for averages of what is near it [m]
    std::vector<Ahead> _ahead;         // by vertex
    std::vector<std::int32_t> _row_of; // by constraint
    std::vector<double> _averages;     // by constraint, of those near the tool [m]
    // Of this step: the constraints near the tool, their facets, and rows of those that may push.
    std::vector<std::int32_t> _averaged;
    std::vector<const Facet *> _near;
    std::vector<Row> _rows;
    std::vector<std::size_t> _active; // rows that may push
    std::vector<double> _matrix, _right, _found;
    Complementarity _complementarity;
    bool _is_solved = true;
};

} // namespace fastsim
