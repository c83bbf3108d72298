#pragma once
// What a sweep over smoothed cells reads, in the order in which it is read: its own
// cells, and copies of those of other sweeps that share a node's patch with them.

#include "explicit/records.hpp"
#include "explicit/sweep_kernel.hpp"
#include "explicit/sweep_schedule.hpp"

#include <vector>

namespace fastsim {

template <typename Real> class SweepPlan {
  public:
    SweepPlan(const ElasticCells &body, StrainMeasure strain, const SmoothingPatches &patches,
              const PointRecords &records, const SweepSchedule &schedule);

    /// Adds the forces of the own cells; returns the smallest det F met.
    Real run(SweepKernel<Real> kernel, const Real *displacement, const StrainChange<Real> &change,
             Real *force);

    /// Points of the own cells, from the first record to one past the last.
    std::size_t first_touched() const { return _first_touched; }
    std::size_t last_touched() const { return _last_touched; }

  private:
    void lay_out_edges(const ElasticCells &body, const SmoothingPatches &patches,
                       const SweepSchedule &schedule);
    void lay_out_nodes(const ElasticCells &body, const SmoothingPatches &patches,
                       const SweepSchedule &schedule);
    void lay_out_cells(const ElasticCells &body, const SmoothingPatches &patches,
                       const PointRecords &records, const SweepSchedule &schedule);

    SweepJob<Real> _job{};
    std::size_t _first_touched, _last_touched = 0;
    std::vector<SweepChunk> _chunks;
    std::vector<EdgeGroup> _edge_groups;
    std::vector<std::int32_t> _own_batches;
    AlignedVector<std::int32_t> _corners, _cell_edges;
    AlignedVector<std::int32_t> _edge_cells, _node_counts, _node_edges;
    AlignedVector<Real> _rest, _edge_weight, _node_weight;
    std::vector<EdgeEnds<Real>> _edge_ends;
    std::vector<EdgeModuli<Real>> _blend_moduli;
    AlignedVector<Real> _cell_records, _gradients, _edge_records, _node_values;
};

} // namespace fastsim
