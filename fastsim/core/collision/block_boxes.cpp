#include "collision/block_boxes.hpp"

#ifdef FASTSIM_HAS_X86_KERNELS
#include <immintrin.h>
#endif

namespace fastsim {

// One function for each instruction set, chosen at run time. Comparisons only: nothing is rounded.
struct HoldingBoxes {
    static void plain(const BlockBoxes &b, const PointTable &table,
                      std::span<const std::uint32_t> rows, std::uint64_t *bits) {
        for (const std::uint32_t row : rows) {
            const double *point = table.first + row * table.stride;
            std::uint64_t found = 0;
            for (std::size_t k = 0; k < b._count; ++k) {
                bool holds = true;
                for (std::size_t i = 0; i < 3; ++i)
                    holds = holds & (b._low[i][k] <= point[i]) & (b._high[i][k] >= point[i]);
                found |= std::uint64_t{holds} << k;
            }
            *bits++ = found;
        }
    }

#ifdef FASTSIM_HAS_X86_KERNELS
    __attribute__((target("avx2"))) static void avx2(const BlockBoxes &b, const PointTable &table,
                                                     std::span<const std::uint32_t> rows,
                                                     std::uint64_t *bits) {
        for (const std::uint32_t row : rows) {
            __m256d point[3];
            for (std::size_t i = 0; i < 3; ++i)
                point[i] = _mm256_set1_pd(table.first[row * table.stride + i]);
            std::uint64_t found = 0;
            for (std::size_t k = 0; k < b._count; k += 4) {
                __m256d holds = _mm256_and_pd(
                    _mm256_cmp_pd(_mm256_load_pd(&b._low[0][k]), point[0], _CMP_LE_OQ),
                    _mm256_cmp_pd(_mm256_load_pd(&b._high[0][k]), point[0], _CMP_GE_OQ));
                for (std::size_t i = 1; i < 3; ++i) {
                    holds = _mm256_and_pd(
                        holds, _mm256_cmp_pd(_mm256_load_pd(&b._low[i][k]), point[i], _CMP_LE_OQ));
                    holds = _mm256_and_pd(
                        holds, _mm256_cmp_pd(_mm256_load_pd(&b._high[i][k]), point[i], _CMP_GE_OQ));
                }
                found |= static_cast<std::uint64_t>(_mm256_movemask_pd(holds)) << k;
            }
            *bits++ = found;
        }
    }

    __attribute__((target("avx512f"))) static void avx512(const BlockBoxes &b,
                                                          const PointTable &table,
                                                          std::span<const std::uint32_t> rows,
                                                          std::uint64_t *bits) {
        for (const std::uint32_t row : rows) {
            __m512d point[3];
            for (std::size_t i = 0; i < 3; ++i)
                point[i] = _mm512_set1_pd(table.first[row * table.stride + i]);
            std::uint64_t found = 0;
            for (std::size_t k = 0; k < b._count; k += 8) {
                __mmask8 holds = 0xff;
                for (std::size_t i = 0; i < 3; ++i) {
                    holds = _mm512_mask_cmp_pd_mask(holds, _mm512_load_pd(&b._low[i][k]), point[i],
                                                    _CMP_LE_OQ);
                    holds = _mm512_mask_cmp_pd_mask(holds, _mm512_load_pd(&b._high[i][k]), point[i],
                                                    _CMP_GE_OQ);
                }
                found |= std::uint64_t{holds} << k;
            }
            *bits++ = found;
        }
    }
#endif

    static BlockBoxes::FindHolding widest(InstructionSet at_most) {
#ifdef FASTSIM_HAS_X86_KERNELS
        const InstructionSet set = std::min(at_most, widest_instruction_set());
        if (set == InstructionSet::avx512)
            return avx512;
        if (set == InstructionSet::avx2)
            return avx2;
#else
        static_cast<void>(at_most);
#endif
        return plain;
    }
};

BlockBoxes::BlockBoxes(InstructionSet at_most) : _find_holding(HoldingBoxes::widest(at_most)) {}

void BlockBoxes::resize(std::size_t count) {
    _count = count;
    // The widest vectors read on to a multiple of eight.
    for (std::size_t k = count; k % 8 != 0; ++k)
        set(k, Extent::nothing());
}

} // namespace fastsim
