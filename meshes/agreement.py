"""Whether a problem's supports and loads can be: one place for a point, facets on the boundary.

Geometry only. Every simulator takes both for granted.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import DisagreeingSupportsError, FacetNotOnBoundaryError
from palpate.meshes.tet_mesh import TetMesh

# Places that are nearer, of the largest displacement that is prescribed, are one.
_AGREE = 1e-9
# Of unit normals: singular values below which two directions are one.
_ONE_DIRECTION = 1e-8


def require_boundary_facets(mesh: TetMesh, facets: Indices, what: str) -> None:
    """Refuse facets inside the body, and copies.

    Args:
        mesh: The body.
        facets: Points that it has, shape (n, 3), in any order of corners.
        what: "load 2": for the message.

    Raises:
        FacetNotOnBoundaryError: With the guilty rows.
    """
    if not len(facets):
        return
    rows = _keys(facets)
    inside = np.flatnonzero(~np.isin(rows, _keys(mesh.boundary_facets)))
    if inside.size:
        raise FacetNotOnBoundaryError(what, inside.tolist(), facets[inside[0]].tolist())
    first = np.unique(rows, return_index=True)[1]
    copies = np.setdiff1d(np.arange(len(rows)), first)
    if copies.size:
        corners = facets[copies[0]].tolist()
        raise FacetNotOnBoundaryError(what, copies.tolist(), corners, is_copy=True)


def require_agreement(mesh: TetMesh, supports: Sequence[Support], end_time: float | None) -> None:
    """Refuse supports that want a point at different places along one direction.

    Looked at under the full load, where a support turns at half of it too, and in a motion at
    every knot of the supports' amplitudes and half-way between.

    Args:
        mesh: At rest [m].
        supports: All of them.
        end_time: Of a motion [s]; None in statics.

    Raises:
        DisagreeingSupportsError: With the points and both supports.
    """
    if len(supports) < 2 or not any(support.is_moved for support in supports):
        return
    holders = np.zeros(mesh.num_points, dtype=np.int64)
    is_moved = np.zeros(mesh.num_points, dtype=bool)
    for support in supports:
        holders[support.points] += 1
        is_moved[support.points] |= support.is_moved
    shared = np.flatnonzero((holders > 1) & is_moved)
    if not shared.size:
        return
    for time, factors in _moments(supports, end_time):
        guilty = _clash(mesh.points[shared], shared, supports, factors)
        if guilty is not None:
            raise DisagreeingSupportsError(*guilty, time)


def _clash(
    places: Points, points: NDArray[np.int64], supports: Sequence[Support], factors: Sequence[float]
) -> tuple[list[int], tuple[int, int], str, tuple[float, float]] | None:
    """The points, the two supports, along what, and where each wants the first point [m]."""
    held = [np.isin(points, support.points) for support in supports]
    moved = [placed(s, places, factor) for s, factor in zip(supports, factors, strict=True)]
    sizes = [np.abs(move[here]).max(initial=0.0) for move, here in zip(moved, held, strict=True)]
    largest = float(max(sizes))
    if any(support.normal is not None for support in supports):
        return _slanted_clash(points, supports, held, moved, _AGREE * largest)
    for a in range(len(supports)):
        for b in range(a + 1, len(supports)):
            both = held[a] & held[b]
            for axis in range(3):
                if not (supports[a].components[axis] and supports[b].components[axis]):
                    continue
                apart = np.abs(moved[a][:, axis] - moved[b][:, axis])
                guilty = np.flatnonzero(both & (apart > _AGREE * largest))
                if guilty.size:
                    wanted = float(moved[a][guilty[0], axis]), float(moved[b][guilty[0], axis])
                    return points[guilty].tolist(), (a + 1, b + 1), "xyz"[axis], wanted
    return None


def _slanted_clash(
    points: NDArray[np.int64],
    supports: Sequence[Support],
    held: Sequence[NDArray[np.bool_]],
    moved: Sequence[Points],
    slack: float,
) -> tuple[list[int], tuple[int, int], str, tuple[float, float]] | None:
    """Directions of a point that have no common solution: the first support that breaks it."""
    found: dict[tuple[int, int], list[int]] = {}
    shown: dict[tuple[int, int], tuple[str, tuple[float, float]]] = {}
    for row, point in enumerate(points.tolist()):
        axes: list[Floats] = []
        asked: list[float] = []
        owners: list[int] = []
        for number, support in enumerate(supports):
            if not held[number][row]:
                continue
            for direction in support.directions:
                wanted = float(direction @ moved[number][row])
                if axes:
                    known = np.array(axes)
                    weights = np.linalg.pinv(known.T, rcond=_ONE_DIRECTION) @ direction
                    is_new = np.linalg.norm(direction - weights @ known) > _ONE_DIRECTION
                    there = float(weights @ np.array(asked))
                    if not is_new and abs(there - wanted) > slack:
                        other = owners[int(np.abs(weights).argmax())]
                        pair = (other + 1, number + 1)
                        found.setdefault(pair, []).append(point)
                        name = "(" + ", ".join(f"{d:.4g}" for d in direction) + ")"
                        shown.setdefault(pair, (name, (there, wanted)))
                        continue
                    if not is_new:
                        continue
                axes.append(direction)
                asked.append(wanted)
                owners.append(number)
    for pair, guilty in found.items():
        return sorted(set(guilty)), pair, *shown[pair]
    return None


def placed(support: Support, points: Points, factor: float) -> Points:
    """Where a support wants rest places at a part of its full size: displacements [m], (n, 3)."""
    wanted: Points = np.tile(factor * np.array(support.displacement), (len(points), 1))
    turn = support.rotation
    if turn is not None:
        # Rodrigues: R r - r = sin a (k x r) + (1 - cos a) k x (k x r).
        angle, axis = factor * turn.angle, np.array(turn.axis)
        across = np.cross(axis, points - np.array(turn.center))
        wanted += math.sin(angle) * across + (1.0 - math.cos(angle)) * np.cross(axis, across)
    return wanted


def _moments(
    supports: Sequence[Support], end_time: float | None
) -> Iterator[tuple[float | None, list[float]]]:
    """Times, and the factor of each support there; in statics parts of the load."""
    if end_time is None:
        yield None, [1.0] * len(supports)
        if any(support.rotation is not None for support in supports):
            yield None, [0.5] * len(supports)
        return
    amplitudes = [support.amplitude for support in supports]
    knots = {0.0, end_time, *(t for a in amplitudes if a is not None for t in a.times)}
    inside = sorted(t for t in knots if 0.0 <= t <= end_time)
    middles = [0.5 * (a + b) for a, b in itertools.pairwise(inside)]
    for time in sorted([*inside, *middles]):
        yield time, [1.0 if a is None else a(time) for a in amplitudes]


def _keys(facets: Indices) -> NDArray[np.void]:
    """One value for each facet, whatever the order of its corners."""
    rows = np.ascontiguousarray(np.sort(np.asarray(facets, dtype=np.int32), axis=1))
    keys: NDArray[np.void] = rows.view(np.dtype((np.void, 12))).ravel()
    return keys
