"""From where a body is first seen: where its largest error faces the eye."""

from __future__ import annotations

import itertools
import math

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.validation.exchange.nodal_arrays import area_vectors
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.looks import Look, looks_of

# Level and turn of the eye [degrees], none along an axis of the case.
_PITCHES = (18.0, 35.0, -18.0)
_YAWS = tuple(range(-160, 180, 20))
_AXES_APART = 10
# What stands before the largest error, and how far beside it counts, in parts of the size.
_BEFORE, _BESIDE = 0.03, 0.04
# A look from below has to show this much more.
_BELOW = 0.25


def first_eye(result: CaseResult) -> tuple[float, float]:
    """Turn and level of the eye [rad] from which a case is first seen, on pages and in pictures."""
    mesh, looks = result.problem.mesh, looks_of(result)
    seen = _worst_errors(result, looks[0]) if looks else np.zeros(mesh.num_points)
    first = result.states[0] if result.states else None
    moved = mesh.points + (first.displacement if first else 0.0)
    return choose_camera(moved, mesh.boundary_facets, seen)


def _worst_errors(result: CaseResult, look: Look) -> Floats:
    """The largest error at each point [m], of all pairs of a look and all times."""
    moved = [state.displacements for state in result.states]
    apart = [np.linalg.norm(moved[one] - moved[other], axis=2) for one, other in look.pairs]
    worst: Floats = np.concatenate(apart).max(axis=0)
    return worst


def choose_camera(points: Points, facets: Indices, errors: Floats) -> tuple[float, float]:
    """Turn and level of the eye [rad]: at 0 and 0 it looks along y, from below 0, z up.

    Every direction of a grid gets marks for how much of the error it sees, whether the largest
    faces it and nothing hides that, and how broad the body is from there; the best is taken.

    Args:
        points: (n, 3).
        facets: Of the boundary, counted outwards, (m, 3).
        errors: Length at each point, (n,); without any only the breadth counts.
    """
    areas = area_vectors(points, facets)
    size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    weights = errors[facets].mean(axis=1)
    worst = int(np.argmax(errors))
    normal = areas[(facets == worst).any(axis=1)].sum(axis=0)
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 0.0 else normal
    total = float(weights @ np.linalg.norm(areas, axis=1)) or 1.0
    breadth = float(np.linalg.norm(areas, axis=1).sum()) / 4.0 or 1.0

    def marks(yaw: float, pitch: float) -> float:
        eye = way_to_eye(yaw, pitch)
        faces = np.maximum(areas @ eye, 0.0)
        apart = points - points[worst]
        depth = apart @ eye
        beside = np.linalg.norm(apart - depth[:, None] * eye, axis=1)
        is_hidden = bool(((depth > _BEFORE * size) & (beside < _BESIDE * size)).any())
        seen = float(weights @ faces) / total
        facing = float(min(normal @ eye, 0.7)) - is_hidden if errors.any() else 0.0
        return seen + facing + 0.6 * float(faces.sum()) / breadth - _BELOW * (pitch < 0.0)

    pairs = [
        (math.radians(yaw + _AXES_APART * (yaw % 90 == 0)), math.radians(pitch))
        for yaw, pitch in itertools.product(_YAWS, _PITCHES)
    ]
    return max(pairs, key=lambda pair: marks(*pair))


def way_to_eye(yaw: float, pitch: float) -> Points:
    """Unit vector from the body to the eye, (3,)."""
    level = math.cos(pitch)
    return np.array([level * math.sin(yaw), -level * math.cos(yaw), math.sin(pitch)])
