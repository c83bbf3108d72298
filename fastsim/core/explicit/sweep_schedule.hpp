#pragma once
// When a sweep over smoothed cells (sweep_kernel.hpp) does what: its own cells and those of other
// sweeps that share a node's patch with them, the edges and nodes that the own cells need, and the
// chunk of cells after which each is known.

#include "mechanics/smoothing_patches.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

struct SweepSchedule {
    static constexpr Index nobody = -1;

    /// Edges or nodes in turn: by chunk, then by how many members they have, then as met.
    struct Turns {
        std::vector<Index> patch;
        std::vector<std::size_t> chunk; // after which the last member is done
        Groups members;                 // of an edge: places in `cells`; of a node: turns of edges

        std::size_t size() const { return patch.size(); }
    };

    std::size_t width;              // of a batch
    std::vector<Index> cells;       // of the body, or `nobody` where a batch is filled up
    std::vector<Index> own_batches; // the others are strained here, not forced
    Turns edges, nodes;
    std::vector<Index> edge_turn;       // by patch, or `nobody`
    std::vector<Index> ended_edges;     // turns of those with needed ends, as these get known
    std::vector<std::size_t> forced_in; // the chunk, by own batch
    // How many are done after each chunk: batches, edges, edges, own batches.
    std::vector<std::size_t> strained_by, edges_by, ended_by, forced_by;
    // From the record that is written to the oldest that will be read: batches, batches, edges.
    std::size_t record_ring = 1, gradient_ring = 1, edge_ring = 1;

    /// For the cells whose `owner` is `own`; `order` has all cells.
    SweepSchedule(const SmoothingPatches &patches, std::span<const Index> order,
                  std::span<const std::uint32_t> owner, std::uint32_t own, std::size_t batch_width);

    std::size_t num_batches() const { return cells.size() / width; }
    std::size_t num_chunks() const { return strained_by.size(); }

  private:
    void take_cells(const SmoothingPatches &patches, std::span<const Index> order,
                    std::span<const std::uint32_t> owner, std::uint32_t own);
    void take_edges(const SmoothingPatches &patches);
    void take_nodes(const SmoothingPatches &patches);
    void end_edges(const SmoothingPatches &patches);
    void time_forces(const SmoothingPatches &patches);
    void measure_rings();

    std::vector<std::uint8_t> _is_needed; // by node patch: one of an own cell's
    std::vector<std::size_t> _chunk_of;   // by batch
    std::vector<std::size_t> _node_chunk; // by node patch
};

} // namespace fastsim
