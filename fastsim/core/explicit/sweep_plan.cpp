#include "explicit/sweep_plan.hpp"

#include <algorithm>

namespace fastsim {

namespace {

// The first record and the first group of nodes hold zeros, for what fills up batches.
constexpr std::size_t num_zeros = 1;
// Cells whose data, some 130 bytes each in single precision, may stay in the cache from step to
// step.
constexpr std::size_t num_cached = 32768;
constexpr auto no_trace = static_cast<std::int32_t>(trace_entry);

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// First entry of a cell's record, by its place.
std::int32_t cell_entry(const SweepSchedule &schedule, std::size_t place) {
    return static_cast<std::int32_t>(sweep_record *
                                     (place % (schedule.record_ring * schedule.width)));
}

/// First entry of an edge's record, by its turn.
std::int32_t edge_entry(const SweepSchedule &schedule, std::size_t turn) {
    return static_cast<std::int32_t>(sweep_record * (num_zeros + turn % schedule.edge_ring));
}

} // namespace

template <typename Real>
SweepPlan<Real>::SweepPlan(const ElasticCells &body, StrainMeasure strain,
                           const SmoothingPatches &patches, const PointRecords &records,
                           const SweepSchedule &schedule)
    : _first_touched(records.size()),
      _own_batches(schedule.own_batches.begin(), schedule.own_batches.end()) {
    _chunks.resize(schedule.num_chunks());
    for (std::size_t chunk = 0; chunk < _chunks.size(); ++chunk)
        _chunks[chunk] = {schedule.strained_by[chunk], 0, 0, schedule.ended_by[chunk],
                          schedule.forced_by[chunk]};
    lay_out_edges(body, patches, schedule);
    lay_out_nodes(body, patches, schedule);
    lay_out_cells(body, patches, records, schedule);
    const std::size_t width = schedule.width;
    _cell_records.assign(sweep_record * width * schedule.record_ring, Real(0));
    _gradients.assign(9 * width * schedule.gradient_ring, Real(0));
    _edge_records.assign(sweep_record * (num_zeros + schedule.edge_ring), Real(0));
    _node_values.assign(_node_weight.size(), Real(0));
    _job.record_ring = schedule.record_ring;
    _job.gradient_ring = schedule.gradient_ring;
    _job.is_large = schedule.cells.size() * sizeof(Real) > num_cached * sizeof(float);
    _job.is_green = strain == StrainMeasure::green;
}

template <typename Real>
void SweepPlan<Real>::lay_out_edges(const ElasticCells &body, const SmoothingPatches &patches,
                                    const SweepSchedule &schedule) {
    const SweepSchedule::Turns &edges = schedule.edges;
    _edge_cells.reserve(edges.members.members.size());
    _edge_weight.reserve(edges.size());
    std::size_t turn = 0;
    for (std::size_t chunk = 0; chunk < _chunks.size(); ++chunk) {
        for (bool is_first = true; turn < schedule.edges_by[chunk]; ++turn, is_first = false) {
            const std::span<const Index> places = edges.members.of(turn);
            const auto num_cells = static_cast<std::int32_t>(places.size());
            if (is_first || turn % schedule.edge_ring == 0 ||
                _edge_groups.back().num_cells != num_cells)
                _edge_groups.push_back({0, num_cells, edge_entry(schedule, turn)});
            ++_edge_groups.back().num_edges;
            for (const Index place : places)
                _edge_cells.push_back(cell_entry(schedule, at(place)));
            const std::size_t patch = at(edges.patch[turn]);
            const Moduli &moduli = body.materials[at(patches.edge_material[patch])];
            _edge_weight.push_back(
                static_cast<Real>(moduli.mu / (36.0 * patches.edge_volume[patch])));
        }
        _chunks[chunk].edge_groups = _edge_groups.size();
    }
}

template <typename Real>
void SweepPlan<Real>::lay_out_nodes(const ElasticCells &body, const SmoothingPatches &patches,
                                    const SweepSchedule &schedule) {
    const SweepSchedule::Turns &nodes = schedule.nodes;
    const std::size_t width = schedule.width;
    _node_counts.assign(num_zeros, 0);
    _node_weight.assign(num_zeros * width, Real(0));
    std::vector<std::int32_t> value_of(patches.num_nodes(), 0); // of each patch
    std::size_t begin = 0;
    for (std::size_t chunk = 0; chunk < _chunks.size(); ++chunk) {
        while (begin < nodes.size() && nodes.chunk[begin] == chunk) {
            std::size_t end = begin + 1;
            while (end < std::min(nodes.size(), begin + width) && nodes.chunk[end] == chunk)
                ++end;
            const std::size_t most = nodes.members.of(end - 1).size();
            for (std::size_t k = 0; k < most; ++k)
                for (std::size_t n = begin; n < begin + width; ++n)
                    _node_edges.push_back(n < end && k < nodes.members.of(n).size()
                                              ? edge_entry(schedule, at(nodes.members.of(n)[k])) +
                                                    no_trace
                                              : no_trace);
            for (std::size_t n = begin; n < begin + width; ++n) {
                Real weight = 0;
                if (n < end) {
                    const std::size_t patch = at(nodes.patch[n]);
                    value_of[patch] = static_cast<std::int32_t>(_node_weight.size());
                    weight =
                        static_cast<Real>(body.materials[at(patches.node_material[patch])].lmbda /
                                          (288.0 * patches.node_volume[patch]));
                }
                _node_weight.push_back(weight);
            }
            _node_counts.push_back(static_cast<std::int32_t>(most));
            begin = end;
        }
        _chunks[chunk].node_groups = _node_counts.size();
    }
    _edge_ends.reserve(schedule.ended_edges.size());
    for (const Index turn : schedule.ended_edges) {
        const std::size_t patch = at(schedule.edges.patch[at(turn)]);
        const auto &ends = patches.edge_ends[patch];
        const Moduli &moduli = body.materials[at(patches.edge_material[patch])];
        const double volume = patches.edge_volume[patch];
        _blend_moduli.push_back(
            {static_cast<Real>(moduli.mu), static_cast<Real>(1.0 / (24.0 * volume))});
        _edge_ends.push_back(
            {edge_entry(schedule, at(turn)), value_of[at(ends[0])], value_of[at(ends[1])],
             static_cast<Real>(blend_rate(moduli.lmbda, moduli.mu) / (12.0 * volume))});
    }
}

template <typename Real>
void SweepPlan<Real>::lay_out_cells(const ElasticCells &body, const SmoothingPatches &patches,
                                    const PointRecords &records, const SweepSchedule &schedule) {
    const std::vector<Index> &cells = schedule.cells;
    const std::size_t width = schedule.width;
    _corners.assign(4 * cells.size(), static_cast<std::int32_t>(4 * records.size()));
    _rest.assign(10 * cells.size(), Real(0));
    for (std::size_t k = 0; k < cells.size(); ++k) {
        if (cells[k] == SweepSchedule::nobody)
            continue;
        const std::size_t c = at(cells[k]), batch = k / width, lane = k % width;
        for (std::size_t a = 0; a < 4; ++a)
            _corners[(4 * batch + a) * width + lane] =
                static_cast<std::int32_t>(records.first_entry(body.cells[4 * c + a]));
        for (std::size_t j = 0; j < 9; ++j)
            _rest[(10 * batch + j) * width + lane] = static_cast<Real>(body.rest.gradients[c][j]);
        _rest[(10 * batch + 9) * width + lane] = static_cast<Real>(body.rest.volumes[c]);
    }
    _cell_edges.assign(6 * width * _own_batches.size(), 0);
    for (std::size_t own = 0; own < _own_batches.size(); ++own)
        for (std::size_t lane = 0; lane < width; ++lane) {
            const Index cell = cells[width * at(_own_batches[own]) + lane];
            if (cell == SweepSchedule::nobody)
                continue;
            for (std::size_t a = 0; a < 4; ++a) {
                const std::size_t record = records.first_entry(body.cells[4 * at(cell) + a]) / 4;
                _first_touched = std::min(_first_touched, record);
                _last_touched = std::max(_last_touched, record + 1);
            }
            for (std::size_t e = 0; e < 6; ++e)
                _cell_edges[6 * (width * own + lane) + e] = edge_entry(
                    schedule, at(schedule.edge_turn[at(patches.cell_edges[6 * at(cell) + e])]));
        }
}

template <typename Real>
Real SweepPlan<Real>::run(SweepKernel<Real> kernel, const Real *displacement,
                          const StrainChange<Real> &change, Real *force) {
    SweepJob<Real> job = _job;
    job.displacement = displacement;
    job.change = change;
    job.force = force;
    job.chunks = _chunks.data();
    job.num_chunks = _chunks.size();
    job.own_batches = _own_batches.data();
    job.corners = _corners.data();
    job.cell_edges = _cell_edges.data();
    job.rest = _rest.data();
    job.edge_groups = _edge_groups.data();
    job.edge_cells = _edge_cells.data();
    job.edge_weight = _edge_weight.data();
    job.node_counts = _node_counts.data();
    job.node_edges = _node_edges.data();
    job.node_weight = _node_weight.data();
    job.edge_ends = _edge_ends.data();
    job.blend_moduli = _blend_moduli.data();
    job.cell_records = _cell_records.data();
    job.gradients = _gradients.data();
    job.edge_records = _edge_records.data();
    job.node_values = _node_values.data();
    return kernel(job);
}

template class SweepPlan<float>;
template class SweepPlan<double>;

} // namespace fastsim
