// The sweep over smoothed cells, over a Pack of `width` numbers. See sweep_kernel.hpp.
// Included after step_kernel.inl.

/// Whole packs in memory that is aligned for them; vectors may alias their own numbers.
template <typename Pack> inline const typename Pack::V *packs_at(const typename Pack::Real *p) {
    return reinterpret_cast<const typename Pack::V *>(p);
}
template <typename Pack> inline typename Pack::V *packs_at(typename Pack::Real *p) {
    return reinterpret_cast<typename Pack::V *>(p);
}

/// Whether what streams past once a step is asked for some thousand bytes before it is read: it
/// helps where it comes from memory, and costs a little where it is in a cache.
enum class Ahead { nothing, asks };

/// Asks for as many lines as are being read now. A hint: they may lie past the end.
template <Ahead ahead, std::size_t count, typename T> inline void prefetch_ahead(const T *first) {
    if constexpr (ahead == Ahead::asks)
        prefetch<count * sizeof(T)>(first, 4096 / (count * sizeof(T)));
}

/// Strains a batch of cells; returns det F.
template <typename Pack, bool is_green, bool of_change, Ahead ahead>
inline typename Pack::V strain_batch(const SweepJob<typename Pack::Real> &job, std::size_t batch) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width, parts = sweep_record / width;
    prefetch_ahead<ahead, 10 * width>(job.rest + 10 * width * batch);
    prefetch_ahead<ahead, 4 * width>(job.corners + 4 * width * batch);
    const V *const rest = packs_at<Pack>(job.rest + 10 * width * batch);
    V edges[9], h[9], e[sweep_record];
    gather_edges<Pack>(job.displacement, job.corners + 4 * width * batch, edges);
    gradient_of(rest, edges, h);
    [[maybe_unused]] V changes[9];
    if constexpr (of_change)
        gather_edges<Pack>(job.change.increment, job.corners + 4 * width * batch, changes);
    twice_strain_asked<is_green, of_change>(job.change, rest, h, changes, e);
    e[trace_entry] = e[0] + e[1] + e[2];
    e[nodes_entry] = V{};
    if constexpr (is_green && !of_change)
        e[nodes_entry] = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] +
                         Real(2) * (e[3] * e[3] + e[4] * e[4] + e[5] * e[5]);
    for (std::size_t k = 0; k < sweep_record; ++k)
        e[k] *= rest[9];
    if constexpr (is_green) {
        V *const kept = packs_at<Pack>(job.gradients + 9 * width * (batch % job.gradient_ring));
        for (std::size_t k = 0; k < 9; ++k)
            kept[k] = h[k];
    }
    V *const records =
        packs_at<Pack>(job.cell_records + sweep_record * width * (batch % job.record_ring));
    for (std::size_t p = 0; p < parts; ++p) {
        Pack::transpose(e + p * width);
        for (std::size_t lane = 0; lane < width; ++lane)
            records[parts * lane + p] = e[p * width + lane];
    }
    return det_of<is_green, Real>(h);
}

/// Sums the records of each edge's cells; `count` is their number where it is known, else 0.
template <typename Pack, Ahead ahead, std::size_t count>
const std::int32_t *sum_edges(const SweepJob<typename Pack::Real> &job, const EdgeGroup &group,
                              const std::int32_t *cells, const typename Pack::Real *weight) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t parts = sweep_record / Pack::width;
    static constexpr Real is_strain[sweep_record] = {1, 1, 1, 1, 1, 1, 0, 0};
    static constexpr Real is_trace[sweep_record] = {0, 0, 0, 0, 0, 0, 1, 1};
    const std::size_t num_cells = count > 0 ? count : static_cast<std::size_t>(group.num_cells);
    Real *record = job.edge_records + group.first_entry;
    for (std::int32_t edge = 0; edge < group.num_edges; ++edge) {
        V sum[parts];
        prefetch_ahead<ahead, 1>(cells);
        for (std::size_t p = 0; p < parts; ++p)
            sum[p] = Pack::load(job.cell_records + cells[0] + p * Pack::width);
        for (std::size_t k = 1; k < num_cells; ++k)
            for (std::size_t p = 0; p < parts; ++p)
                sum[p] += Pack::load(job.cell_records + cells[k] + p * Pack::width);
        for (std::size_t p = 0; p < parts; ++p) {
            const std::size_t at = p * Pack::width;
            sum[p] *= weight[edge] * Pack::load(is_strain + at) + Pack::load(is_trace + at);
            __builtin_memcpy(record + at, &sum[p], sizeof(V));
        }
        record += sweep_record;
        cells += num_cells;
    }
    return cells;
}

