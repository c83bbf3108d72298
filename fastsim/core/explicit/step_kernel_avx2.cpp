// The kernel for AVX2 with fused multiply-add: 8 floats or 4 doubles. Compiled with those flags.
#include "explicit/step_kernel.hpp"
#include "explicit/sweep_kernel.hpp"

#ifdef FASTSIM_HAS_X86_KERNELS
#include <immintrin.h>

namespace fastsim {

namespace {

#include "explicit/avx2_packs.inl"
#include "explicit/step_kernel.inl"
#include "explicit/sweep_kernel.inl"

} // namespace

KernelChoice<float> avx2_kernel_f32() {
    return {&add_forces<Float8>, &move_points<Float8>, Float8::width,
            &sweep<Float8>,      Float8::width,        "avx2"};
}
KernelChoice<double> avx2_kernel_f64() {
    return {&add_forces<Double4>, &move_points<Double4>, Double4::width,
            &sweep<Double4>,      Double4::width,        "avx2"};
}

} // namespace fastsim
#endif
