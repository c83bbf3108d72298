#pragma once
// What the cells push with: R(a), and the forces of stiffness damping, in parts by thread that are
// summed in the order of threads.

#include "explicit/internal_force.hpp"
#include "explicit/motion.hpp"

#include <memory>
#include <vector>

namespace fastsim {

/// Stiffness damping of a run; see central_difference.hpp.
struct StrainDamping {
    double stiffness_damping; // [s]
    double time_step;         // [s]
    bool is_balanced;         // the balance of energy wants its forces apart
};

template <typename Real> class CellForces {
  public:
    /// `internal` is R(a) of the body, or of a class of its cells.
    CellForces(const ElasticBody &body, std::unique_ptr<InternalForce<Real>> internal,
               const PointRecords &records, const KernelChoice<Real> &kernel,
               const StrainDamping &damping);

    /// One for each thread, of which there may be fewer than were asked for.
    const std::vector<Portion> &portions() const { return _internal->portions; }
    /// Are the forces of stiffness damping summed in `motion.viscous` too?
    bool keeps_viscous_apart() const { return !_viscous_parts.empty(); }

    /// Takes note of the state that the run is started from.
    void start(const Motion<Real> &motion);
    /// Adds those of a thread's cells to its part; returns the smallest det F met.
    Real add(std::size_t thread, Motion<Real> &motion, bool is_first_step);
    /// Moves the parts, of the points that a thread owns, into the motion's force, once all
    /// threads have added theirs.
    void sum(std::size_t thread, Motion<Real> &motion);
    // The same for R(a) alone.
    Real add_elastic(std::size_t thread, Motion<Real> &motion);
    void sum_elastic(std::size_t thread, Motion<Real> &motion);
    /// Sets all to 0, those in the motion's force too.
    void clear(Motion<Real> &motion);

  private:
    Real *part_of(std::size_t thread, Motion<Real> &motion);
    StrainChange<Real> change_of(const Motion<Real> &motion, bool is_first_step, Real own) const;
    void sum_viscous(const Portion &portion, Motion<Real> &motion);

    std::unique_ptr<InternalForce<Real>> _internal;
    std::unique_ptr<InternalForce<Real>> _viscous;   // null where `_internal` does it too
    std::vector<AlignedVector<Real>> _parts;         // by thread; the first is the motion's force
    std::vector<AlignedVector<Real>> _viscous_parts; // by thread, where they are kept apart
    AlignedVector<Real> _increment_at_start;         // with stiffness damping
    bool _damps_strain;
    Real _damping_over_step;
};

} // namespace fastsim
