"""Checks shared by everything that takes points, cells or facets as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import IndexRangeError, NonFiniteError, ShapeError

# Three numbers for each of n points: positions, displacements or forces; shape (n, 3).
Points = NDArray[np.float64]
# Of any other shape: scalars, a flat vector over the degrees of freedom, 3 x 3 matrices.
Floats = NDArray[np.float64]
Indices = NDArray[np.int32]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]


def checked_points(points: Any) -> Points:
    """Points [m] as a read-only C-ordered float64 array, shape (num_points, 3).

    Raises:
        ShapeError: Not a table of three real columns.
        NonFiniteError: A coordinate is NaN or infinite.
    """
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise ShapeError(f"points need shape (num_points, 3) of reals, got {array.shape}")
    array = np.array(array, dtype=np.float64, order="C")
    is_finite = np.isfinite(array)
    if not is_finite.all():
        raise NonFiniteError(np.flatnonzero(~is_finite.all(axis=1)).tolist())
    array.setflags(write=False)
    return array


def checked_indices(indices: Any, width: int, num_points: int, what: str) -> Indices:
    """Index rows as a read-only C-ordered int32 array, shape (num_rows, width), (num_rows,) for 1.

    Raises:
        ShapeError: Wrong shape, or not whole numbers; `what` is the noun for the message ("cells").
        IndexRangeError: An index below 0 or not below num_points.
    """
    array = np.asarray(indices)
    shape = "(n,)" if width == 1 else f"(n, {width})"
    if array.size == 0:
        array = np.zeros((0,) if width == 1 else (0, width), dtype=np.int32)
    if array.dtype.kind not in "iu":
        raise ShapeError(f"{what} need whole numbers, got {array.dtype}")
    if (width == 1 and array.ndim != 1) or (
        width > 1 and (array.ndim != 2 or array.shape[1] != width)
    ):
        raise ShapeError(f"{what} need shape {shape}, got {array.shape}")
    if array.size and (array.min() < 0 or array.max() >= num_points):
        outside = (array < 0) | (array >= num_points)
        rows = np.flatnonzero(outside if width == 1 else outside.any(axis=1))
        raise IndexRangeError(what, rows.tolist(), num_points)
    array = np.array(array, dtype=np.int32, order="C")
    array.setflags(write=False)
    return array


def row_keys(rows: NDArray[np.int64]) -> NDArray[np.uint64]:
    """A number for each row of three: equal for equal rows, and hardly ever for others.

    Sorting these takes a fifth of the time of sorting rows.
    """
    # Odd constants of splitmix64 and xxHash; products wrap round.
    bits = rows.view(np.uint64)
    bits = (bits ^ (bits >> np.uint64(31))) * np.uint64(0xBF58476D1CE4E5B9)
    bits ^= bits >> np.uint64(32)
    factors = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
    keys: NDArray[np.uint64] = sum(
        bits[:, k] * np.uint64(factor) for k, factor in enumerate(factors)
    )  # type: ignore[assignment]
    return keys


def equal_points(points: Points) -> tuple[Integers, Integers]:
    """The first of each set of equal points, ascending, and the set of each point.

    Shapes (num_sets,) and (num_points,); -0.0 and 0.0 are equal.
    """
    same = np.ascontiguousarray(points) + 0.0
    keys = row_keys(same.view(np.int64))
    order = np.argsort(keys)
    if len(keys) == 0:
        return order, order
    ordered = keys[order]
    is_next = np.concatenate([[True], ordered[1:] != ordered[:-1]])
    first = np.minimum.reduceat(order, np.flatnonzero(is_next))
    inverse = np.empty_like(order)
    inverse[order] = np.cumsum(is_next) - 1
    if not np.array_equal(same[first][inverse], same):
        _, first, inverse = np.unique(same, axis=0, return_index=True, return_inverse=True)
        inverse = inverse.reshape(-1)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[inverse]
