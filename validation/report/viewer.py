"""The scene of the 3-D view: boundary, motions, tools and loads, in compact form.

Displacements are rounded to 1/32767 of the largest component, which is enough for a picture, but
not for a number. Errors are computed before that, in full precision.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices
from palpate.meshes.untrusted import parse_toml
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.comparisons import STRAIN_NAMES, comparisons_of, error_top, first_eye
from palpate.validation.report.loads_and_tools import (
    arrows_around,
    inclusions_inside,
    tools_around,
)
from palpate.validation.states import State

_COLOURS = 32


def viewer_json(result: CaseResult) -> str:
    """The scene of a case in its unit of length, as JSON that is safe inside a <script>."""
    mesh = result.problem.mesh
    used, facets = np.unique(mesh.boundary_facets, return_inverse=True)
    scale, unit = result.units.of("length")
    inner, inclusions = inclusions_inside(
        result.problem, used, result.units, parse_toml(result.case_text)
    )
    used = np.concatenate([used, inner])
    points = mesh.points[used] / scale
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    motions = [s.trajectory for s in result.states if s.trajectory is not None]
    times = [float(t) for t in motions[0].times] if motions else None
    scene = {
        "points": packed(points - centre, np.float32),
        "facets": packed(facets.reshape(-1, 3), np.uint32),
        "inclusions": drawn_inclusions(inclusions),
        "marks": packed(_marks(result, used), np.int8),
        "solutions": [_solution(state, used, scale) for state in result.states],
        "errors": _errors(result, used),
        "looks": _offered(result),
        "times": times,
        "tools": [
            {
                "points": packed(own, np.float32),
                "facets": packed(rows, np.uint32),
                "poses": packed(poses, np.float32),
            }
            for own, rows, poses in tools_around(
                result.problem, centre, None if times is None else np.array(times), scale
            )
        ],
        "arrows": packed(arrows_around(result.problem, centre, scale), np.float32),
        "colours": colour_table(),
        "radius": 0.5 * float(np.linalg.norm(np.ptp(points, axis=0))),
        "eye": first_eye(result),
        "unit": unit,
    }
    # "</script>" in a name must not end the element.
    return json.dumps(scene, allow_nan=False).replace("<", "\\u003c")


def drawn_inclusions(
    inclusions: Sequence[tuple[str, tuple[float, float, float], Indices]],
) -> list[dict[str, Any]]:
    """Inclusions for a page, of `inclusions_inside`."""
    return [
        {"says": says, "colour": colour, "facets": packed(facets, np.uint32)}
        for says, colour, facets in inclusions
    ]


def _solution(state: State, used: NDArray[Any], scale: float) -> dict[str, Any]:
    """One motion at all its times, as whole numbers times `step` of the unit."""
    displacement = state.displacements[:, used] / scale
    largest = float(np.abs(displacement).max())
    step = largest / 32767.0 if largest > 0.0 else 1.0
    return {
        "name": f"{state.label}, {STRAIN_NAMES[state.strain]}",
        "is_reference": state.is_reference,
        "step": step,
        "displacement": packed(np.rint(displacement / step), np.int16),
        "largest": float(np.linalg.norm(displacement, axis=2).max()),
    }


def _offered(result: CaseResult) -> list[dict[str, Any]]:
    """The entries of the list with their views: states and errors, each on one scale.

    Errors come first, then the original, candidates and references, so that of two candidates each
    stands below its own error.
    """
    offered: list[dict[str, Any]] = []
    states, first = result.states, 0
    for shown in comparisons_of(result):
        numbers = range(first, first + len(shown.pairs))
        first += len(shown.pairs)
        moved = [{"solution": one} for one, _ in shown.pairs]
        moved += [{"solution": other} for other in shown.references]
        wrong = [
            {"error": k, "name": "length of the error"}
            if len(shown.pairs) == 1
            else {"error": k, "name": f"error of {states[one].label}"}
            for k, (one, _) in zip(numbers, shown.pairs, strict=True)
        ]
        offered.append({"name": shown.name(states), "views": [*wrong, {"original": True}, *moved]})
    if not offered:
        own = [k for k, state in enumerate(states) if not state.is_reference]
        views = [{"original": True}, *({"solution": k} for k in (own or [0])[:1])]
        offered.append({"name": "the candidate alone", "views": views})
    return offered


def _errors(result: CaseResult, used: NDArray[Any]) -> list[dict[str, Any]]:
    """Length of the error of every compared pair, comparison by comparison."""
    errors, scale = [], result.units.of("length")[0]
    for number, other in (pair for shown in comparisons_of(result) for pair in shown.pairs):
        candidate, reference = result.states[number], result.states[other]
        apart = (candidate.displacements - reference.displacements)[:, used]
        length = np.linalg.norm(apart, axis=2) / scale
        errors.append(
            {
                "candidate": number,
                "reference": other,
                "largest": error_top(result, float(length.max()) * scale) / scale,
                "length": packed(length, np.float32),
            }
        )
    return errors


def _marks(result: CaseResult, used: NDArray[Any]) -> NDArray[Any]:
    """1 where a point is fixed, -1 where it is loaded, 0 elsewhere."""
    marks = np.zeros(result.problem.mesh.num_points, dtype=np.int8)
    for load in result.problem.loads:
        for part in ("facets", "points"):
            rows = getattr(load, part, None)
            if rows is not None:
                marks[rows] = -1
    for support in result.problem.supports:
        marks[support.points] = 1
    chosen: NDArray[Any] = marks[used]
    return chosen


def colour_table() -> list[list[float]]:
    """Colours from least to most: red, green and blue from 0 to 1."""
    table = mpl.colormaps["viridis"](np.linspace(0.0, 1.0, _COLOURS))[:, :3]
    return [[round(float(c), 4) for c in row] for row in table]


def packed(array: NDArray[Any], kind: type[np.generic]) -> str:
    """The array as little-endian bytes in base64, for a page."""
    data = np.ascontiguousarray(array, dtype=np.dtype(kind).newbyteorder("<")).tobytes()
    return base64.b64encode(data).decode("ascii")
