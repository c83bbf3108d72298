#pragma once
// Forces between a rigid tool and the boundary vertices of a body in explicit motion.
//
//  penalty     f = k A max(0, -g) n, with the gap g where the vertex is
//  constraint  the force that puts the vertex onto the tool at the end of the step, where it would
//              end inside: with lumped mass a Lagrange multiplier for each vertex by itself
//              (Carpenter, Taylor and Katona 1991, "Lagrange constraints for transient finite
//              element surface contact": forward increments). It acts along the normal of a round
//              tool where the vertex is, as the step begins: along that where it would end it leans
//              with the slip, by v dt / r, and pushes it on, a damping of -f dt / r
//  facets      the penalty integrated over facets, f = k A w max(0, -g) n at each of their points;
//              see ContactRule of Python
//  friction    the force that stops the slip of the step ahead, at most mu times the normal force;
//              not of the penalty over facets
//
// Vertices are first held against the tool's box. Forces on the tool are minus the sums of those
// on the vertices, to the last bit.

#include "contact/box_faces.hpp"
#include "contact/tool_shape.hpp"
#include "explicit/motion.hpp"

#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace fastsim {

struct TouchSettings {
    ToolShape shape;
    bool is_constraint;
    double friction; // Coulomb's coefficient
    double reach;    // vertices so far outside may come in during a step [m]
    double deepest;  // beyond this depth the side is no longer known [m]
    Point direction; // of a tool driven by a force
    double mass;     // of that; 0 if the tool follows its path
};

struct TouchVertex {
    std::size_t entry; // of its record
    Point rest;
    double stiffness; // k A [N/m]
    WayIn way{};      // where it was beside the tool when last seen near it
};

struct TouchFacet {
    std::array<std::size_t, 3> entries; // of its corners' records
    std::array<Point, 3> rest;
    double stiffness;             // k A of the whole facet [N/m]
    std::array<WayIn, 12> ways{}; // of its points, beside a box
};

/// On the tool, about its origin; `gap` is the smallest met (with the constraint, where vertices
/// would have been), `fastest` the largest component of an increment.
struct Reaction {
    Point force{}, moment{};
    double gap = std::numeric_limits<double>::infinity();
    double fastest = 0.0;
};

/// Whether the middle of a triangle, in the tool's frame, is farther out than from its corners, and
/// by so much more: a distance changes by no more than the way.
bool is_clear(const ToolShape &shape, const std::array<Point, 3> &corner, double margin);

/// One vertex as the coming step would move it, in double precision whatever the body's.
struct Mover {
    Point place, increment, mobility;

    /// Where it is at the end of the step under a further force.
    Point after(const Point &force) const {
        Point at = place;
        for (std::size_t j = 0; j < 3; ++j)
            at[j] += increment[j] + mobility[j] * force[j];
        return at;
    }
};

template <typename Real>
Mover mover_of(const Motion<Real> &motion, std::size_t entry, const Point &place) {
    Mover mover{place, {}, {}};
    for (std::size_t j = 0; j < 3; ++j) {
        const std::size_t i = entry + j;
        mover.mobility[j] = static_cast<double>(motion.mobility[i]);
        mover.increment[j] = next_increment(
            static_cast<double>(motion.keep), static_cast<double>(motion.increment[i]),
            mover.mobility[j], static_cast<double>(motion.external[i] - motion.force[i]));
    }
    return mover;
}

/// The force on a vertex under another that stops its slip over the tool in the step ahead, across
/// a normal, at most so large [N].
Point friction_force(const Pose &now, const Pose &next, const Mover &mover, const Point &pushed,
                     const Point &normal, double most);

/// Takes the forces of a tool on some vertices off the body's, and adds them to the push; the
/// records of touched ones are added to those of the thread. Of vertices near the tool it notes
/// where they are beside it.
template <typename Real>
Reaction touch(const TouchSettings &tool, std::span<TouchVertex> vertices, const Pose &now,
               const Pose &next, Motion<Real> &motion, Push<Real> &push, std::size_t thread);

/// The same for the penalty over facets, from one thread; the records of their corners are added to
/// those that may be pushed.
template <typename Real>
Reaction touch_facets(const TouchSettings &tool, std::span<TouchFacet> facets, const Pose &now,
                      Motion<Real> &motion, Push<Real> &push);

} // namespace fastsim
