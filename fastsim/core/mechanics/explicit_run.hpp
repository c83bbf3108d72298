#pragma once
// Explicit central differences (eq. 11-13) with lumped M and D = mass_damping M, in increments:
//   d = a(t) - a(t-dt);  (1 + c) d_next = (1 - c) d + dt^2 M^-1 (s F - R(a)),  c = damping dt / 2
//   a_next = a + d_next.
// It is eq. 12 (as corrected, see central_difference.hpp) divided by M / dt^2; increments keep
// the digits that 2 a(t) - a(t-dt) loses in single precision.
//
//  1. points in reverse Cuthill-McKee order, cells by their first point, in batches
//  2. each thread adds the forces of its share of the batches into an array of its own
//  3. each thread updates its share of the points, summing the arrays in the order of threads,
//     so a run repeats bit for bit for a given number of threads and instruction set
//  4. every 16th step the kinetic energy is held against what loads and supports have given; the
//     state of the last good look is kept
//
// explicit_setup.cpp: what a run is made of; explicit_run.cpp: the steps; explicit_energy.cpp: 4,
// and the sums for the balance of energy; explicit_tools.cpp: rigid tools.

#include "contact/body_touch.hpp"
#include "contact/tool_touch.hpp"
#include "mechanics/step_kernel.hpp"
#include "mechanics/tet4.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <utility>
#include <vector>

