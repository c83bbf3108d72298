"""Points of a surface that are nearly the same place."""

from __future__ import annotations

import itertools

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.facet_topology import Integers

# Of the longest side of the bounding box: some ten roundings of single precision, in which STL
# files are written (eps 1.2e-7).
NEAR = 1e-6

# All pairs in a box are compared; more points than this mean a distance without sense.
_MOST_IN_A_BOX = 1000


def find_near_duplicates(points: Points, distance: float | None = None) -> Integers:
    """Pairs of points within a distance of each other, equal ones included.

    Args:
        points: [m], shape (num_points, 3).
        distance: [m], >= 0; None takes `NEAR` of the longest side of the bounding box.

    Returns:
        Pairs, ascending, shape (num_pairs, 2).

    Raises:
        InputError: The distance is not a number >= 0, or so large that a thousand points lie in it.
    """
    if len(points) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    size = float(np.ptp(points, axis=0).max())
    reach = NEAR * size if distance is None else distance
    if not (np.isfinite(reach) and reach >= 0.0):
        raise InputError(f"distance = {reach:g} m: needs a finite value of at least 0")
    # Boxes of twice the reach, laid out eight times with a shift of half a box: any two points
    # within the reach share a box in one of them.
    box = max(
        2.0 * reach, 8.0 * float(np.finfo(float).eps) * max(float(np.abs(points).max()), size)
    )
    scaled = (points - points.min(axis=0)) / box if box > 0.0 else points * 0.0
    found = []
    for shift in itertools.product((0.0, 0.5), repeat=3):
        key = np.unique(
            np.floor(scaled + np.array(shift)).astype(np.int64), axis=0, return_inverse=True
        )[1].reshape(-1)
        order = np.argsort(key, kind="stable")
        crowd = int(np.bincount(key).max())
        if crowd > _MOST_IN_A_BOX:
            raise InputError(
                f"distance = {reach:.3g} m: {crowd} points lie within such a distance; take less"
            )
        for ahead in range(1, crowd):
            a, b = order[:-ahead], order[ahead:]
            same = key[a] == key[b]
            a, b = a[same], b[same]
            near = np.linalg.norm(points[a] - points[b], axis=1) <= reach
            found.append(np.sort(np.column_stack([a[near], b[near]]), axis=1))
    pairs = np.vstack([np.zeros((0, 2), dtype=np.int64), *found])
    unique: Integers = np.unique(pairs, axis=0)
    return unique
