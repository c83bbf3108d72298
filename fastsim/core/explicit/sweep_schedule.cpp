#include "explicit/sweep_schedule.hpp"

#include <algorithm>
#include <numeric>

namespace fastsim {

namespace {

constexpr std::size_t chunk_cells = 256;
constexpr auto never = static_cast<std::size_t>(-1);

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// Puts numbered things in order of their keys; of equal keys, as they were.
template <typename Key> void sort_by(std::vector<Index> &order, const std::vector<Key> &keys) {
    std::vector<std::size_t> place(keys.empty() ? 1 : std::ranges::max(keys) + std::size_t{2}, 0);
    for (const Index i : order)
        ++place[keys[at(i)] + 1];
    std::partial_sum(place.begin(), place.end(), place.begin());
    std::vector<Index> sorted(order.size());
    for (const Index i : order)
        sorted[place[keys[at(i)]]++] = i;
    order.swap(sorted);
}

/// Things as they were met, with the chunk and the number of members of each.
struct Met {
    std::vector<Index> patch;
    std::vector<std::size_t> chunk, count;

    /// The number of a patch's thing.
    std::size_t find(std::vector<Index> &number_of, Index met) {
        Index &number = number_of[at(met)];
        if (number == SweepSchedule::nobody) {
            number = static_cast<Index>(patch.size());
            patch.push_back(met);
            chunk.push_back(0);
            count.push_back(0);
        }
        return at(number);
    }

