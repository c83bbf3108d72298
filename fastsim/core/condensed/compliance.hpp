#pragma once
// Compliance of a body's touched points: displacements of seen points under forces on touched ones.
//
// u_s = sum over touched i of C_si f_i. C is symmetric between touched points, so that a touched
// point's row holds 3 x 3 blocks for all points that are only seen, then for the touched ones up
// to itself. Seen points are numbered so: the only seen ones first, then the touched ones.

#include "predicates/predicates.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>

namespace fastsim {

using CompliancePart = std::array<double, 9>; // row by row

class Compliance {
  public:
    using Numbers = std::variant<std::span<const float>, std::span<const double>>;

    /// `numbers`: all blocks, one after the other; C_is of row i and point s, row by row.
    Compliance(Numbers numbers, std::size_t num_only_seen, std::size_t num_touched)
        : _numbers(numbers), _num_only_seen(num_only_seen), _num_touched(num_touched) {}

    static std::size_t num_blocks(std::size_t num_only_seen, std::size_t num_touched) {
        return num_touched * num_only_seen + num_touched * (num_touched + 1) / 2;
    }
    /// Whether the numbers are kept in single precision.
    [[nodiscard]] bool is_single() const { return _numbers.index() == 0; }
    [[nodiscard]] std::size_t num_only_seen() const { return _num_only_seen; }
    [[nodiscard]] std::size_t num_touched() const { return _num_touched; }
    [[nodiscard]] std::size_t num_seen() const { return _num_only_seen + _num_touched; }

    /// C between two touched points: displacement of `i` under a force at `j`.
    [[nodiscard]] CompliancePart part(std::size_t i, std::size_t j) const;
    /// Displacements of the seen points under a force of 1 along x at a touched one, then along y
    /// and z: 3 * 3 * num_seen() numbers.
    template <typename Real> void gather_column(std::size_t touched, std::span<Real> numbers) const;
    /// Adds the displacement of every seen point under forces at some touched ones.
    void add_response(std::span<const Point> forces, std::span<const std::int32_t> at,
                      std::span<Point> seen) const;

  private:
    Numbers _numbers;
    std::size_t _num_only_seen, _num_touched;
};

} // namespace fastsim
