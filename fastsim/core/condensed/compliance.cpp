#include "condensed/compliance.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <vector>

namespace fastsim {

namespace {

/// Of the first block of a row.
std::size_t row_start(std::size_t row, std::size_t num_only_seen) {
    return 9 * Compliance::num_blocks(num_only_seen, row);
}

/// C^T f, or C f.
template <typename Real> Point transposed_times(const Real *c, const Point &f) {
    Point u;
    for (std::size_t a = 0; a < 3; ++a)
        u[a] = static_cast<double>(c[a]) * f[0] + static_cast<double>(c[3 + a]) * f[1] +
               static_cast<double>(c[6 + a]) * f[2];
    return u;
}
template <typename Real> Point times(const Real *c, const Point &f) {
    Point u;
    for (std::size_t a = 0; a < 3; ++a)
        u[a] = static_cast<double>(c[3 * a]) * f[0] + static_cast<double>(c[3 * a + 1]) * f[1] +
               static_cast<double>(c[3 * a + 2]) * f[2];
    return u;
}

} // namespace

CompliancePart Compliance::part(std::size_t i, std::size_t j) const {
    const std::size_t row = i < j ? j : i, column = i < j ? i : j;
    const std::size_t first = row_start(row, _num_only_seen) + 9 * (_num_only_seen + column);
    CompliancePart found{};
    std::visit(
        [&](const auto &numbers) {
            for (std::size_t a = 0; a < 3; ++a)
                for (std::size_t b = 0; b < 3; ++b)
                    found[3 * a + b] =
                        static_cast<double>(numbers[first + (i < j ? 3 * b + a : 3 * a + b)]);
        },
        _numbers);
    return found;
}

template <typename Real>
void Compliance::gather_column(std::size_t touched, std::span<Real> numbers) const {
    const std::size_t size = 3 * num_seen();
    std::visit(
        [&](const auto &all) {
            const auto *row = all.data() + row_start(touched, _num_only_seen);
            for (std::size_t s = 0; s <= _num_only_seen + touched; ++s, row += 9)
                for (std::size_t b = 0; b < 3; ++b)
                    for (std::size_t a = 0; a < 3; ++a)
                        numbers[b * size + 3 * s + a] = static_cast<Real>(row[3 * b + a]);
            for (std::size_t i = touched + 1; i < _num_touched; ++i) {
                const auto *block =
                    all.data() + row_start(i, _num_only_seen) + 9 * (_num_only_seen + touched);
                for (std::size_t b = 0; b < 3; ++b)
                    for (std::size_t a = 0; a < 3; ++a)
                        numbers[b * size + 3 * (_num_only_seen + i) + a] =
                            static_cast<Real>(block[3 * a + b]);
            }
        },
        _numbers);
}

template void Compliance::gather_column(std::size_t, std::span<float>) const;
template void Compliance::gather_column(std::size_t, std::span<double>) const;

void Compliance::add_response(std::span<const Point> forces, std::span<const std::int32_t> at,
                              std::span<Point> seen) const {
    std::vector<std::size_t> pushed;
    for (const std::int32_t point : at)
        if (forces[static_cast<std::size_t>(point)] != Point{})
            pushed.push_back(static_cast<std::size_t>(point));
    std::ranges::sort(pushed);
    std::visit(
        [&](const auto &numbers) {
            for (const std::size_t i : pushed) {
                const auto *block = numbers.data() + row_start(i, _num_only_seen);
                const Point force = forces[i];
                for (std::size_t s = 0; s <= _num_only_seen + i; ++s, block += 9)
                    seen[s] = along(seen[s], transposed_times(block, force), 1.0);
            }
            // Below its own row, a touched point's parts stand in the rows of the others.
            std::size_t count = 0;
            for (std::size_t row = pushed.empty() ? _num_touched : pushed[0] + 1;
                 row < _num_touched; ++row) {
                while (count < pushed.size() && pushed[count] < row)
                    ++count;
                const auto *first =
                    numbers.data() + row_start(row, _num_only_seen) + 9 * _num_only_seen;
                Point sum = seen[_num_only_seen + row];
                for (std::size_t k = 0; k < count; ++k)
                    sum = along(sum, times(first + 9 * pushed[k], forces[pushed[k]]), 1.0);
                seen[_num_only_seen + row] = sum;
            }
        },
        _numbers);
}

} // namespace fastsim
