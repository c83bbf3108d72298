#pragma once
// Four numbers at once.

// Wider registers where the processor has them; contraction is off, so the results are the same.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) &&                             \
    !defined(__SANITIZE_ADDRESS__)
#define PALPATE_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define PALPATE_WIDE
#endif

namespace fastsim {

// In registers as wide as there are (vector types of GCC and Clang).
typedef double Four __attribute__((vector_size(32)));

} // namespace fastsim
