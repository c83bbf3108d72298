#include "collision/block_boxes.hpp"

#ifdef FASTSIM_HAS_X86_KERNELS
#include <immintrin.h>
#endif

namespace fastsim {

// One function for each instruction set, chosen at run time. Comparisons only: nothing is rounded.
struct MeetingBoxes {
    static std::uint64_t plain(const BlockBoxes &b, const Extent &box) {
        std::uint64_t bits = 0;
        for (std::size_t k = 0; k < b._count; ++k) {
            bool meets = true;
            for (std::size_t i = 0; i < 3; ++i)
                meets = meets & (b._low[i][k] <= box.high[i]) & (b._high[i][k] >= box.low[i]);
            bits |= std::uint64_t{meets} << k;
        }
        return bits;
    }

#ifdef FASTSIM_HAS_X86_KERNELS
    __attribute__((target("avx2"))) static std::uint64_t avx2(const BlockBoxes &b,
                                                              const Extent &box) {
        std::uint64_t bits = 0;
        for (std::size_t k = 0; k < b._count; k += 4) {
            __m256d meets = _mm256_and_pd(_mm256_cmp_pd(_mm256_load_pd(&b._low[0][k]),
                                                        _mm256_set1_pd(box.high[0]), _CMP_LE_OQ),
                                          _mm256_cmp_pd(_mm256_load_pd(&b._high[0][k]),
                                                        _mm256_set1_pd(box.low[0]), _CMP_GE_OQ));
            for (std::size_t i = 1; i < 3; ++i) {
                meets =
                    _mm256_and_pd(meets, _mm256_cmp_pd(_mm256_load_pd(&b._low[i][k]),
                                                       _mm256_set1_pd(box.high[i]), _CMP_LE_OQ));
                meets = _mm256_and_pd(meets, _mm256_cmp_pd(_mm256_load_pd(&b._high[i][k]),
                                                           _mm256_set1_pd(box.low[i]), _CMP_GE_OQ));
            }
            bits |= static_cast<std::uint64_t>(_mm256_movemask_pd(meets)) << k;
        }
        return bits;
    }

    __attribute__((target("avx512f"))) static std::uint64_t avx512(const BlockBoxes &b,
                                                                   const Extent &box) {
        std::uint64_t bits = 0;
        for (std::size_t k = 0; k < b._count; k += 8) {
            __mmask8 meets = 0xff;
            for (std::size_t i = 0; i < 3; ++i) {
                meets = _mm512_mask_cmp_pd_mask(meets, _mm512_load_pd(&b._low[i][k]),
                                                _mm512_set1_pd(box.high[i]), _CMP_LE_OQ);
                meets = _mm512_mask_cmp_pd_mask(meets, _mm512_load_pd(&b._high[i][k]),
                                                _mm512_set1_pd(box.low[i]), _CMP_GE_OQ);
            }
            bits |= std::uint64_t{meets} << k;
        }
        return bits;
    }
#endif

    static BlockBoxes::Meeting widest() {
#ifdef FASTSIM_HAS_X86_KERNELS
        if (__builtin_cpu_supports("avx512f"))
            return avx512;
        if (__builtin_cpu_supports("avx2"))
            return avx2;
#endif
        return plain;
    }
};

BlockBoxes::BlockBoxes() : _meeting(MeetingBoxes::widest()) {}

void BlockBoxes::resize(std::size_t count) {
    _count = count;
    for (std::size_t k = count; k < capacity; ++k)
        set(k, Extent::nothing());
}

} // namespace fastsim
