#include "explicit/sweep_schedule.hpp"

#include <algorithm>
#include <utility>

namespace fastsim {

namespace {

constexpr std::size_t chunk_cells = 256;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

} // namespace

SweepSchedule::SweepSchedule(const SmoothingPatches &patches, std::span<const Index> order,
                             std::size_t first, std::size_t last, std::size_t batch_width)
    : width(batch_width) {
    const std::vector<bool> is_needed = take_cells(patches, order, first, last);
    const std::size_t in_chunk = chunk_cells / width;
    for (std::size_t done = 0; done < num_batches();)
        strained_by.push_back(done = std::min(num_batches(), done + in_chunk));
    take_edges(patches, is_needed);
    take_nodes(patches, is_needed);
    end_edges(patches);
    time_forces(patches);
    measure_rings();
}

/// The own cells, and before and after them those that share a node; returns the own ones' nodes.
std::vector<bool> SweepSchedule::take_cells(const SmoothingPatches &patches,
                                            std::span<const Index> order, std::size_t first,
                                            std::size_t last) {
    std::vector<bool> is_needed(patches.num_nodes(), false);
    const auto nodes_of = [&](std::size_t k) {
        return std::span(patches.cell_nodes).subspan(4 * at(order[k]), 4);
    };
    for (std::size_t k = first; k < last; ++k)
        for (const Index node : nodes_of(k))
            is_needed[at(node)] = true;
    const auto take = [&](std::size_t from, std::size_t to) {
        for (std::size_t k = from; k < to; ++k)
            if (std::ranges::any_of(nodes_of(k), [&](Index n) { return is_needed[at(n)]; }))
                cells.push_back(order[k]);
        while (cells.size() % width != 0)
            cells.push_back(nobody);
        return num_batches();
    };
    first_own = take(0, first);
    last_own = take(first, last);
    take(last, order.size());
    return is_needed;
}

/// The edges at the needed nodes, all of whose cells are there.
void SweepSchedule::take_edges(const SmoothingPatches &patches,
                               const std::vector<bool> &is_needed) {
    const std::size_t in_chunk = strained_by[0] * width;
    edge_turn.assign(patches.num_edges(), nobody);
    for (std::size_t k = 0; k < cells.size(); ++k)
        for (std::size_t e = 0; e < 6 && cells[k] != nobody; ++e) {
            const Index patch = patches.cell_edges[6 * at(cells[k]) + e];
            const auto &ends = patches.edge_ends[at(patch)];
            if (!is_needed[at(ends[0])] && !is_needed[at(ends[1])])
                continue;
            Index &number = edge_turn[at(patch)];
            if (number == nobody) {
                number = static_cast<Index>(edges.size());
                edges.push_back({patch, 0, {}});
            }
            edges[at(number)].cells.push_back(static_cast<Index>(k));
            edges[at(number)].chunk = k / in_chunk;
        }
    std::ranges::stable_sort(
        edges, {}, [](const Edge &edge) { return std::pair(edge.chunk, edge.cells.size()); });
    edges_by.assign(num_chunks(), 0);
    for (std::size_t turn = 0; turn < edges.size(); ++turn) {
        edge_turn[at(edges[turn].patch)] = static_cast<Index>(turn);
        edges_by[edges[turn].chunk] = turn + 1;
    }
    for (std::size_t chunk = 1; chunk < num_chunks(); ++chunk)
        edges_by[chunk] = std::max(edges_by[chunk], edges_by[chunk - 1]);
}

void SweepSchedule::take_nodes(const SmoothingPatches &patches,
                               const std::vector<bool> &is_needed) {
    std::vector<Index> number(patches.num_nodes(), nobody);
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        for (const Index patch : patches.edge_ends[at(edges[turn].patch)]) {
            if (!is_needed[at(patch)])
                continue;
            if (number[at(patch)] == nobody) {
                number[at(patch)] = static_cast<Index>(nodes.size());
                nodes.push_back({patch, 0, {}});
            }
            Node &node = nodes[at(number[at(patch)])];
            node.edges.push_back(static_cast<Index>(turn));
            node.chunk = edges[turn].chunk;
        }
    std::ranges::stable_sort(
        nodes, {}, [](const Node &node) { return std::pair(node.chunk, node.edges.size()); });
}

/// The edges whose ends are needed, each after the chunk that completes both.
void SweepSchedule::end_edges(const SmoothingPatches &patches) {
    constexpr auto never = static_cast<std::size_t>(-1);
    _node_chunk.assign(patches.num_nodes(), never);
    for (const Node &node : nodes)
        _node_chunk[at(node.patch)] = node.chunk;
    const auto chunk_of = [&](std::size_t turn) {
        const auto &ends = patches.edge_ends[at(edges[turn].patch)];
        return std::max(_node_chunk[at(ends[0])], _node_chunk[at(ends[1])]);
    };
    ended_by.assign(num_chunks() + 1, 0);
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        if (chunk_of(turn) != never)
            ++ended_by[chunk_of(turn) + 1];
    for (std::size_t chunk = 1; chunk <= num_chunks(); ++chunk)
        ended_by[chunk] += ended_by[chunk - 1];
    ended_edges.resize(ended_by.back());
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        if (chunk_of(turn) != never)
            ended_edges[ended_by[chunk_of(turn)]++] = static_cast<Index>(turn);
    ended_by.pop_back();
}

/// Batch by batch, each after the chunk that completes the nodes of all so far.
void SweepSchedule::time_forces(const SmoothingPatches &patches) {
    forced_in.assign(num_batches(), 0);
    forced_by.assign(num_chunks(), first_own);
    std::size_t ready = 0;
    for (std::size_t batch = first_own; batch < last_own; ++batch) {
        for (std::size_t k = width * batch; k < width * (batch + 1); ++k)
            for (std::size_t a = 0; a < 4 && cells[k] != nobody; ++a)
                ready = std::max(ready, _node_chunk[at(patches.cell_nodes[4 * at(cells[k]) + a])]);
        forced_in[batch] = ready;
        forced_by[ready] = batch + 1;
    }
    for (std::size_t chunk = 1; chunk < num_chunks(); ++chunk)
        forced_by[chunk] = std::max(forced_by[chunk], forced_by[chunk - 1]);
}

void SweepSchedule::measure_rings() {
    const auto lengthen = [](std::size_t &ring, std::size_t written, std::size_t oldest) {
        ring = std::max(ring, written - oldest);
    };
    for (std::size_t batch = first_own; batch < last_own; ++batch)
        lengthen(gradient_ring, strained_by[forced_in[batch]], batch);
    std::vector<std::size_t> last_read(edges.size(), 0); // by turn: the chunk
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        for (const Index k : edges[turn].cells) {
            lengthen(record_ring, strained_by[edges[turn].chunk], at(k) / width);
            last_read[turn] = std::max(last_read[turn], forced_in[at(k) / width]);
        }
    for (const Node &node : nodes)
        for (const Index turn : node.edges)
            last_read[at(turn)] = std::max(last_read[at(turn)], node.chunk);
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        lengthen(edge_ring, edges_by[std::max(last_read[turn], edges[turn].chunk)], turn);
}

} // namespace fastsim