template <typename Pack, Ahead ahead>
const std::int32_t *sum_group(const SweepJob<typename Pack::Real> &job, const EdgeGroup &group,
                              const std::int32_t *cells, const typename Pack::Real *weight) {
    switch (group.num_cells) {
    case 1:
        return sum_edges<Pack, ahead, 1>(job, group, cells, weight);
    case 2:
        return sum_edges<Pack, ahead, 2>(job, group, cells, weight);
    case 3:
        return sum_edges<Pack, ahead, 3>(job, group, cells, weight);
    case 4:
        return sum_edges<Pack, ahead, 4>(job, group, cells, weight);
    case 5:
        return sum_edges<Pack, ahead, 5>(job, group, cells, weight);
    case 6:
        return sum_edges<Pack, ahead, 6>(job, group, cells, weight);
    case 7:
        return sum_edges<Pack, ahead, 7>(job, group, cells, weight);
    case 8:
        return sum_edges<Pack, ahead, 8>(job, group, cells, weight);
    default:
        return sum_edges<Pack, ahead, 0>(job, group, cells, weight);
    }
}

/// Blends an edge's record where it is compressed: x above 0.
template <typename Real>
void blend_edge(Real *record, Real x, Real rate, const EdgeModuli<Real> &moduli, Real squares) {
    const CompressionBlend<Real> blend(x);
    Real squared = 0;
    for (std::size_t k = 0; k < 6; ++k) {
        squared += (k < 3 ? Real(1) : Real(2)) * record[k] * record[k];
        record[k] *= Real(1) - blend.beta;
    }
    // mu v_e, of records that are mu / 3 times E_e.
    const Real variance = moduli.mu * squares * moduli.over_volume - Real(9) * squared / moduli.mu;
    record[trace_entry] = moduli.mu * blend.beta * Real(1.0 / 6.0);
    // The record's trace is 12 V_e tr E_e.
    record[nodes_entry] += blend.slope * rate * variance / (Real(12) * moduli.over_volume);
}

/// Adds the forces of one of the own batches.
template <typename Pack, bool is_green, bool of_change, Ahead ahead>
inline void force_batch(const SweepJob<typename Pack::Real> &job, std::size_t own) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width, parts = sweep_record / width;
    const auto batch = static_cast<std::size_t>(job.own_batches[own]);
    const std::int32_t *edges_of = job.cell_edges + 6 * width * own;
    prefetch_ahead<ahead, 6 * width>(edges_of);
    V s[sweep_record];
    for (std::size_t lane = 0; lane < width; ++lane) {
        const std::int32_t *const of = edges_of + 6 * lane;
        for (std::size_t p = 0; p < parts; ++p) {
            const Real *const records = job.edge_records + p * width;
            s[p * width + lane] = ((Pack::load(records + of[0]) + Pack::load(records + of[1])) +
                                   (Pack::load(records + of[2]) + Pack::load(records + of[3]))) +
                                  (Pack::load(records + of[4]) + Pack::load(records + of[5]));
        }
    }
    for (std::size_t p = 0; p < parts; ++p)
        Pack::transpose(s + p * width);
    const V *const rest = packs_at<Pack>(job.rest + 10 * width * batch);
    const V *const h = packs_at<Pack>(job.gradients + 9 * width * (batch % job.gradient_ring));
    if constexpr (is_green && !of_change) {
        bool is_pressed = false;
        for (std::size_t lane = 0; lane < width; ++lane)
            is_pressed |= s[trace_entry][lane] != Real(0);
        if (is_pressed) {
            V e[6];
            twice_strain<true>(h, e);
            for (std::size_t k = 0; k < 6; ++k)
                s[k] += s[trace_entry] * e[k];
        }
    }
    for (std::size_t k = 0; k < 6; ++k)
        s[k] = rest[9] * (k < 3 ? s[k] + s[nodes_entry] : s[k]);
    V forces[9];
    forces_by<is_green>(h, rest, s, forces);
    scatter_forces<Pack>(job.force, job.corners + 4 * width * batch, forces);
}

