#pragma once
// Energy of an explicit run: the sums for its balance, and the monitor of its growth.

#include "explicit/loads.hpp"

namespace fastsim {

struct EnergyRecord {
    double kinetic = 0.0, external_work = 0.0, damping_loss = 0.0; // [J]
};

/// Kinetic energy, work of all loads and loss by damping, summed step by step in double.
///
/// Along an increment d the work of a force f is the mean of f at both ends times d: half of it is
/// added when f is known at the far end, the other half when the next increment is. The loss,
/// damping m v^2 with the central velocity v = (d + d_next) / (2 dt), likewise; and by stiffness
/// damping, the work against its forces.
template <typename Real> class EnergyBalance {
  public:
    void reset(std::size_t num_threads, const Motion<Real> &motion) {
        _sums.assign(num_threads, {});
        _viscous_behind.assign(motion.viscous.size(), Real(0));
    }

    /// Where all that pushes is known: completes the step behind, and begins the one ahead if one
    /// is made.
    void add(std::size_t thread, const Portion &portion, const Motion<Real> &motion,
             const Pushes<Real> &pushes, const MovingSupports<Real> &supports,
             const SlidingSupports<Real> &slides, bool begins);

    /// At the last state where `add` was called.
    EnergyRecord total() const;

  private:
    struct alignas(64) Sums { // of one thread
        EnergyRecord halfway;
        double work = 0.0, loss = 0.0;
        bool is_begun = false;
    };
    std::vector<Sums> _sums;
    AlignedVector<Real> _viscous_behind; // at the other end of the increment
};

/// Holds the kinetic energy against what loads and supports have given, now and then, and keeps
/// the state of the last look at which it was in order.
template <typename Real> class EnergyMonitor {
  public:
    /// `energy` is what the state holds already [J].
    void reset(std::size_t num_threads, const Motion<Real> &motion, double energy);

    /// Counts work of a thread's own points by its magnitude: what goes in and comes out again has
    /// the scheme's error both times.
    void give(std::size_t thread, double work);
    /// The same for work found while other threads may still be reading what was given.
    void give_later(double work);
    /// Counts the work of the dead loads since the last time; before they jump, and at every look.
    void count_dead_loads(std::size_t thread, const Portion &portion, const Motion<Real> &motion);

    void look(std::size_t thread, const Portion &portion, const Motion<Real> &motion);
    /// Once every thread has looked: has energy come from nothing?
    bool is_growing(const Motion<Real> &motion) const;
    void keep(const Portion &portion, const Motion<Real> &motion);
    void restore(Motion<Real> &motion) const;
    /// Of the last look: the record of the point that moves fastest.
    std::size_t fastest_record() const;

  private:
    struct alignas(64) Sums { // of one thread
        double given = 0.0, later = 0.0;
        double kinetic = 0.0, fastest = -1.0, furthest = 0.0;
        std::size_t fastest_record = 0;
    };
    std::vector<Sums> _sums;
    AlignedVector<Real> _displacement, _increment; // of the last look in order
    AlignedVector<Real> _counted;                  // displacement when dead loads were counted
    double _energy_at_start = 0.0, _total_mass = 0.0;
};

} // namespace fastsim