    /// In turn, members still to be filled in; `number_of` becomes the turn.
    SweepSchedule::Turns in_turn(std::vector<Index> &number_of) const {
        std::vector<Index> order(patch.size());
        std::iota(order.begin(), order.end(), Index{0});
        sort_by(order, count);
        sort_by(order, chunk);
        SweepSchedule::Turns turns;
        turns.members.start.push_back(0);
        for (const Index i : order) {
            number_of[at(patch[at(i)])] = static_cast<Index>(turns.size());
            turns.patch.push_back(patch[at(i)]);
            turns.chunk.push_back(chunk[at(i)]);
            turns.members.start.push_back(turns.members.start.back() + count[at(i)]);
        }
        turns.members.members.resize(turns.members.start.back());
        return turns;
    }
};

} // namespace

SweepSchedule::SweepSchedule(const SmoothingPatches &patches, std::span<const Index> order,
                             std::span<const std::uint32_t> owner, std::uint32_t own,
                             std::size_t batch_width)
    : width(batch_width) {
    take_cells(patches, order, owner, own);
    take_edges(patches);
    take_nodes(patches);
    end_edges(patches);
    time_forces(patches);
    measure_rings();
}

/// In every chunk first the own cells, then others that share a node, each in whole batches.
void SweepSchedule::take_cells(const SmoothingPatches &patches, std::span<const Index> order,
                               std::span<const std::uint32_t> owner, std::uint32_t own) {
    const auto nodes_of = [&](Index cell) {
        return std::span(patches.cell_nodes).subspan(4 * at(cell), 4);
    };
    _is_needed.assign(patches.num_nodes(), 0);
    for (const Index cell : order)
        if (owner[at(cell)] == own)
            for (const Index node : nodes_of(cell))
                _is_needed[at(node)] = 1;
    std::vector<Index> others;
    const auto fill_up = [&] {
        while (cells.size() % width != 0)
            cells.push_back(nobody);
    };
    const auto end_chunk = [&] {
        fill_up();
        for (std::size_t batch = _chunk_of.size(); batch < num_batches(); ++batch)
            own_batches.push_back(static_cast<Index>(batch));
        cells.insert(cells.end(), others.begin(), others.end());
        fill_up();
        _chunk_of.resize(num_batches(), strained_by.size());
        strained_by.push_back(num_batches());
        others.clear();
    };
    const auto is_full = [&] {
        return cells.size() - width * _chunk_of.size() + others.size() == chunk_cells;
    };
    for (const Index cell : order) {
        if (owner[at(cell)] == own)
            cells.push_back(cell);
        else if (std::ranges::any_of(nodes_of(cell), [&](Index n) { return _is_needed[at(n)]; }))
            others.push_back(cell);
        else
            continue;
        if (is_full())
            end_chunk();
    }
    if (!others.empty() || cells.size() > width * _chunk_of.size())
        end_chunk();
}

/// The edges at the needed nodes, all of whose cells are there.
void SweepSchedule::take_edges(const SmoothingPatches &patches) {
    const auto for_each_edge = [&](auto &&visit) {
        for (std::size_t k = 0; k < cells.size(); ++k)
            for (std::size_t e = 0; e < 6 && cells[k] != nobody; ++e) {
                const Index patch = patches.cell_edges[6 * at(cells[k]) + e];
                const auto &ends = patches.edge_ends[at(patch)];
                if (_is_needed[at(ends[0])] || _is_needed[at(ends[1])])
                    visit(k, patch);
            }
    };
    edge_turn.assign(patches.num_edges(), nobody);
    Met met;
    for_each_edge([&](std::size_t place, Index patch) {
        const std::size_t edge = met.find(edge_turn, patch);
        met.chunk[edge] = _chunk_of[place / width];
        ++met.count[edge];
    });
    edges = met.in_turn(edge_turn);
    std::vector<std::size_t> fill(edges.members.start);
    for_each_edge([&](std::size_t place, Index patch) {
        edges.members.members[fill[at(edge_turn[at(patch)])]++] = static_cast<Index>(place);
    });
    edges_by.assign(num_chunks(), 0);
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        edges_by[edges.chunk[turn]] = turn + 1;
    for (std::size_t chunk = 1; chunk < num_chunks(); ++chunk)
        edges_by[chunk] = std::max(edges_by[chunk], edges_by[chunk - 1]);
}

void SweepSchedule::take_nodes(const SmoothingPatches &patches) {
    const auto for_each_node = [&](auto &&visit) {
        for (std::size_t turn = 0; turn < edges.size(); ++turn)
            for (const Index patch : patches.edge_ends[at(edges.patch[turn])])
                if (_is_needed[at(patch)])
                    visit(turn, patch);
    };
    std::vector<Index> number(patches.num_nodes(), nobody);
    Met met;
    for_each_node([&](std::size_t turn, Index patch) {
        const std::size_t node = met.find(number, patch);
        met.chunk[node] = edges.chunk[turn];
        ++met.count[node];
    });
    nodes = met.in_turn(number);
    std::vector<std::size_t> fill(nodes.members.start);
    for_each_node([&](std::size_t turn, Index patch) {
        nodes.members.members[fill[at(number[at(patch)])]++] = static_cast<Index>(turn);
    });
    _node_chunk.assign(patches.num_nodes(), never);
    for (std::size_t turn = 0; turn < nodes.size(); ++turn)
        _node_chunk[at(nodes.patch[turn])] = nodes.chunk[turn];
}

/// The edges whose ends are needed, each after the chunk that completes both.
void SweepSchedule::end_edges(const SmoothingPatches &patches) {
    std::vector<std::size_t> known_in(edges.size());
    for (std::size_t turn = 0; turn < edges.size(); ++turn) {
        const auto &ends = patches.edge_ends[at(edges.patch[turn])];
        known_in[turn] = std::max(_node_chunk[at(ends[0])], _node_chunk[at(ends[1])]);
        if (known_in[turn] != never)
            ended_edges.push_back(static_cast<Index>(turn));
        else
            known_in[turn] = 0;
    }
    ended_by.assign(num_chunks(), 0);
    for (const Index turn : ended_edges)
        ++ended_by[known_in[at(turn)]];
    std::partial_sum(ended_by.begin(), ended_by.end(), ended_by.begin());
    sort_by(ended_edges, known_in);
}

/// Batch by batch, each after the chunk that completes the nodes of all so far.
void SweepSchedule::time_forces(const SmoothingPatches &patches) {
    forced_by.assign(num_chunks(), 0);
    std::size_t ready = 0;
    for (const Index batch : own_batches) {
        for (std::size_t k = width * at(batch); k < width * (at(batch) + 1); ++k)
            for (std::size_t a = 0; a < 4 && cells[k] != nobody; ++a)
                ready = std::max(ready, _node_chunk[at(patches.cell_nodes[4 * at(cells[k]) + a])]);
        forced_in.push_back(ready);
        forced_by[ready] = forced_in.size();
    }
    for (std::size_t chunk = 1; chunk < num_chunks(); ++chunk)
        forced_by[chunk] = std::max(forced_by[chunk], forced_by[chunk - 1]);
}

void SweepSchedule::measure_rings() {
    const auto lengthen = [](std::size_t &ring, std::size_t written, std::size_t oldest) {
        ring = std::max(ring, written - oldest);
    };
    std::vector<std::size_t> read_in(num_batches(), 0); // the chunk in which it is forced
    for (std::size_t k = 0; k < own_batches.size(); ++k) {
        const std::size_t batch = at(own_batches[k]);
        read_in[batch] = forced_in[k];
        lengthen(gradient_ring, strained_by[forced_in[k]], batch);
    }
    std::vector<std::size_t> last_read(edges.chunk); // by turn: the chunk
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        for (const Index k : edges.members.of(turn)) {
            lengthen(record_ring, strained_by[edges.chunk[turn]], at(k) / width);
            last_read[turn] = std::max(last_read[turn], read_in[at(k) / width]);
        }
    for (std::size_t node = 0; node < nodes.size(); ++node)
        for (const Index turn : nodes.members.of(node))
            last_read[at(turn)] = std::max(last_read[at(turn)], nodes.chunk[node]);
    for (std::size_t turn = 0; turn < edges.size(); ++turn)
        lengthen(edge_ring, edges_by[last_read[turn]], turn);
}

} // namespace fastsim
