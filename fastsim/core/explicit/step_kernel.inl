// The kernel, over a Pack of `width` numbers of type Real. See step_kernel.hpp.
// Included by one translation unit for each instruction set, inside an unnamed
// namespace.

/// Asks for the lines of a block some blocks ahead. A hint: it may lie past the
/// end.
template <std::size_t bytes, typename T> void prefetch(const T *block, std::size_t blocks_ahead) {
    const auto address = reinterpret_cast<std::uintptr_t>(block) + bytes * blocks_ahead;
    for (std::size_t line = 0; line < bytes; line += 64)
        __builtin_prefetch(reinterpret_cast<const void *>(address + line));
}

/// Displacements of corners 1 to 3 of a batch of cells less that of corner 0.
template <typename Pack>
[[gnu::always_inline]] inline void gather_edges(const typename Pack::Real *displacement,
                                                const std::int32_t *records,
                                                typename Pack::V *edges) {
    using V = typename Pack::V;
    V x0, y0, z0;
    Pack::gather(displacement, records, x0, y0, z0);
    for (std::size_t a = 0; a < 3; ++a) {
        V x, y, z;
        Pack::gather(displacement, records + (a + 1) * Pack::width, x, y, z);
        edges[3 * a] = x - x0;
        edges[3 * a + 1] = y - y0;
        edges[3 * a + 2] = z - z0;
    }
}

/// Adds forces on corners 1 to 3, and their opposite to corner 0.
template <typename Pack>
[[gnu::always_inline]] inline void scatter_forces(typename Pack::Real *force,
                                                  const std::int32_t *records,
                                                  const typename Pack::V *edges) {
    for (std::size_t a = 0; a < 3; ++a)
        Pack::scatter_add(force, records + (a + 1) * Pack::width, edges[3 * a], edges[3 * a + 1],
                          edges[3 * a + 2]);
    Pack::scatter_add(force, records, -(edges[0] + edges[3] + edges[6]),
                      -(edges[1] + edges[4] + edges[7]), -(edges[2] + edges[5] + edges[8]));
}

/// H of a batch of cells, row by row.
template <typename V> inline void gradient_of(const V *g, const V *edges, V *h) {
    for (std::size_t k = 0; k < 9; ++k)
        h[k] = V{};
    for (std::size_t a = 0; a < 3; ++a) {
        const V x = edges[3 * a], y = edges[3 * a + 1], z = edges[3 * a + 2];
        for (std::size_t j = 0; j < 3; ++j) {
            h[j] += x * g[3 * a + j];
            h[3 + j] += y * g[3 * a + j];
            h[6 + j] += z * g[3 * a + j];
        }
    }
}

/// Twice the strain (xx, yy, zz, xy, xz, yz), from H and not from F^T F - I: no cancellation.
template <bool is_green, typename V> inline void twice_strain(const V *h, V *e) {
    e[0] = h[0] + h[0], e[1] = h[4] + h[4], e[2] = h[8] + h[8];
    e[3] = h[1] + h[3], e[4] = h[2] + h[6], e[5] = h[5] + h[7];
    if constexpr (is_green) {
        e[0] += h[0] * h[0] + h[3] * h[3] + h[6] * h[6];
        e[1] += h[1] * h[1] + h[4] * h[4] + h[7] * h[7];
        e[2] += h[2] * h[2] + h[5] * h[5] + h[8] * h[8];
        e[3] += h[0] * h[1] + h[3] * h[4] + h[6] * h[7];
        e[4] += h[0] * h[2] + h[3] * h[5] + h[6] * h[8];
        e[5] += h[1] * h[2] + h[4] * h[5] + h[7] * h[8];
    }
}

