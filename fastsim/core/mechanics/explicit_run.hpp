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

#include "mechanics/step_kernel.hpp"
#include "mechanics/tet4.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
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

enum class StopReason { none, inverted_cell, out_of_bounds };

struct ExplicitOutcome {
    std::int64_t steps_done;
    StopReason reason; // the state is then the last good one
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

    void set_state(std::span<const double> displacement, std::span<const double> increment);
    void get_state(std::span<double> displacement, std::span<double> increment) const;
    /// Dead load F, scaled at each step by an amplitude.
    void set_external_force(std::span<const double> force);

    /// Follower pressures on facets (3 points each), scaled by the same amplitude; energy
    /// tracking does not count their work.
    void set_pressure(std::span<const Index> facets, std::span<const double> pressures);

    /// Work of the dead load and loss by damping since the start [J], if tracked:
    /// sum of s F . (d + d_next) / 2, and of dt damping m |(d + d_next) / (2 dt)|^2.
    double external_work() const;
    double damping_loss() const;

    /// One step for each amplitude, or fewer if the run leaves its bounds.
    ExplicitOutcome advance(std::span<const double> amplitudes);

    /// R(a) as the kernel sees it, for comparison with the plain loop.
    void internal_force(std::span<double> force);

    const char *instruction_set() const { return _kernel.name; }

  private:
    struct Share { // of one thread
        std::size_t first_batch, last_batch;
        std::size_t first_touched, last_touched; // points its cells touch
        std::size_t first_owned, last_owned;     // points it updates
        AlignedVector<Real> force;
        double work = 0.0, loss = 0.0;
    };

    void lay_out_cells(std::span<const double> points, std::span<const Index> cells);
    void share_out();
    ForceJob<Real> job_of(Share &share) const;
    bool update(std::size_t thread, Real amplitude);
    void track(std::size_t thread, Real amplitude);
    void add_pressure(Real amplitude);

    ExplicitSettings _settings;
    KernelChoice<Real> _kernel;
    std::size_t _num_points;
    std::vector<std::size_t> _record_of;                                 // new number of each point
    AlignedVector<Real> _displacement, _increment, _external, _mobility; // records of 4
    AlignedVector<std::int32_t> _records;
    AlignedVector<Real> _rest;
    std::vector<double> _mass; // by record
    AlignedVector<Real> _points;
    std::vector<std::size_t> _pressed; // first entry of the records of each facet's corners
    std::vector<Real> _pressures;
    std::size_t _num_batches = 0;
    std::vector<Share> _shares;
    Real _keep, _limit;
};

} // namespace fastsim
