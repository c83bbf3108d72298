#pragma once
// Linear complementarity: A p + q >= 0, p >= 0, and one of them 0 in each row; A is symmetric and
// positive definite, so that p is unique and minimises p A p / 2 + q p over p >= 0.

#include <cstddef>
#include <span>
#include <vector>

namespace fastsim {

class Complementarity {
  public:
    /// Solves for p, which holds a guess: what is above 0 there, or below 0 in q with p at 0, is
    /// taken to push. All rows that are wrong change at a time (Kostreva 1978); where that goes
    /// round, one by one down the potential (Lawson and Hanson 1974, chapter 23). `a` has n x n
    /// numbers, row by row. False where A is not positive definite.
    bool solve(std::span<const double> a, std::span<const double> q, std::span<double> p);

  private:
    bool solve_pushing(std::span<const double> a, std::span<const double> q, std::size_t n);
    bool walk_down(std::span<const double> a, std::span<const double> q, std::span<double> p);
    double slack(std::span<const double> a, std::span<const double> q, std::span<const double> p,
                 std::size_t row) const;

    std::vector<bool> _pushes;
    std::vector<std::size_t> _rows;
    std::vector<double> _matrix, _right, _found;
};

} // namespace fastsim
