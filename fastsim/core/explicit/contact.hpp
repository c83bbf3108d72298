#pragma once
// Contact in an explicit run: rigid tools with their own motion, and the body with itself.

#include "contact/body_touch.hpp"
#include "explicit/facet_constraint.hpp"
#include "explicit/tool_touch.hpp"

#include <memory>
#include <optional>
#include <utility>

namespace fastsim {

/// Where a tool's path is at a time, and what drives the tool [N]. A row of numbers in Python.
struct ToolStep {
    Pose pose;
    double drive;
};
static_assert(sizeof(ToolStep) == 13 * sizeof(double));

/// What acts on a tool: force, moment about its origin, impulse since the last record; how far it
/// has slid along its direction, and the smallest gap. A row of numbers in Python.
struct ToolRecord {
    Point force, moment, impulse;
    double offset, gap;
};
static_assert(sizeof(ToolRecord) == 11 * sizeof(double));

template <typename Real> class RigidTools {
  public:
    explicit RigidTools(std::size_t num_threads) : _reactions(num_threads) {}

    /// A tool that touches some vertices, each with its stiffness k A [N/m] (penalty only).
    void add(const TouchSettings &settings, const PointRecords &records,
             std::span<const double> points, std::span<const Index> vertices,
             std::span<const double> stiffnesses);
    /// A tool with a penalty over facets (3 points each), each with k A [N/m].
    void add_over_facets(const TouchSettings &settings, const PointRecords &records,
                         std::span<const double> points, std::span<const Index> facets,
                         std::span<const double> stiffnesses);
    /// A tool with the constraint over facets, whose corners have constraints of some areas [m2].
    void add_constraint_over_facets(const TouchSettings &settings,
                                    FacetConstraint<Real> constraint);
    std::size_t size() const { return _tools.size(); }
    bool has_facets() const;
    bool has_constraints_over_facets() const;

    /// Each at the begin of its path, at rest.
    void reset();

    struct Touched {
        bool is_known; // no vertex is so deep, or so fast, that it may come out on the other side
        double given;  // magnitude of the work on the body, half behind and half ahead [J]
    };
    /// The tools' forces on facets, found by one thread; returns half of the work of the last ones.
    double touch_facets(std::span<const ToolStep> now, Motion<Real> &motion, Push<Real> &push);
    /// Puts the facets first that are in reach of a tool, finds the entries of their corners, and
    /// begins means of what is found in so many looks, of which each is `part`.
    void sort_by_distance(std::span<const ToolStep> now, const Motion<Real> &motion, double part,
                          std::vector<std::size_t> &near);
    /// Another of these looks, at the facets in reach.
    void touch_again(std::span<const ToolStep> now, double part, Motion<Real> &motion,
                     Push<Real> &push);
    /// The tools' forces on the vertices of a thread; those on facets are known.
    Touched touch(std::size_t thread, const Portion &portion, std::span<const ToolStep> now,
                  std::span<const ToolStep> next, Motion<Real> &motion, Push<Real> &push,
                  const Push<Real> &facets);
    /// The forces of constraints over facets, by one thread after all others are known.
    Touched constrain(std::span<const ToolStep> now, std::span<const ToolStep> next,
                      Motion<Real> &motion, Push<Real> &push);

    /// Once all threads have touched: what acts on each tool.
    void sum_reactions();
    /// The step of the tools, those that are driven by a force along their direction.
    void move(std::span<const ToolStep> now, const Motion<Real> &motion);
    /// Of the state last looked at; the impulses begin anew.
    std::vector<ToolRecord> take_records();

  private:
    struct Tool {
        TouchSettings settings;
        std::vector<TouchVertex> vertices; // ascending entries
        std::vector<TouchFacet> facets{};  // of a tool that touches these instead
        std::size_t num_near = 0;          // of these, with several classes of cells
        std::optional<FacetConstraint<Real>> constraint{};
        double offset = 0.0, increment = 0.0;
        Reaction reaction{}, on_facets{};
        Point impulse{};

        Pose at(const ToolStep &step) const;
        Pose after(const ToolStep &step) const;
        bool is_known(const Reaction &found) const;
    };
    std::vector<Tool> _tools;
    std::vector<std::vector<Reaction>> _reactions; // by thread, of each tool
};

/// Contact of the body with itself, or of its parts with each other; one thread does it.
template <typename Real> class SelfContact {
  public:
    /// Pre-condition: `touch` was made of the body's own points and cells.
    void set(std::unique_ptr<BodyTouch> touch, std::span<const double> points);
    bool is_empty() const { return !_touch; }

    /// Renews the push and takes it off the forces; returns the work of the last one.
    double add(const PointRecords &records, Motion<Real> &motion, Push<Real> &push);

    /// Vertices inside a cell, and the deepest [m].
    std::pair<std::size_t, double> overlap() const;

  private:
    std::unique_ptr<BodyTouch> _touch;
    std::vector<Position> _rest, _places; // in the caller's numbering
};

} // namespace fastsim
