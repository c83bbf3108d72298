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

/// Held components that move: a sum of factors times values.
template <typename Real> class MovingSupports {
  public:
    struct Term {
        std::size_t history;
        double value;
    };
    struct Support {
        std::size_t entry;
        double mass;
        std::size_t first_term, last_term;
        double next = 0.0, pull = 0.0; // increment ahead [m], and what makes it so [N]
    };

    explicit MovingSupports(std::size_t num_threads) : _supports(num_threads) {}

    /// Some terms, one after another for all points; history -1 for components without the term.
    void set(const PointRecords &records, const std::vector<Portion> &portions,
             std::span<const double> values, std::span<const Index> histories,
             const Motion<Real> &motion);

    /// What holds each on its way: inner forces, inertia and damping. Returns the inner work.
    double pull(std::size_t thread, std::span<const double> now, std::span<const double> next,
                Motion<Real> &motion, const Pushes<Real> &pushes);
    void move(std::size_t thread, std::span<const double> next, Motion<Real> &motion) const;

    std::span<const Support> of(std::size_t thread) const { return _supports[thread]; }

  private:
    double place(const Support &support, std::span<const double> factors) const;

    std::vector<std::vector<Support>> _supports; // by thread
    std::vector<Term> _terms;
};

/// Points that slide: held along one or two directions, free across them.
template <typename Real> class SlidingSupports {
  public:
    struct Slide {
        std::size_t entry, history;
        double value;
        std::array<double, 3> direction;
        double last = 0.0, next = 0.0, pull = 0.0; // increments along it [m], and what makes them
    };

    explicit SlidingSupports(std::size_t num_threads) : _slides(num_threads) {}

    /// Two directions for each point, orthonormal or zero, with a value and a history each.
    void set(const PointRecords &records, const std::vector<Portion> &portions,
             std::span<const Index> points, std::span<const double> directions,
             std::span<const double> values, std::span<const Index> histories);

    /// Adds what holds the points to the forces, when all else has been found: the increments ahead
    /// are then those of the supports. Returns the work of the supports along them.
    double hold(std::size_t thread, std::span<const double> now, std::span<const double> next,
                Motion<Real> &motion);
    /// Takes off what rounding has left, after the step.
    void settle(std::size_t thread, std::span<const double> next, Motion<Real> &motion) const;

    std::span<const Slide> of(std::size_t thread) const { return _slides[thread]; }

  private:
    std::vector<std::vector<Slide>> _slides; // by thread
};

} // namespace fastsim
