#pragma once
// When a thread's sweep over smoothed cells (sweep_kernel.hpp) does what: its cells in whole
// batches, the edges and nodes that they need, and the chunk of cells after which each is known.

#include "mechanics/smoothing_patches.hpp"

#include <span>
#include <vector>

namespace fastsim {

struct SweepSchedule {
    static constexpr Index nobody = -1;

    struct Edge {
        Index patch;
        std::size_t chunk;        // after which its last cell is done
        std::vector<Index> cells; // places in `cells`
    };
    struct Node {
        Index patch;
        std::size_t chunk;
        std::vector<Index> edges; // turns
    };

    std::size_t width;                  // of a batch
    std::vector<Index> cells;           // of the body, or `nobody` where a batch is filled up
    std::size_t first_own, last_own;    // batches; the others are strained here, not forced
    std::vector<Edge> edges;            // in turn: by chunk, then by their number of cells
    std::vector<Node> nodes;            // in turn: by chunk, then by their number of edges
    std::vector<Index> edge_turn;       // by patch, or `nobody`
    std::vector<Index> ended_edges;     // turns of those with needed ends, as these get known
    std::vector<std::size_t> forced_in; // the chunk, by batch
    // How many are done after each chunk.
    std::vector<std::size_t> strained_by, edges_by, ended_by, forced_by; // batches or edges
    // From the record that is written to the oldest that will be read: batches, batches, edges.
    std::size_t record_ring = 1, gradient_ring = 1, edge_ring = 1;

    /// For the cells `order[first]` to `order[last - 1]`.
    SweepSchedule(const SmoothingPatches &patches, std::span<const Index> order, std::size_t first,
                  std::size_t last, std::size_t batch_width);

    std::size_t num_batches() const { return cells.size() / width; }
    std::size_t num_chunks() const { return strained_by.size(); }
    bool is_own(std::size_t batch) const { return batch >= first_own && batch < last_own; }

  private:
    std::vector<bool> take_cells(const SmoothingPatches &patches, std::span<const Index> order,
                                 std::size_t first, std::size_t last);
    void take_edges(const SmoothingPatches &patches, const std::vector<bool> &is_needed);
    void take_nodes(const SmoothingPatches &patches, const std::vector<bool> &is_needed);
    void end_edges(const SmoothingPatches &patches);
    void time_forces(const SmoothingPatches &patches);
    void measure_rings();
    std::vector<std::size_t> _node_chunk; // by patch
};

} // namespace fastsim
