#pragma once
// Internal forces of smoothed tetrahedra (mechanics/smoothed_tet4.hpp) in one sweep over the cells.
//
//  1. cells, batch by batch: H is kept, and V_c times twice the strain and its trace are written as
//     a record of eight numbers
//  2. edges all of whose cells are done: the sum of their records, the strain weighed by
//     mu / (36 V_e), as a record
//  3. nodes all of whose edges are done: the sum of the edges' traces times lmbda / (288 V_n);
//  every
//     cell at a node is at three of its edges
//  4. edges both of whose nodes are done: the sum of the two nodes' numbers into the record
//  5. cells all of whose nodes are done: S_c is the sum of six edges' records, the nodes' part on
//     its diagonal: each node is at three of the six edges; then the forces, as of plain cells
//
// Under Green strain also what mechanics/compression_blend.hpp adds: 1 writes V_c times the square
// of twice the strain, 4 scales the strain by 1 - beta, writes mu beta / 6 in the trace's place,
// and adds what beta changes with to the nodes' part; 5 adds the cell's own strain times the
// former.
//
// In chunks of cells in the order of the points, so that 5 is about one bandwidth behind 1, and all
// that passes between them lives in rings that stay in the cache. Where everything lies is worked
// out beforehand: sweep_plan.hpp.

#include "explicit/step_kernel.hpp"
#include "mechanics/compression_blend.hpp"

namespace fastsim {

inline constexpr std::size_t sweep_record = 8; // numbers
inline constexpr std::size_t trace_entry = 6;  // of a record
inline constexpr std::size_t nodes_entry = 7;  // the sum of an edge's nodes; before, of squares

/// Of an edge: mu, and 1 / (24 V_e).
template <typename Real> struct EdgeModuli {
    Real mu, over_volume;
};

/// Edges of as many cells each, with neighbouring records.
struct EdgeGroup {
    std::int32_t num_edges, num_cells;
    std::int32_t first_entry; // of the first one's record
};

/// An edge's record, its ends' numbers, and the rate of the blend's x by the trace in the record.
template <typename Real> struct EdgeEnds {
    std::int32_t entry, first_node, second_node;
    Real blend_rate;
};

/// Where the parts of a sweep end after each chunk of cells.
struct SweepChunk {
    std::size_t strained_batches, edge_groups, node_groups, edge_ends, forced_batches;
};

template <typename Real> struct SweepJob {
    const Real *displacement; // records of 4
    StrainChange<Real> change;
    Real *force; // records of 4; forces are added
    const SweepChunk *chunks;
    std::size_t num_chunks;
    const std::int32_t *own_batches; // those that are forced; others are only strained here
    const std::int32_t *cell_edges;  // each of these: 6 x width, entries of the records
    const std::int32_t *corners;     // each batch: 4 x width
    const Real *rest;                // each batch: 10 x width
    const EdgeGroup *edge_groups;
    const std::int32_t *edge_cells; // of each edge, entries of the records
    const Real *edge_weight;
    const std::int32_t *node_counts; // by group of `width` nodes: how many edges each
    const std::int32_t *node_edges;  // each group: edges x width, entries of traces
    const Real *node_weight;
    const EdgeEnds<Real> *edge_ends;
    const EdgeModuli<Real> *blend_moduli;                        // of each of these
    Real *cell_records, *gradients, *edge_records, *node_values; // the rings, and by node
    std::size_t record_ring, gradient_ring;                      // batches
    bool is_green;
    bool is_large; // what streams past in a step does not stay in the cache
};

} // namespace fastsim
