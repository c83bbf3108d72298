"""The sum of the principal stretches in UFL, without eigenvalues.

Closed forms of eigenvalues have no derivative where two are equal, as they are at rest. Here all is
a smooth function of the invariants I = tr C and II of a C with det C = 1. The invariants i, ii of
U = root of C solve i^2 - 2 ii = I, ii^2 - 2 i = II (A. Hoger, D. E. Carlson, Q. Appl. Math. 42,
1984). Newton's method from i^2 = 3 I, ii^2 = 3 II, which is never below, is quadratic everywhere:
its determinant is 4 times the product of the sums of two stretches.
"""

from __future__ import annotations

from typing import Any

from palpate.reference.fenicsx import ufl

# Five reach rounding for stretches up to 20, and their derivatives with them: the step is exact to
# second order at the root.
_NEWTON_STEPS = 6


def root_invariants(first: Any, second: Any) -> tuple[Any, Any]:
    """Invariants of the root of a tensor with determinant 1, of the tensor's first two."""
    i, ii = ufl.sqrt(3 * first), ufl.sqrt(3 * second)
    for _ in range(_NEWTON_STEPS):
        above, below = i**2 - 2 * ii - first, ii**2 - 2 * i - second
        half = 2 * (i * ii - 1)
        i, ii = i - (ii * above + below) / half, ii - (above + i * below) / half
    return i, ii
