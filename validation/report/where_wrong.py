"""Where an answer is wrong, and by how much, in one clause for people."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.validation.judging.results import CaseResult, Judged
from palpate.validation.report.looks import looks_of

_MILLI = 1e3
# Less than this of the largest displacement is no error that a reader can place.
_LEAST = 1e-6
# Points that move less than this part of the largest tell nothing of a relative error.
_MOVES = 0.2
# Of the relative errors at points: the middle eight tenths; within this factor they are one number.
_LOW, _HIGH, _EVEN = 0.1, 0.9, 1.5
# "At" a part of the body: within this part of its size.
_NEAR = 0.08
_MOST = 0.9


def where_wrong(result: CaseResult, judged: Judged) -> str:
    """As "wrong everywhere by about 18 %, most where the body moves most, at (20, 1, 90) mm".

    Of Green strain against the truth, else against the same mesh; of a motion the largest of all
    stored times at each point.

    Returns:
        "" where there is nothing to hold it against, or no error worth placing.
    """
    for look in looks_of(result):
        for one, other in look.pairs:
            if result.states[one].label == judged.name:
                return _says(result, one, other)
    return ""


def _says(result: CaseResult, one: int, other: int) -> str:
    candidate, reference = result.states[one].displacements, result.states[other].displacements
    moved = np.linalg.norm(reference, axis=2).max(axis=0)
    apart = np.linalg.norm(candidate - reference, axis=2).max(axis=0)
    top, worst = float(moved.max()), int(np.argmax(apart))
    if not apart[worst] > _LEAST * top > 0.0:
        return ""
    there = moved > _MOVES * top
    low, middle, high = np.quantile(apart[there] / moved[there], (_LOW, 0.5, _HIGH))
    if high <= _EVEN * low:
        amount = f"wrong everywhere by about {_percent(middle)}"
    else:
        amount = f"wrong by {_percent(low)} to {_percent(high)} from place to place"
    place = ", ".join(f"{x * _MILLI:.3g}" for x in result.problem.mesh.points[worst])
    if len(candidate) > 1:
        amount += " at the worst moment"
    return f"{amount}, most {_place(result, worst, moved)}, at ({place}) mm"


def _place(result: CaseResult, point: int, moved: Floats) -> str:
    """The part of the body that a point belongs to."""
    if moved[point] >= _MOST * moved.max():
        return "where the body moves most"
    problem = result.problem
    held = [support.points for support in problem.supports]
    loaded = [
        rows
        for load in problem.loads
        for part in ("facets", "points")
        if (rows := getattr(load, part, None)) is not None
    ]
    if _is_near(result, point, held):
        return "at what is held"
    return "at the load" if _is_near(result, point, loaded) else "between load and support"


def _is_near(result: CaseResult, point: int, parts: list[Indices]) -> bool:
    """Whether a point lies within a little of the points of some part."""
    points = result.problem.mesh.points
    rows = np.unique(np.concatenate([part.ravel() for part in parts])) if parts else []
    if not len(rows):
        return False
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    apart = np.linalg.norm(points[rows] - points[point], axis=1)
    return bool(apart.min() <= _NEAR * size)


def _percent(value: float) -> str:
    return f"{100.0 * value:.2g} %"
