#include "condensed/compliance.hpp"

namespace fastsim {

namespace {

/// Of the first block of a row.
std::size_t row_start(std::size_t row, std::size_t num_only_seen) {
    return 9 * Compliance::num_blocks(num_only_seen, row);
}

/// u += C^T f.
template <typename Real> void add_transposed(const Real *c, const Point &f, Point &u) {
    for (std::size_t a = 0; a < 3; ++a)
        u[a] += static_cast<double>(c[a]) * f[0] + static_cast<double>(c[3 + a]) * f[1] +
                static_cast<double>(c[6 + a]) * f[2];
}

/// u += C f.
template <typename Real> void add(const Real *c, const Point &f, Point &u) {
    for (std::size_t a = 0; a < 3; ++a)
        u[a] += static_cast<double>(c[3 * a]) * f[0] + static_cast<double>(c[3 * a + 1]) * f[1] +
                static_cast<double>(c[3 * a + 2]) * f[2];
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

void Compliance::add_response(std::size_t touched, const Point &force,
                              std::span<Point> seen) const {
    std::visit(
        [&](const auto &numbers) {
            const auto *block = numbers.data() + row_start(touched, _num_only_seen);
            for (std::size_t s = 0; s <= _num_only_seen + touched; ++s, block += 9)
                add_transposed(block, force, seen[s]);
            // Further down, column by column: each row is a block longer than the one before.
            block += 9 * (_num_only_seen + touched);
            for (std::size_t row = touched + 1; row < _num_touched; ++row) {
                add(block, force, seen[_num_only_seen + row]);
                block += 9 * (_num_only_seen + row + 1);
            }
        },
        _numbers);
}

} // namespace fastsim
