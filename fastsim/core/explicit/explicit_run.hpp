#pragma once
// An explicit run: the steps of eq. 12 (central_difference.hpp) with all that pushes.
//
//  1. each thread adds the internal forces of its batches of cells into an array of its own
//  2. one thread adds pressure and contact of the body with itself meanwhile
//  3. each thread sums the arrays for the points it owns, in the order of threads, so that a run
//     repeats bit for bit for a given number of threads and instruction set; then tools push them
//  4. each thread moves its points
//  5. every 16th step the kinetic energy is held against what loads and supports have given; the
//     state of the last good look is kept
//
// records.hpp: memory and threads; motion.hpp: the state; loads.hpp, contact.hpp: what pushes;
// energy.hpp: 5, and the balance of energy; cell_forces.hpp: 1 and 3, by internal_force.hpp;
// plan.hpp: what drives the steps; step_kernel.hpp: 1 and 4.

#include "contact/body_touch.hpp"
#include "explicit/energy.hpp"
#include "explicit/plan.hpp"
#include "explicit/step_kernel.hpp"
#include "mechanics/elastic_body.hpp"

#include <memory>

namespace fastsim {

enum class StopReason { none, inverted_cell, out_of_bounds, energy_growth, deep_in_tool };

struct ExplicitOutcome {
    std::int64_t steps_done; // good ones, in this call; -1 if the state it began with is bad
    StopReason reason;       // the state is then the last good one
    std::int64_t point;      // that moved fastest when energy grew or bounds were left, else -1
};

struct ExplicitSettings {
    CentralDifference scheme;
    double displacement_limit;
    std::size_t num_threads;
    InstructionSet at_most;
    double stiffness_damping;       // see central_difference.hpp [s]
    bool is_single;                 // precision of the step
    bool tracks_energy;             // sums external work and damping loss, step by step, in double
    std::span<const Index> classes; // of the cells, from 0; see multirate.hpp. Empty: one
};

/// A body in motion. Arrays in and out are in the caller's numbering, three numbers a point.
class ExplicitRun {
  public:
    /// Pre-conditions: positive cells and masses; every point in a cell.
    static std::unique_ptr<ExplicitRun> make(const ElasticBody &body,
                                             std::span<const double> lumped_mass,
                                             std::span<const std::uint8_t> is_free,
                                             const ExplicitSettings &settings);
    virtual ~ExplicitRun() = default;

    /// Starts the sums afresh. `energy` is what the state holds already [J], for the monitor.
    virtual void set_state(std::span<const double> displacement, std::span<const double> increment,
                           double energy) = 0;
    virtual void get_state(std::span<double> displacement, std::span<double> increment) const = 0;

    virtual void set_dead_load(std::size_t history, std::span<const double> forces) = 0;
    /// Follower pressures on facets (3 points each) with their histories.
    virtual void set_pressure(std::span<const double> points, std::span<const Index> facets,
                              std::span<const double> pressures,
                              std::span<const Index> histories) = 0;
    /// Springs over facets (3 points each) instead of those before: the stiffnesses [N/m]
    /// between their corners, 9 for each, and the first of four histories, those of the factor on
    /// the stiffness and of the anchor's displacement [m].
    virtual void set_springs(std::span<const Index> facets, std::span<const double> stiffnesses,
                             std::span<const Index> histories) = 0;
    /// Held components that move: a sum of factors times values, given as some terms for all
    /// points one after another; history -1 for all others.
    virtual void set_moving_supports(std::span<const double> values,
                                     std::span<const Index> histories) = 0;
    /// Points held along one or two orthonormal directions only, where factor times value is.
    virtual void set_sliding_supports(std::span<const Index> points,
                                      std::span<const double> directions,
                                      std::span<const double> values,
                                      std::span<const Index> histories) = 0;
    virtual void add_tool(const TouchSettings &settings, std::span<const double> points,
                          std::span<const Index> vertices, std::span<const double> stiffnesses) = 0;
    /// A tool with a penalty over facets (3 points each), each with k A [N/m].
    virtual void add_tool_over_facets(const TouchSettings &settings, std::span<const double> points,
                                      std::span<const Index> facets,
                                      std::span<const double> stiffnesses) = 0;
    /// A tool with the constraint over facets; see FacetConstraint.
    virtual void add_constraint_over_facets(const TouchSettings &settings,
                                            std::span<const double> points,
                                            std::span<const Index> facets,
                                            std::span<const double> facet_areas,
                                            std::span<const Index> constraints,
                                            std::span<const double> areas) = 0;
    virtual void set_self_contact(std::unique_ptr<BodyTouch> touch,
                                  std::span<const double> points) = 0;
    virtual void set_mass_damping(double mass_damping) = 0;

    /// The steps between the rows of a plan, or fewer if the run leaves its bounds.
    virtual ExplicitOutcome advance(const ExplicitPlan &plan) = 0;
    /// Finds all that pushes at the present state, as the next step does, which need not do it
    /// again: for records, energies, and to see a cell that the last step inverted.
    virtual ExplicitOutcome look(const ExplicitPlan &plan) = 0;

    // Of the last look; or of the state before the last step.
    virtual EnergyRecord energies() const = 0;
    virtual std::vector<ToolRecord> take_tool_records() = 0;
    /// Of tools, and of the body with itself.
    virtual void get_contact_force(std::span<double> force) const = 0;
    virtual std::pair<std::size_t, double> self_overlap() const = 0;

    /// What the next step takes for F - R(a), after a look: of several classes its mean force [N].
    virtual void get_net_force(std::span<double> force) const = 0;

    /// R(a) as the kernel sees it, for comparison with the plain loop.
    virtual void internal_force(std::span<double> force) = 0;
    virtual const char *instruction_set() const = 0;
};

} // namespace fastsim
