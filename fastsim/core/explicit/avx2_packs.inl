// Packs of 8 floats and of 4 doubles, by AVX2 with fused multiply-add. Included by the kernels of
// both wider instruction sets, inside an unnamed namespace.

struct Float8 {
    using Real = float;
    using V = __m256;
    static constexpr std::size_t width = 8;

    [[gnu::always_inline]] static V load(const Real *p) { return _mm256_loadu_ps(p); }
    // With a source of zeros, since compilers warn of the one left undefined.
    [[gnu::always_inline]] static V lookup(const Real *base, const std::int32_t *index) {
        const V zero = _mm256_setzero_ps();
        const auto at = _mm256_loadu_si256(reinterpret_cast<const __m256i *>(index));
        return _mm256_mask_i32gather_ps(zero, base, at, _mm256_cmp_ps(zero, zero, _CMP_EQ_OQ), 4);
    }
    /// Rows become columns, eight of them.
    [[gnu::always_inline]] static void transpose(V *m) {
        V low[4], high[4]; // columns 0, 1 and 2, 3 of each half, of rows 2 k and 2 k + 1
        for (int k = 0; k < 4; ++k) {
            low[k] = _mm256_unpacklo_ps(m[2 * k], m[2 * k + 1]);
            high[k] = _mm256_unpackhi_ps(m[2 * k], m[2 * k + 1]);
        }
        for (int half = 0; half < 2; ++half) { // rows 4 half to 4 half + 3
            m[4 * half] = _mm256_shuffle_ps(low[2 * half], low[2 * half + 1], 0x44);
            m[4 * half + 1] = _mm256_shuffle_ps(low[2 * half], low[2 * half + 1], 0xee);
            m[4 * half + 2] = _mm256_shuffle_ps(high[2 * half], high[2 * half + 1], 0x44);
            m[4 * half + 3] = _mm256_shuffle_ps(high[2 * half], high[2 * half + 1], 0xee);
        }
        for (int k = 0; k < 4; ++k) {
            const V upper = m[k], lower = m[4 + k];
            m[k] = _mm256_permute2f128_ps(upper, lower, 0x20);
            m[4 + k] = _mm256_permute2f128_ps(upper, lower, 0x31);
        }
    }
    [[gnu::always_inline]] static V pair(const Real *low, const Real *high) {
        return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(low)), _mm_load_ps(high), 1);
    }
    [[gnu::always_inline]] static void gather(const Real *base, const std::int32_t *r, V &x, V &y,
                                              V &z) {
        const V a0 = pair(base + r[0], base + r[4]), a1 = pair(base + r[1], base + r[5]);
        const V a2 = pair(base + r[2], base + r[6]), a3 = pair(base + r[3], base + r[7]);
        const __m256d low0 = _mm256_castps_pd(_mm256_unpacklo_ps(a0, a1));
        const __m256d low1 = _mm256_castps_pd(_mm256_unpacklo_ps(a2, a3));
        x = _mm256_castpd_ps(_mm256_unpacklo_pd(low0, low1));
        y = _mm256_castpd_ps(_mm256_unpackhi_pd(low0, low1));
        z = _mm256_castpd_ps(_mm256_unpacklo_pd(_mm256_castps_pd(_mm256_unpackhi_ps(a0, a1)),
                                                _mm256_castps_pd(_mm256_unpackhi_ps(a2, a3))));
    }
    [[gnu::always_inline]] static void add(Real *record, __m128 v) {
        _mm_store_ps(record, _mm_add_ps(_mm_load_ps(record), v));
    }
    [[gnu::always_inline]] static void scatter_add(Real *base, const std::int32_t *r, V x, V y,
                                                   V z) {
        const V zero = _mm256_setzero_ps();
        const __m256d xy0 = _mm256_castps_pd(_mm256_unpacklo_ps(x, y));
        const __m256d xy1 = _mm256_castps_pd(_mm256_unpackhi_ps(x, y));
        const __m256d zw0 = _mm256_castps_pd(_mm256_unpacklo_ps(z, zero));
        const __m256d zw1 = _mm256_castps_pd(_mm256_unpackhi_ps(z, zero));
        const V v[4] = {_mm256_castpd_ps(_mm256_unpacklo_pd(xy0, zw0)),
                        _mm256_castpd_ps(_mm256_unpackhi_pd(xy0, zw0)),
                        _mm256_castpd_ps(_mm256_unpacklo_pd(xy1, zw1)),
                        _mm256_castpd_ps(_mm256_unpackhi_pd(xy1, zw1))};
        for (int k = 0; k < 4; ++k) {
            add(base + r[k], _mm256_castps256_ps128(v[k]));
            add(base + r[4 + k], _mm256_extractf128_ps(v[k], 1));
        }
    }
};

