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

/// Forces on corners 1 to 3 of a batch of cells, in place of their
/// displacements relative to corner 0; returns det F (1 for linear strain).
template <typename Pack, bool is_green>
inline typename Pack::V forces_of_batch(const ForceJob<typename Pack::Real> &job, std::size_t batch,
                                        typename Pack::V *edges) {
    using Real = typename Pack::Real;
    using V = typename Pack::V;
    constexpr std::size_t width = Pack::width;
    const Real *rest = job.rest + 10 * width * batch;
    V least = V{} + Real(1);
    V g[9];
    for (std::size_t k = 0; k < 9; ++k)
        g[k] = Pack::load(rest + k * width);
    V h[9] = {};
    for (std::size_t a = 0; a < 3; ++a) {
        const V x = edges[3 * a], y = edges[3 * a + 1], z = edges[3 * a + 2];
        for (std::size_t j = 0; j < 3; ++j) {
            h[j] += x * g[3 * a + j];
            h[3 + j] += y * g[3 * a + j];
            h[6 + j] += z * g[3 * a + j];
        }
    }
    // Twice the strain, from H and not from F^T F - I: no cancellation.
    V e00 = h[0] + h[0], e11 = h[4] + h[4], e22 = h[8] + h[8];
    V e01 = h[1] + h[3], e02 = h[2] + h[6], e12 = h[5] + h[7];
    if constexpr (is_green) {
        e00 += h[0] * h[0] + h[3] * h[3] + h[6] * h[6];
        e11 += h[1] * h[1] + h[4] * h[4] + h[7] * h[7];
        e22 += h[2] * h[2] + h[5] * h[5] + h[8] * h[8];
        e01 += h[0] * h[1] + h[3] * h[4] + h[6] * h[7];
        e02 += h[0] * h[2] + h[3] * h[5] + h[6] * h[8];
        e12 += h[1] * h[2] + h[4] * h[5] + h[7] * h[8];
    }
    const V volume = Pack::load(rest + 9 * width);
    V mu = V{} + job.mu, half_lmbda = V{} + Real(0.5) * job.lmbda;
    if (job.lame) {
        half_lmbda = Real(0.5) * Pack::load(job.lame + 2 * width * batch);
        mu = Pack::load(job.lame + (2 * batch + 1) * width);
    }
    mu *= volume;
    const V trace = half_lmbda * volume * (e00 + e11 + e22);
    const V s00 = mu * e00 + trace, s11 = mu * e11 + trace, s22 = mu * e22 + trace;
    const V s01 = mu * e01, s02 = mu * e02, s12 = mu * e12;
    V p[9] = {s00, s01, s02, s01, s11, s12, s02, s12, s22};
    if constexpr (is_green) {
        for (std::size_t i = 0; i < 9; i += 3) {
            p[i] += h[i] * s00 + h[i + 1] * s01 + h[i + 2] * s02;
            p[i + 1] += h[i] * s01 + h[i + 1] * s11 + h[i + 2] * s12;
            p[i + 2] += h[i] * s02 + h[i + 1] * s12 + h[i + 2] * s22;
        }
        const V f0 = h[0] + Real(1), f4 = h[4] + Real(1), f8 = h[8] + Real(1);
        const V det = f0 * (f4 * f8 - h[5] * h[7]) - h[1] * (h[3] * f8 - h[5] * h[6]) +
                      h[2] * (h[3] * h[7] - f4 * h[6]);
        least = det;
    }
    for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t i = 0; i < 3; ++i)
            edges[3 * a + i] =
                p[3 * i] * g[3 * a] + p[3 * i + 1] * g[3 * a + 1] + p[3 * i + 2] * g[3 * a + 2];
    }
    return least;
}

template <typename Pack, bool is_green>
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
    for (std::size_t batch = job.first_batch; batch < job.last_batch; ++batch) {
        const std::int32_t *records = job.records + 4 * width * batch;
        const Real *rest = job.rest + 10 * width * batch;
        prefetch<record_bytes>(records, batches_ahead);
        prefetch<rest_bytes>(rest, batches_ahead);
        V x0, y0, z0;
        Pack::gather(job.displacement, records, x0, y0, z0);
        for (std::size_t a = 0; a < 3; ++a) {
            V x, y, z;
            Pack::gather(job.displacement, records + (a + 1) * width, x, y, z);
            edges[3 * a] = x - x0;
            edges[3 * a + 1] = y - y0;
            edges[3 * a + 2] = z - z0;
        }
        const V least = forces_of_batch<Pack, is_green>(job, batch, edges);
        // NaN counts as inverted: the comparison is false for it.
        smallest = least > smallest ? smallest : least;
        for (std::size_t a = 0; a < 3; ++a)
            Pack::scatter_add(job.force, records + (a + 1) * width, edges[3 * a], edges[3 * a + 1],
                              edges[3 * a + 2]);
        Pack::scatter_add(job.force, records, -(edges[0] + edges[3] + edges[6]),
                          -(edges[1] + edges[4] + edges[7]), -(edges[2] + edges[5] + edges[8]));
    }
    Real least = smallest[0];
    for (std::size_t i = 1; i < width; ++i)
        least = smallest[i] > least ? least : smallest[i];
    return least;
}

template <typename Pack> typename Pack::Real add_forces(const ForceJob<typename Pack::Real> &job) {
    return job.is_green ? add_batches<Pack, true>(job) : add_batches<Pack, false>(job);
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
