#include "condensed/complementarity.hpp"

#include "condensed/small_system.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastsim {

namespace {

constexpr int most_changes_at_once = 12;
// Of the largest term of a row: below this a slack is a rounding.
constexpr double rounding = 1e-14;

} // namespace

bool Complementarity::solve(std::span<const double> a, std::span<const double> q,
                            std::span<double> p) {
    const std::size_t n = q.size();
    _pushes.assign(n, false);
    for (std::size_t i = 0; i < n; ++i)
        _pushes[i] = p[i] > 0.0 || slack(a, q, p, i) < 0.0;
    for (int change = 0; change < most_changes_at_once; ++change) {
        if (!solve_pushing(a, q, n))
            return false;
        bool is_right = true;
        for (std::size_t i = 0; i < n; ++i) {
            const bool pushes = _pushes[i] ? _found[i] > 0.0 : slack(a, q, _found, i) < 0.0;
            is_right = is_right && pushes == _pushes[i];
            _pushes[i] = pushes;
        }
        if (is_right) {
            std::ranges::copy(_found, p.begin());
            return true;
        }
    }
    return walk_down(a, q, p);
}

/// A p + q in a row; 0 where it is a rounding.
double Complementarity::slack(std::span<const double> a, std::span<const double> q,
                              std::span<const double> p, std::size_t row) const {
    double sum = q[row], size = std::abs(q[row]);
    for (std::size_t j = 0; j < p.size(); ++j) {
        const double term = a[row * p.size() + j] * p[j];
        sum += term;
        size = std::max(size, std::abs(term));
    }
    return std::abs(sum) <= rounding * size ? 0.0 : sum;
}

/// Where rows that push have no slack, and the others no push.
bool Complementarity::solve_pushing(std::span<const double> a, std::span<const double> q,
                                    std::size_t n) {
    _rows.clear();
    for (std::size_t i = 0; i < n; ++i)
        if (_pushes[i])
            _rows.push_back(i);
    const std::size_t m = _rows.size();
    _matrix.resize(m * m);
    _right.resize(m);
    for (std::size_t i = 0; i < m; ++i) {
        for (std::size_t j = 0; j < m; ++j)
            _matrix[i * m + j] = a[_rows[i] * n + _rows[j]];
        _right[i] = -q[_rows[i]];
    }
    _found.assign(n, 0.0);
    if (!solve_small(_matrix, _right, m, 1))
        return false;
    for (std::size_t i = 0; i < m; ++i)
        _found[_rows[i]] = _right[i];
    return true;
}

bool Complementarity::walk_down(std::span<const double> a, std::span<const double> q,
                                std::span<double> p) {
    const std::size_t n = q.size();
    std::ranges::fill(p, 0.0);
    _pushes.assign(n, false);
    for (std::size_t count = 0; count < 4 * n + 8; ++count) {
        std::size_t worst = n;
        double least = 0.0;
        for (std::size_t i = 0; i < n; ++i) {
            const double here = _pushes[i] ? 0.0 : slack(a, q, p, i);
            if (here < least) {
                least = here;
                worst = i;
            }
        }
        if (worst == n)
            return true;
        _pushes[worst] = true;
        for (std::size_t cut = 0; cut <= n; ++cut) {
            if (!solve_pushing(a, q, n))
                return false;
            // As far as no push changes its sign.
            double part = 1.0;
            std::size_t first = n;
            for (const std::size_t i : _rows)
                if (_found[i] <= 0.0 && p[i] - _found[i] > 0.0 &&
                    p[i] / (p[i] - _found[i]) < part) {
                    part = p[i] / (p[i] - _found[i]);
                    first = i;
                }
            for (const std::size_t i : _rows)
                p[i] += part * (_found[i] - p[i]);
            if (first == n)
                break;
            p[first] = 0.0;
            _pushes[first] = false;
            if (first == worst && part == 0.0)
                return false;
        }
    }
    return false;
}

} // namespace fastsim
