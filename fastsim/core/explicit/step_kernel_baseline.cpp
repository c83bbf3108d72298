// The portable kernel: 16-byte vectors, which every target has or the compiler takes apart.
#include "explicit/step_kernel.hpp"
#include "explicit/sweep_kernel.hpp"

namespace fastsim {

namespace {

template <typename Number> struct Plain {
    using Real = Number;
    static constexpr std::size_t width = 16 / sizeof(Real);
    using V [[gnu::vector_size(16)]] = Real;

    [[gnu::always_inline]] static V load(const Real *p) {
        V v;
        for (std::size_t i = 0; i < width; ++i)
            v[i] = p[i];
        return v;
    }
    [[gnu::always_inline]] static V lookup(const Real *base, const std::int32_t *index) {
        V v;
        for (std::size_t i = 0; i < width; ++i)
            v[i] = base[index[i]];
        return v;
    }
    [[gnu::always_inline]] static void transpose(V *m) {
        for (std::size_t i = 0; i < width; ++i)
            for (std::size_t j = 0; j < i; ++j) {
                const Real moved = m[i][j];
                m[i][j] = m[j][i];
                m[j][i] = moved;
            }
    }
    [[gnu::always_inline]] static void gather(const Real *base, const std::int32_t *records, V &x,
                                              V &y, V &z) {
        for (std::size_t i = 0; i < width; ++i) {
            const Real *record = base + records[i];
            x[i] = record[0];
            y[i] = record[1];
            z[i] = record[2];
        }
    }
    [[gnu::always_inline]] static void scatter_add(Real *base, const std::int32_t *records, V x,
                                                   V y, V z) {
        for (std::size_t i = 0; i < width; ++i) {
            Real *record = base + records[i];
            record[0] += x[i];
            record[1] += y[i];
            record[2] += z[i];
        }
    }
};

#include "explicit/step_kernel.inl"
#include "explicit/sweep_kernel.inl"

} // namespace

KernelChoice<float> baseline_kernel_f32() {
    using Pack = Plain<float>;
    return {&add_forces<Pack>, &move_points<Pack>, Pack::width,
            &sweep<Pack>,      Pack::width,        "baseline"};
}

KernelChoice<double> baseline_kernel_f64() {
    using Pack = Plain<double>;
    return {&add_forces<Pack>, &move_points<Pack>, Pack::width,
            &sweep<Pack>,      Pack::width,        "baseline"};
}

} // namespace fastsim