struct Double4 {
    using Real = double;
    using V = __m256d;
    static constexpr std::size_t width = 4;

    [[gnu::always_inline]] static V load(const Real *p) { return _mm256_loadu_pd(p); }
    [[gnu::always_inline]] static V lookup(const Real *base, const std::int32_t *index) {
        const V zero = _mm256_setzero_pd();
        const auto at = _mm_loadu_si128(reinterpret_cast<const __m128i *>(index));
        return _mm256_mask_i32gather_pd(zero, base, at, _mm256_cmp_pd(zero, zero, _CMP_EQ_OQ), 8);
    }
    [[gnu::always_inline]] static void transpose(V *m) {
        const V t0 = _mm256_unpacklo_pd(m[0], m[1]), t1 = _mm256_unpackhi_pd(m[0], m[1]);
        const V t2 = _mm256_unpacklo_pd(m[2], m[3]), t3 = _mm256_unpackhi_pd(m[2], m[3]);
        m[0] = _mm256_permute2f128_pd(t0, t2, 0x20);
        m[1] = _mm256_permute2f128_pd(t1, t3, 0x20);
        m[2] = _mm256_permute2f128_pd(t0, t2, 0x31);
        m[3] = _mm256_permute2f128_pd(t1, t3, 0x31);
    }
    [[gnu::always_inline]] static void gather(const Real *base, const std::int32_t *r, V &x, V &y,
                                              V &z) {
        const V a0 = _mm256_load_pd(base + r[0]), a1 = _mm256_load_pd(base + r[1]);
        const V a2 = _mm256_load_pd(base + r[2]), a3 = _mm256_load_pd(base + r[3]);
        const V xz0 = _mm256_unpacklo_pd(a0, a1), xz1 = _mm256_unpacklo_pd(a2, a3);
        x = _mm256_permute2f128_pd(xz0, xz1, 0x20);
        z = _mm256_permute2f128_pd(xz0, xz1, 0x31);
        y = _mm256_permute2f128_pd(_mm256_unpackhi_pd(a0, a1), _mm256_unpackhi_pd(a2, a3), 0x20);
    }
    [[gnu::always_inline]] static void add(Real *record, V v) {
        _mm256_store_pd(record, _mm256_add_pd(_mm256_load_pd(record), v));
    }
    [[gnu::always_inline]] static void scatter_add(Real *base, const std::int32_t *r, V x, V y,
                                                   V z) {
        const V zero = _mm256_setzero_pd();
        const V xy0 = _mm256_unpacklo_pd(x, y), xy1 = _mm256_unpackhi_pd(x, y);
        const V zw0 = _mm256_unpacklo_pd(z, zero), zw1 = _mm256_unpackhi_pd(z, zero);
        add(base + r[0], _mm256_permute2f128_pd(xy0, zw0, 0x20));
        add(base + r[1], _mm256_permute2f128_pd(xy1, zw1, 0x20));
        add(base + r[2], _mm256_permute2f128_pd(xy0, zw0, 0x31));
        add(base + r[3], _mm256_permute2f128_pd(xy1, zw1, 0x31));
    }
};