/// Twice what the strain has changed by, of H that has changed by D: with G = H - D/2, half way,
/// (D + D^T + G^T D + D^T G). No cancellation, and none for a finite turn.
template <bool is_green, typename Real, typename V>
inline void twice_change(const V *h, const V *d, V *e) {
    twice_strain<false>(d, e);
    if constexpr (is_green) {
        V g[9];
        for (std::size_t k = 0; k < 9; ++k)
            g[k] = h[k] - Real(0.5) * d[k];
        constexpr std::size_t rows[6] = {0, 1, 2, 0, 0, 1}, columns[6] = {0, 1, 2, 1, 2, 2};
        for (std::size_t k = 0; k < 6; ++k)
            for (std::size_t j = 0; j < 9; j += 3)
                e[k] += g[j + rows[k]] * d[j + columns[k]] + d[j + rows[k]] * g[j + columns[k]];
    }
}

/// Twice the strain of a batch of cells, or what `change` says. `changes` are of corners 1 to 3,
/// less that of corner 0.
template <bool is_green, bool of_change, typename Real, typename V>
inline void twice_strain_asked(const StrainChange<Real> &change, const V *g, const V *h,
                               [[maybe_unused]] const V *changes, V *e) {
    twice_strain<is_green>(h, e);
    if constexpr (of_change) {
        V d[9], changed[6];
        gradient_of(g, changes, d);
        twice_change<is_green, Real>(h, d, changed);
        for (std::size_t k = 0; k < 6; ++k)
            e[k] = change.own * e[k] + change.factor * changed[k];
    }
}

/// det F; 1 for linear strain.
template <bool is_green, typename Real, typename V> inline V det_of(const V *h) {
    if constexpr (!is_green)
        return V{} + Real(1);
    const V f0 = h[0] + Real(1), f4 = h[4] + Real(1), f8 = h[8] + Real(1);
    return f0 * (f4 * f8 - h[5] * h[7]) - h[1] * (h[3] * f8 - h[5] * h[6]) +
           h[2] * (h[3] * h[7] - f4 * h[6]);
}

/// Forces on corners 1 to 3 by a stress times the volume, in the order of `twice_strain`.
template <bool is_green, typename V>
inline void forces_by(const V *h, const V *g, const V *s, V *edges) {
    V p[9] = {s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]};
    if constexpr (is_green)
        for (std::size_t i = 0; i < 9; i += 3) {
            p[i] += h[i] * s[0] + h[i + 1] * s[3] + h[i + 2] * s[4];
            p[i + 1] += h[i] * s[3] + h[i + 1] * s[1] + h[i + 2] * s[5];
            p[i + 2] += h[i] * s[4] + h[i + 1] * s[5] + h[i + 2] * s[2];
        }
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t i = 0; i < 3; ++i)
            edges[3 * a + i] =
                p[3 * i] * g[3 * a] + p[3 * i + 1] * g[3 * a + 1] + p[3 * i + 2] * g[3 * a + 2];
}

/// Forces on corners 1 to 3 of a batch of cells, in place of their displacements relative to corner
/// 0; returns det F (1 for linear strain). `changes`, relative to corner 0 too, is read
/// `of_change`.
template <typename Pack, bool is_green, bool of_change>
inline typename Pack::V forces_of_batch(const ForceJob<typename Pack::Real> &job, std::size_t batch,
                                        typename Pack::V *edges,
                                        [[maybe_unused]] const typename Pack::V *changes) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width;
    const Real *rest = job.rest + 10 * width * batch;
    V g[9], h[9], e[6];
    for (std::size_t k = 0; k < 9; ++k)
        g[k] = Pack::load(rest + k * width);
    gradient_of(g, edges, h);
    twice_strain_asked<is_green, of_change>(job.change, g, h, changes, e);
    const V volume = Pack::load(rest + 9 * width);
    V mu = V{} + job.mu, half_lmbda = V{} + Real(0.5) * job.lmbda;
    if (job.moduli) {
        half_lmbda = Real(0.5) * Pack::load(job.moduli + 3 * width * batch);
        mu = Pack::load(job.moduli + (3 * batch + 1) * width);
    }
    mu *= volume;
    const V trace = half_lmbda * volume * (e[0] + e[1] + e[2]);
    const V s[6] = {mu * e[0] + trace, mu * e[1] + trace, mu * e[2] + trace,
                    mu * e[3],         mu * e[4],         mu * e[5]};
    forces_by<is_green>(h, g, s, edges);
    return det_of<is_green, Real>(h);
}