namespace fastsim {

/// Allocator for vectors that are loaded whole.
template <typename T> struct Aligned {
    using value_type = T;
    Aligned() = default;
    template <typename U> Aligned(const Aligned<U> &) noexcept {}
    T *allocate(std::size_t n) {
        return static_cast<T *>(::operator new(n * sizeof(T), std::align_val_t{64}));
    }
    void deallocate(T *p, std::size_t) noexcept { ::operator delete(p, std::align_val_t{64}); }
    template <typename U> bool operator==(const Aligned<U> &) const noexcept { return true; }
};

template <typename T> using AlignedVector = std::vector<T, Aligned<T>>;

enum class StopReason { none, inverted_cell, out_of_bounds, energy_growth, deep_in_tool };

struct ExplicitOutcome {
    std::int64_t
        steps_done;     // good ones, in this call; -1 if the last state of the call before is bad
    StopReason reason;  // the state is then the last good one
    std::int64_t point; // that moved fastest when energy grew or bounds were left, else -1
};

/// Numbers of a tool in a row of poses: position, rotation row by row, drive [N]; and in a row of
/// reactions: force, moment about its origin, impulse since the last record, offset, gap.
inline constexpr std::size_t pose_size = 13, reaction_size = 11;

/// The steps of one call. A history is a factor over time; loads and supports name theirs.
struct ExplicitPlan {
    std::span<const double> factors; // (num_steps + 2) rows, one factor for each history
    std::size_t num_histories;
    std::int64_t num_steps;
    std::int64_t every;              // steps between records; > 0
    std::span<double> displacements; // num_steps / every records of 3 num_points
    std::span<double> energies;      // one record more, of kinetic energy, work, loss; if tracked
    std::span<const double> poses;   // (num_steps + 2) rows, pose_size for each tool
    std::span<double> reactions;     // one record more, reaction_size for each tool
};

struct ExplicitSettings {
    Lame lame;
    StrainMeasure strain;
    double time_step;
    double mass_damping;
    double displacement_limit;
    std::size_t num_threads;
    InstructionSet at_most;
    bool tracks_energy; // sums external work and damping loss, step by step, in double
};

/// A body in motion. Arrays in and out are in the caller's numbering, three numbers a point.
template <typename Real> class ExplicitRun {
  public:
    /// Pre-conditions: positive cells and masses; every point in a cell.
    ExplicitRun(std::span<const double> points, std::span<const Index> cells,
                std::span<const double> lumped_mass, std::span<const std::uint8_t> is_free,
                const ExplicitSettings &settings);

    /// Starts the sums afresh. `energy` is what the state holds already [J], for the watch.
    void set_state(std::span<const double> displacement, std::span<const double> increment,
                   double energy);
    void get_state(std::span<double> displacement, std::span<double> increment) const;

    /// Dead loads, one force array for each history.
    void set_dead_loads(std::span<const double> forces, std::size_t num_histories);

    /// Follower pressures on facets (3 points each) with their histories.
    void set_pressure(std::span<const Index> facets, std::span<const double> pressures,
                      std::span<const Index> histories);

    /// Held components that move: factor times value; history -1 for all others.
    void set_moving_supports(std::span<const double> values, std::span<const Index> histories);

    /// A rigid tool that touches some vertices, each with its stiffness k A [N/m] (penalty only).
    /// Pre-condition: `points` are those of the body at rest.
    void add_tool(const TouchSettings &settings, std::span<const double> points,
                  std::span<const Index> vertices, std::span<const double> stiffnesses);

    /// Contact of the body with itself, or of its parts with each other.
    /// Pre-condition: `touch` was made of the body's own points and cells.
    void set_body_touch(std::unique_ptr<BodyTouch> touch, std::span<const double> points);

    /// Of the last step looked at: vertices inside a cell, and the deepest [m].
    std::pair<std::size_t, double> body_touches() const;

    /// What tools and the body itself push with at the last state looked at.
    void get_contact_force(std::span<double> force) const;

    /// Changes D = mass_damping M from here on.
    void set_mass_damping(double mass_damping);

    /// The steps of a plan, or fewer if the run leaves its bounds.
    ExplicitOutcome advance(const ExplicitPlan &plan);

    /// R(a) as the kernel sees it, for comparison with the plain loop.
    void internal_force(std::span<double> force);

    const char *instruction_set() const { return _kernel.name; }

  private:
    struct MovingSupport {
        std::size_t entry; // in the records
        std::size_t history;
        double value, mass;
        double next = 0.0, pull = 0.0; // increment ahead [m], and what makes it so [N]
    };

    struct Tool {
        TouchSettings settings;
        std::vector<TouchVertex> vertices;    // ascending entries
        double offset = 0.0, increment = 0.0; // along the direction, if driven by a force
        Reaction reaction{};
        Point impulse{};
    };

    struct Share { // of one thread
        std::size_t first_batch, last_batch;
        std::size_t first_touched, last_touched; // points its cells touch
        std::size_t first_owned, last_owned;     // points it updates
        AlignedVector<Real> force;
        std::vector<MovingSupport> moving;
        // Sums for the balance of energy, halfway through a step and after it.
        double work = 0.0, loss = 0.0, work_halfway = 0.0, loss_halfway = 0.0;
        double kinetic = 0.0;
        // For the watch.
        double given = 0.0, pressure_work = 0.0;
        double watched_kinetic = 0.0, fastest = -1.0, furthest = 0.0;
        std::size_t fastest_point = 0;
        std::vector<std::size_t> touched; // first entries of the records tools push on
        std::vector<Reaction> reactions;  // of each tool
    };

    /// What a thread needs to know of the step it is in.
    struct Step {
        std::span<const double> now, next; // factors
        bool is_new_load;                  // a factor differs from the last step's
        bool is_jump;                      // by so much that its work must be counted apart
        std::span<const double> poses, next_poses;
    };

    /// Entries of the records: one point more than there are, for the corners of the cells that
    /// fill up the last batch, and then whole packs.
    std::size_t padded_size() const {
        return (4 * (_num_points + 1) + longest_pack - 1) / longest_pack * longest_pack;
    }

    void set_mobility();
    void lay_out_cells(std::span<const double> points, std::span<const Index> cells);
    void share_out();
    ForceJob<Real> job_of(Share &share) const;
    void add_pressure(std::span<const double> factors);
    void gather_forces(Share &share, const Step &step);
    bool update(Share &share);
    void pull_supports(Share &share, const Step &step);
    void move_supports(Share &share, const Step &step);
    std::pair<bool, bool> load_change(std::span<const double> before,
                                      std::span<const double> now) const;
    void combine_dead_loads(Share &share, std::span<const double> factors);
    void touch_body();
    void rest_tools();
    Pose pose_of(const Tool &tool, std::span<const double> row) const;
    bool touch_tools(Share &share, const Step &step);
    void sum_reactions();
    void record_tools(std::span<double> row);
    void move_tools(const Step &step);
    void record(const Share &share, std::span<double> displacement) const;

    void track(Share &share, bool completes_half, bool begins_half);
    void sum_energies(std::span<double> row) const;
    void close_window(Share &share);
    void watch(Share &share);
    bool is_growing() const;
    void keep_good(const Share &share);
    std::int64_t fastest_point() const;
    void go_back(StopReason reason, ExplicitOutcome &outcome);

    ExplicitSettings _settings;
    KernelChoice<Real> _kernel;
    std::size_t _num_points;
    std::vector<std::size_t> _record_of, _point_of; // new number of each point, and back
    std::vector<double> _mass;                      // by record
    std::vector<std::uint8_t> _is_free;             // by entry
    AlignedVector<Real> _displacement, _increment, _external, _mobility; // records of 4
    AlignedVector<std::int32_t> _records;
    AlignedVector<Real> _rest;
    std::vector<std::vector<double>> _dead_loads; // by history, records of 4
    std::vector<std::size_t> _loaded;             // histories with a dead load
    AlignedVector<Real> _points;
    std::vector<std::size_t> _pressed; // first entry of the records of each facet's corners
    std::vector<double> _pressures;
    std::vector<Index> _pressure_histories;
    AlignedVector<Real> _pressure_force;       // records of 4; empty without pressure
    std::vector<std::size_t> _pressed_entries; // those of it that can differ from zero
    std::vector<Tool> _tools;
    AlignedVector<Real> _contact_force; // records of 4; empty without tools
    std::unique_ptr<BodyTouch> _body_touch;
    std::vector<Position> _rest_places, _places; // in the caller's numbering
    AlignedVector<Real> _body_force;             // records of 4; empty without such contact
    std::vector<std::size_t> _body_entries;      // first ones of the records it pushes
    std::size_t _num_batches = 0;
    std::vector<Share> _shares;
    Real _keep, _limit;

    // State at the last good look, and at the last time the work of the loads was added up.
    AlignedVector<Real> _good_displacement, _good_increment, _worked_displacement;
    std::int64_t _steps_since_good = 0;
    double _energy_at_start = 0.0, _total_mass = 0.0;
    bool _has_begun = false;
};

} // namespace fastsim
