"""Numbers that a NaN cannot slip out of: Python's max, min and comparisons pass it over."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import State

# Displacements [m] beyond this have no volume that a number can hold.
_LARGEST = 1e100


def largest(values: Iterable[float]) -> float:
    """The largest; infinity where one is NaN, 0 of none."""
    found = np.fromiter(values, dtype=np.float64)
    if not found.size:
        return 0.0
    return math.inf if np.isnan(found).any() else float(found.max())


def smallest(values: Iterable[float]) -> float:
    """The smallest; minus infinity where one is NaN, 0 of none."""
    return -largest(-float(value) for value in values)


def are_measurable(*arrays: NDArray[Any]) -> bool:
    """Whether all numbers are finite, and small enough to be squared and multiplied."""
    return all(bool((np.abs(array) < _LARGEST).all()) for array in arrays)


def measurable_rows(array: NDArray[Any]) -> NDArray[np.bool_]:
    """Which rows hold such numbers alone, (num_rows,)."""
    rows: NDArray[np.bool_] = (np.abs(array) < _LARGEST).all(axis=1)
    return rows


# Of the body's size.
_ROUNDING = float(np.finfo(np.float64).eps)


def is_still(mesh: TetMesh, state: State) -> bool:
    """Whether a state moves nowhere, at no time, by more than the rounding of the body's places."""
    size = float(np.ptp(mesh.points, axis=0).max())
    return all(bool((np.abs(u) <= _ROUNDING * size).all()) for u in state.fields)
