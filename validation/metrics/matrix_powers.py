"""Powers of symmetric positive tensors, by cell, that take complex numbers: see `finite_laws`.

Eigenvectors have no use for a complex step. The root is Denman and Beavers' iteration (Appl. Math.
Comput. 2, 1976); the logarithm is the series of artanh after four roots, the power its exponential
by Taylor's series of a 64th and six squares.
"""

from __future__ import annotations

from typing import Any

import numpy as np

_ONE = np.eye(3)
_ROOT_STEPS = 14
_ROOTS = 4
_LOG_TERMS = 8
_SQUARES, _EXP_TERMS = 6, 14


def root(C: Any) -> Any:
    """X with X X = C, both (n, 3, 3)."""
    # Scaled to a determinant of 1, so that the iteration starts near its end.
    scale = np.linalg.det(C)[:, None, None] ** (1.0 / 3.0)
    X, Y = C / scale, np.broadcast_to(_ONE, C.shape)
    for _ in range(_ROOT_STEPS):
        X, Y = 0.5 * (X + np.linalg.inv(Y)), 0.5 * (Y + np.linalg.inv(X))
    return X * np.sqrt(scale)


def power(C: Any, exponent: float) -> Any:
    """C to any power, (n, 3, 3)."""
    X = C
    for _ in range(_ROOTS):
        X = root(X)
    Z = np.linalg.solve(X + _ONE, X - _ONE)
    squared, total = Z @ Z, 0.0 * Z
    for n in range(_LOG_TERMS - 1, -1, -1):
        total = _ONE / (2 * n + 1) + squared @ total
    log = 2.0 * 2**_ROOTS * Z @ total
    A = exponent * log / 2**_SQUARES
    found = np.broadcast_to(_ONE, C.shape)
    for n in range(_EXP_TERMS, 0, -1):
        found = _ONE + A @ found / n
    for _ in range(_SQUARES):
        found = found @ found
    return found
