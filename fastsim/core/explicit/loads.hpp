#pragma once
// What drives an explicit run: dead loads, follower pressures and supports that move. A history is
// a factor over time; loads and supports name theirs.

#include "explicit/motion.hpp"

namespace fastsim {

/// One force array for each history.
template <typename Real> class DeadLoads {
  public:
    void set(const PointRecords &records, std::size_t history, std::span<const double> forces);

    /// Sets the external forces of a thread's points.
    void combine(const Portion &portion, std::span<const double> factors,
                 Motion<Real> &motion) const;

    struct Change {
        bool is_new;  // a factor differs from the last step's
        bool is_jump; // by so much that its work must be counted apart
    };
    Change change(std::span<const double> before, std::span<const double> now) const;

  private:
    std::vector<std::vector<double>> _forces; // by history, in records
    std::vector<std::size_t> _loaded;         // histories with a force
};

/// Pressures that stay normal to their facets as those move.
template <typename Real> class FollowerPressure {
  public:
    void set(const PointRecords &records, std::span<const double> points,
             std::span<const Index> facets, std::span<const double> pressures,
             std::span<const Index> histories, Push<Real> &push);
    bool is_empty() const { return _pressures.empty(); }

    /// Renews the push and takes it off the forces; returns the work of the last one.
    double add(std::span<const double> factors, Motion<Real> &motion, Push<Real> &push) const;

  private:
    AlignedVector<Real> _points;       // at rest
    std::vector<std::size_t> _corners; // first entries, three for each facet
    std::vector<double> _pressures;
    std::vector<Index> _histories;
};

/// Held components that move: factor times value.
template <typename Real> class MovingSupports {
  public:
    struct Support {
        std::size_t entry, history;
        double value, mass;
        double next = 0.0, pull = 0.0; // increment ahead [m], and what makes it so [N]
    };

    explicit MovingSupports(std::size_t num_threads) : _supports(num_threads) {}

    /// History -1 for components that do not move.
    void set(const PointRecords &records, const std::vector<Portion> &portions,
             std::span<const double> values, std::span<const Index> histories,
             const Motion<Real> &motion);

    /// What holds each on its way: inner forces, inertia and damping. Returns the inner work.
    double pull(std::size_t thread, std::span<const double> now, std::span<const double> next,
                Motion<Real> &motion, const Pushes<Real> &pushes);
    void move(std::size_t thread, std::span<const double> next, Motion<Real> &motion) const;

    std::span<const Support> of(std::size_t thread) const { return _supports[thread]; }

  private:
    std::vector<std::vector<Support>> _supports; // by thread
};

} // namespace fastsim
