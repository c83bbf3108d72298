"""A label image made by code: two organs with a common wall, a vessel, a tumour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NAMES = {1: "liver", 2: "spleen", 3: "vessel", 4: "tumour"}


def phantom_labels(count: int) -> NDArray[np.int32]:
    """Labels, shape (count, count, count)."""
    x, y, z = np.meshgrid(*[(np.arange(count) + 0.5) / count * 2 - 1] * 3, indexing="ij")
    labels = np.zeros((count,) * 3, np.int32)
    body = (x / 0.85) ** 2 + (y / 0.6) ** 2 + (z / 0.6) ** 2 < 1
    is_left = body & (x < 0.05)
    labels[body] = 2
    labels[is_left] = 1
    labels[is_left & ((x + 0.35) ** 2 + y**2 < 0.15**2)] = 3
    labels[(x - 0.4) ** 2 + y**2 + z**2 < 0.2**2] = 4
    return labels
