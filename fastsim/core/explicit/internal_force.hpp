#pragma once
// R(a) in parts, one for each thread: of plain cells, batch by batch, or of smoothed ones, by a
// sweep of its own for each.

#include "explicit/sweep_plan.hpp"
#include "mechanics/elastic_body.hpp"

#include <memory>

namespace fastsim {

/// The finest class of each cell's parts: its own, or of smoothed cells that of any cell that
/// shares an edge or node patch.
std::vector<Index> finest_at_cells(const ElasticBody &body, std::span<const Index> class_of);
/// Of each point, the finest of its cells'.
std::vector<Index> finest_at_points(const ElasticBody &body, std::span<const Index> class_of);

template <typename Real> class InternalForce {
  public:
    static std::unique_ptr<InternalForce> make(const ElasticBody &body, StrainMeasure strain,
                                               const PointRecords &records,
                                               const KernelChoice<Real> &kernel,
                                               std::size_t num_threads);
    /// Hooke's of the materials at rest, whatever the body's law: of viscous stresses.
    static std::unique_ptr<InternalForce> make_viscous(const ElasticBody &body,
                                                       const PointRecords &records,
                                                       const KernelChoice<Real> &kernel,
                                                       std::size_t num_threads);
    /// Of the cells of one class, on one thread; of smoothed ones the patches whose finest cell is
    /// of that class. Pre-condition: `make` takes no plain loop of the body.
    static std::unique_ptr<InternalForce>
    make_of_class(const ElasticBody &body, const PointRecords &records,
                  const KernelChoice<Real> &kernel, std::span<const Index> class_of, Index number);
    virtual ~InternalForce() = default;

    /// Adds the forces of a thread's cells; returns the smallest det F met (1 for linear strain).
    /// A change goes with stresses that are linear in strain.
    virtual Real add(std::size_t thread, const Real *displacement, const StrainChange<Real> &change,
                     Real *force) = 0;

    /// One for each thread, of which there may be fewer than were asked for.
    std::vector<Portion> portions;
};

} // namespace fastsim
