// The kernel for AVX-512: 16 floats or 8 doubles. Compiled with those flags.
#include "explicit/step_kernel.hpp"
#include "explicit/sweep_kernel.hpp"

#ifdef FASTSIM_HAS_X86_KERNELS
#include <immintrin.h>

namespace fastsim {

namespace {

struct Float16 {
    using Real = float;
    using V = __m512;
    static constexpr std::size_t width = 16;

    [[gnu::always_inline]] static V load(const Real *p) { return _mm512_loadu_ps(p); }
    [[gnu::always_inline]] static V four(const Real *base, const std::int32_t *r) {
        V v = _mm512_castps128_ps512(_mm_load_ps(base + r[0]));
        v = _mm512_insertf32x4(v, _mm_load_ps(base + r[4]), 1);
        v = _mm512_insertf32x4(v, _mm_load_ps(base + r[8]), 2);
        return _mm512_insertf32x4(v, _mm_load_ps(base + r[12]), 3);
    }
    [[gnu::always_inline]] static void gather(const Real *base, const std::int32_t *r, V &x, V &y,
                                              V &z) {
        const V a0 = four(base, r), a1 = four(base, r + 1);
        const V a2 = four(base, r + 2), a3 = four(base, r + 3);
        const __m512d low0 = _mm512_castps_pd(_mm512_unpacklo_ps(a0, a1));
        const __m512d low1 = _mm512_castps_pd(_mm512_unpacklo_ps(a2, a3));
        x = _mm512_castpd_ps(_mm512_unpacklo_pd(low0, low1));
        y = _mm512_castpd_ps(_mm512_unpackhi_pd(low0, low1));
        z = _mm512_castpd_ps(_mm512_unpacklo_pd(_mm512_castps_pd(_mm512_unpackhi_ps(a0, a1)),
                                                _mm512_castps_pd(_mm512_unpackhi_ps(a2, a3))));
    }
    [[gnu::always_inline]] static void add(Real *record, __m128 v) {
        _mm_store_ps(record, _mm_add_ps(_mm_load_ps(record), v));
    }
    [[gnu::always_inline]] static void add_four(Real *base, const std::int32_t *r, V v) {
        add(base + r[0], _mm512_castps512_ps128(v));
        add(base + r[4], _mm512_extractf32x4_ps(v, 1));
        add(base + r[8], _mm512_extractf32x4_ps(v, 2));
        add(base + r[12], _mm512_extractf32x4_ps(v, 3));
    }
    [[gnu::always_inline]] static void scatter_add(Real *base, const std::int32_t *r, V x, V y,
                                                   V z) {
        const V zero = _mm512_setzero_ps();
        const __m512d xy0 = _mm512_castps_pd(_mm512_unpacklo_ps(x, y));
        const __m512d xy1 = _mm512_castps_pd(_mm512_unpackhi_ps(x, y));
        const __m512d zw0 = _mm512_castps_pd(_mm512_unpacklo_ps(z, zero));
        const __m512d zw1 = _mm512_castps_pd(_mm512_unpackhi_ps(z, zero));
        add_four(base, r, _mm512_castpd_ps(_mm512_unpacklo_pd(xy0, zw0)));
        add_four(base, r + 1, _mm512_castpd_ps(_mm512_unpackhi_pd(xy0, zw0)));
        add_four(base, r + 2, _mm512_castpd_ps(_mm512_unpacklo_pd(xy1, zw1)));
        add_four(base, r + 3, _mm512_castpd_ps(_mm512_unpackhi_pd(xy1, zw1)));
    }
};

struct Double8 {
    using Real = double;
    using V = __m512d;
    static constexpr std::size_t width = 8;

    [[gnu::always_inline]] static V load(const Real *p) { return _mm512_loadu_pd(p); }
    [[gnu::always_inline]] static V pair(const Real *low, const Real *high) {
        return _mm512_insertf64x4(_mm512_castpd256_pd512(_mm256_load_pd(low)), _mm256_load_pd(high),
                                  1);
    }
    static __m512i even() { return _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13); }
    static __m512i odd() { return _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15); }
    [[gnu::always_inline]] static void gather(const Real *base, const std::int32_t *r, V &x, V &y,
                                              V &z) {
        const V a0 = pair(base + r[0], base + r[4]), a1 = pair(base + r[1], base + r[5]);
        const V a2 = pair(base + r[2], base + r[6]), a3 = pair(base + r[3], base + r[7]);
        const V xz0 = _mm512_unpacklo_pd(a0, a1), xz1 = _mm512_unpacklo_pd(a2, a3);
        x = _mm512_permutex2var_pd(xz0, even(), xz1);
        z = _mm512_permutex2var_pd(xz0, odd(), xz1);
        y = _mm512_permutex2var_pd(_mm512_unpackhi_pd(a0, a1), even(), _mm512_unpackhi_pd(a2, a3));
    }
    [[gnu::always_inline]] static void add(Real *record, __m256d v) {
        _mm256_store_pd(record, _mm256_add_pd(_mm256_load_pd(record), v));
    }
    [[gnu::always_inline]] static void scatter_add(Real *base, const std::int32_t *r, V x, V y,
                                                   V z) {
        const V zero = _mm512_setzero_pd();
        const V xy0 = _mm512_unpacklo_pd(x, y), xy1 = _mm512_unpackhi_pd(x, y);
        const V zw0 = _mm512_unpacklo_pd(z, zero), zw1 = _mm512_unpackhi_pd(z, zero);
        const V v[4] = {
            _mm512_permutex2var_pd(xy0, even(), zw0), _mm512_permutex2var_pd(xy1, even(), zw1),
            _mm512_permutex2var_pd(xy0, odd(), zw0), _mm512_permutex2var_pd(xy1, odd(), zw1)};
        for (int k = 0; k < 4; ++k) {
            add(base + r[k], _mm512_castpd512_pd256(v[k]));
            add(base + r[4 + k], _mm512_extractf64x4_pd(v[k], 1));
        }
    }
};

#include "explicit/avx2_packs.inl"
#include "explicit/step_kernel.inl"
#include "explicit/sweep_kernel.inl"

} // namespace

KernelChoice<float> avx512_kernel_f32() {
    return {&add_forces<Float16>, &move_points<Float16>, Float16::width,
            &sweep<Float8>,       Float8::width,         "avx512"};
}
KernelChoice<double> avx512_kernel_f64() {
    return {&add_forces<Double8>, &move_points<Double8>, Double8::width,
            &sweep<Double4>,      Double4::width,        "avx512"};
}

} // namespace fastsim
#endif