/// The smallest number of a pack; one that is NaN is handed on.
template <typename Pack> typename Pack::Real least_of(const typename Pack::V &smallest) {
    auto least = smallest[0];
    for (std::size_t i = 1; i < Pack::width; ++i)
        least = smallest[i] > least ? least : smallest[i];
    return least;
}

#include "explicit/law_kernel.inl"

/// Those of one law, without a choice in the loop.
template <typename Pack, bool is_green, Law law, bool of_change = false>
typename Pack::Real add_batches(const ForceJob<typename Pack::Real> &job) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width;
    // Cells are read once a step, from memory if the body is large; asked for
    // some batches ahead.
    constexpr std::size_t rest_bytes = 10 * width * sizeof(Real);
    constexpr std::size_t record_bytes = 4 * width * sizeof(std::int32_t);
    constexpr std::size_t batches_ahead = 8192 / (rest_bytes + record_bytes);
    V smallest = V{} + Real(1);
    V edges[9]; // displacements of corners 1 to 3 less that of corner 0; then
                // forces
    [[maybe_unused]] V changes[9];
    for (std::size_t batch = job.first_batch; batch < job.last_batch; ++batch) {
        const std::int32_t *records = job.records + 4 * width * batch;
        const Real *rest = job.rest + 10 * width * batch;
        prefetch<record_bytes>(records, batches_ahead);
        prefetch<rest_bytes>(rest, batches_ahead);
        gather_edges<Pack>(job.displacement, records, edges);
        V least;
        if constexpr (of_change)
            gather_edges<Pack>(job.change.increment, records, changes);
        if constexpr (law == Law::saint_venant_kirchhoff)
            least = forces_of_batch<Pack, is_green, of_change>(job, batch, edges, changes);
        else
            least = forces_by_law<Pack, LawFormulas<law>>(job, batch, edges);
        // NaN counts as inverted: the comparison is false for it.
        smallest = least > smallest ? smallest : least;
        scatter_forces<Pack>(job.force, records, edges);
    }
    return least_of<Pack>(smallest);
}

template <typename Pack> typename Pack::Real add_forces(const ForceJob<typename Pack::Real> &job) {
    if (job.change.increment)
        return job.is_green ? add_batches<Pack, true, Law::saint_venant_kirchhoff, true>(job)
                            : add_batches<Pack, false, Law::saint_venant_kirchhoff, true>(job);
    if (!job.is_green)
        return add_batches<Pack, false, Law::saint_venant_kirchhoff>(job);
    return with_formulas(
        job.law, [&]<Law law>(LawFormulas<law>) { return add_batches<Pack, true, law>(job); },
        [&] { return add_batches<Pack, true, Law::saint_venant_kirchhoff>(job); });
}

/// The step of eq. 12; forces are left at zero. Returns whether all displacements are in bounds.
template <typename Pack> bool move_points(const MoveJob<typename Pack::Real> &job) {
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width;
    const V limit = V{} + job.limit, zero = {};
    auto inside = zero <= zero;
    for (std::size_t i = job.first; i < job.last; i += width) {
        const V force = Pack::load(job.external + i) - Pack::load(job.force + i);
        const V increment = next_increment(job.keep, Pack::load(job.increment + i),
                                           Pack::load(job.mobility + i), force);
        const V next = Pack::load(job.displacement + i) + increment;
        __builtin_memcpy(job.force + i, &zero, sizeof(V));
        __builtin_memcpy(job.increment + i, &increment, sizeof(V));
        __builtin_memcpy(job.displacement + i, &next, sizeof(V));
        // NaN counts as out of bounds: the comparison is false for it.
        inside &= (next <= limit) & (next >= -limit);
    }
    bool is_inside = true;
    for (std::size_t k = 0; k < width; ++k)
        is_inside = is_inside && inside[k] != 0;
    return is_inside;
}
