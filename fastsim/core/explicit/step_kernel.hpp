#pragma once
// Internal forces of many cells at once: batches of cells in structure-of-arrays form.
//
//   node records are padded to four numbers, loaded whole and transposed in registers;
//   forces are transposed back and added record by record, so no colouring is needed.
//
// One source, step_kernel.inl, compiled once for each instruction set; chosen at run time.
// Those translation units include no library templates: an inline function built for AVX-512
// must not become the copy that the linker keeps for everybody.

#include "explicit/central_difference.hpp"
#include "mechanics/law.hpp"

#include <cstddef>
#include <cstdint>

namespace fastsim {

/// Of what stresses are, where increments are given: `own` times the strain, and `factor` times
/// what it has changed by over them.
template <typename Real> struct StrainChange {
    const Real *increment = nullptr; // records of 4
    Real own = 0, factor = 0;
};

template <typename Real> struct ForceJob {
    const Real *displacement; // records of 4
    StrainChange<Real> change;
    Real *force;                 // records of 4; forces are added
    const std::int32_t *records; // each batch: 4 corners x width, offsets into the arrays above
    const Real *rest;            // each batch: 9 gradient entries and the volume, x width
    std::size_t first_batch;
    std::size_t last_batch;
    const Real *moduli; // each batch: lmbda, mu and c01, x width; null where they are the same
    Real lmbda;         // everywhere
    Real mu;
    Real c01;
    bool is_green;
    Law law; // under Green strain
};

/// Adds the forces; returns the smallest det F met (1 for linear strain).
template <typename Real> using ForceKernel = Real (*)(const ForceJob<Real> &);

template <typename Real> struct MoveJob {
    Real *displacement, *increment, *force; // records of 4
    const Real *external, *mobility;
    std::size_t first, last; // entries, multiples of `longest_pack`
    Real keep, limit;
};

template <typename Real> using MoveKernel = bool (*)(const MoveJob<Real> &);

inline constexpr std::size_t longest_pack = 16; // numbers

template <typename Real> struct SweepJob; // sweep_kernel.hpp
template <typename Real> using SweepKernel = Real (*)(const SweepJob<Real> &);

template <typename Real> struct KernelChoice {
    ForceKernel<Real> add_forces;
    MoveKernel<Real> move_points;
    std::size_t width; // cells in a batch
    SweepKernel<Real> sweep;
    std::size_t sweep_width;
    const char *name;
};

enum class InstructionSet { baseline, avx2, avx512 };

KernelChoice<float> baseline_kernel_f32();
KernelChoice<double> baseline_kernel_f64();
#ifdef FASTSIM_HAS_X86_KERNELS
KernelChoice<float> avx2_kernel_f32();
KernelChoice<double> avx2_kernel_f64();
KernelChoice<float> avx512_kernel_f32();
KernelChoice<double> avx512_kernel_f64();
#endif

/// The widest set this processor has.
InstructionSet widest_instruction_set();

/// The kernel for a set, or for the widest below it that the processor has.
template <typename Real> KernelChoice<Real> choose_kernel(InstructionSet at_most);

} // namespace fastsim
