#include "explicit/step_kernel.hpp"

#include <algorithm>

namespace fastsim {

InstructionSet widest_instruction_set() {
#ifdef FASTSIM_HAS_X86_KERNELS
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return InstructionSet::avx512;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return InstructionSet::avx2;
#endif
    return InstructionSet::baseline;
}

template <> KernelChoice<float> choose_kernel<float>(InstructionSet at_most) {
#ifdef FASTSIM_HAS_X86_KERNELS
    const InstructionSet set = std::min(at_most, widest_instruction_set());
    if (set == InstructionSet::avx512)
        return avx512_kernel_f32();
    if (set == InstructionSet::avx2)
        return avx2_kernel_f32();
#else
    static_cast<void>(at_most);
#endif
    return baseline_kernel_f32();
}

template <> KernelChoice<double> choose_kernel<double>(InstructionSet at_most) {
#ifdef FASTSIM_HAS_X86_KERNELS
    const InstructionSet set = std::min(at_most, widest_instruction_set());
    if (set == InstructionSet::avx512)
        return avx512_kernel_f64();
    if (set == InstructionSet::avx2)
        return avx2_kernel_f64();
#else
    static_cast<void>(at_most);
#endif
    return baseline_kernel_f64();
}

} // namespace fastsim