template <typename Pack, bool is_green, bool of_change, Ahead ahead>
typename Pack::Real sweep_cells(const SweepJob<typename Pack::Real> &job) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width;
    V smallest = V{} + Real(1);
    const std::int32_t *cells = job.edge_cells, *edges = job.node_edges;
    const Real *weight = job.edge_weight;
    std::size_t strained = 0, edge_group = 0, node_group = 0, ended = 0, forced = 0;
    for (std::size_t k = 0; k < job.num_chunks; ++k) {
        const SweepChunk &chunk = job.chunks[k];
        for (; strained < chunk.strained_batches; ++strained) {
            const V least = strain_batch<Pack, is_green, of_change, ahead>(job, strained);
            // NaN counts as inverted: the comparison is false for it.
            smallest = least > smallest ? smallest : least;
        }
        for (; edge_group < chunk.edge_groups; ++edge_group) {
            const EdgeGroup &group = job.edge_groups[edge_group];
            cells = sum_group<Pack, ahead>(job, group, cells, weight);
            weight += group.num_edges;
        }
        for (; node_group < chunk.node_groups; ++node_group) {
            V sum = {};
            for (std::int32_t left = job.node_counts[node_group]; left > 0; --left) {
                prefetch_ahead<ahead, width>(edges);
                sum += Pack::lookup(job.edge_records, edges);
                edges += width;
            }
            sum *= Pack::load(job.node_weight + width * node_group);
            __builtin_memcpy(job.node_values + width * node_group, &sum, sizeof(V));
        }
        for (; ended < chunk.edge_ends; ++ended) {
            const EdgeEnds<Real> &edge = job.edge_ends[ended];
            prefetch_ahead<ahead, 1>(&edge);
            Real *const record = job.edge_records + edge.entry;
            const Real squares = record[nodes_entry];
            record[nodes_entry] =
                job.node_values[edge.first_node] + job.node_values[edge.second_node];
            if constexpr (is_green && !of_change) {
                const Real x =
                    edge.blend_rate * record[trace_entry] - Real(blend_onset / blend_width);
                record[trace_entry] = 0;
                if (x > Real(0))
                    blend_edge(record, x, edge.blend_rate, job.blend_moduli[ended], squares);
            }
        }
        for (; forced < chunk.forced_batches; ++forced)
            force_batch<Pack, is_green, of_change, ahead>(job, forced);
    }
    return least_of<Pack>(smallest);
}

template <typename Pack, bool of_change>
typename Pack::Real sweep_of(const SweepJob<typename Pack::Real> &job) {
    if (job.is_large)
        return job.is_green ? sweep_cells<Pack, true, of_change, Ahead::asks>(job)
                            : sweep_cells<Pack, false, of_change, Ahead::asks>(job);
    return job.is_green ? sweep_cells<Pack, true, of_change, Ahead::nothing>(job)
                        : sweep_cells<Pack, false, of_change, Ahead::nothing>(job);
}

template <typename Pack> typename Pack::Real sweep(const SweepJob<typename Pack::Real> &job) {
    return job.change.increment ? sweep_of<Pack, true>(job) : sweep_of<Pack, false>(job);
}
