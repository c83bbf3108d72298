"""Least squares over the free components: how much of each force would balance the body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.diagnosis.body import Mask

# Forces that differ by less cannot be told apart.
_DEPENDENT = 1e-9
# Rows for each unknown: fewer, and a fit says nothing.
_ROWS_EACH = 5


def fit(columns: Sequence[Points], target: Points, rows: Mask) -> Points | None:
    """Factors c with the least |sum c_k column_k - target|^2 over these components.

    Returns:
        (len(columns),); None where the columns cannot be told apart there, or one vanishes.
    """
    matrix = np.stack([column[rows] for column in columns], axis=1)
    wanted = target[rows]
    if not (np.isfinite(matrix).all() and np.isfinite(wanted).all()):
        return None
    sizes = np.abs(matrix).max(axis=0, initial=0.0)
    if len(matrix) < _ROWS_EACH * len(columns) or not (sizes > 0.0).all():
        return None
    factors, _, rank, _ = np.linalg.lstsq(matrix / sizes, wanted, rcond=_DEPENDENT)
    if rank < len(columns):
        return None
    found: Points = factors / sizes
    return found
