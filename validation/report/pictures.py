"""Pictures of a judged case: its states side by side, and where they are wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.problem import Strain
from palpate.validation.drawing.scene import GREEN, Panel, Surface, boundary, draw, joined
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.looks import Look, error_top, looks_of

_MILLI = 1e3


def draw_pictures(result: CaseResult, folder: Path) -> dict[str, Path]:
    """Draw the states and the errors of a case.

    Returns:
        Path of each picture that came about, by name ("states", "errors"); none is required.
    """
    made = {}
    for name, picture in draw(_pictures(result)).items():
        made[name] = folder / f"{result.name}-{name}.png"
        made[name].write_bytes(picture)
    return made


def _pictures(result: CaseResult) -> dict[str, list[Panel]]:
    """The boundary, its states and their errors, in millimetres.

    Of one candidate both strain measures; of several Green strain, beside the best reference.
    """
    mesh, problem, states = result.problem.mesh, result.problem, result.states
    points, facets = mesh.points * _MILLI, mesh.boundary_facets
    looks = [look for look in looks_of(result) if look.strain is Strain.GREEN]
    candidates = [state for state in states if not state.is_reference]
    several = len(result.candidates) > 1
    if several:
        shown = [state for state in candidates if state.strain is Strain.GREEN]
        shown += [states[k] for look in looks[:1] for k in look.references]
    else:
        shown = sorted(candidates, key=lambda state: state.strain is Strain.GREEN)
    moved = [state.displacement * _MILLI for state in shown]
    side = _side(np.vstack([points, *(points + u for u in moved)]))
    largest = max((float(np.linalg.norm(u, axis=1).max()) for u in moved), default=1.0)
    held = joined([support.facets for support in problem.supports])
    pushed = joined([getattr(load, "facets", None) for load in problem.loads])
    original = Surface(points, facets, GREEN, opacity=0.55, is_wireframe=True)
    words = "original (blue: held, red: pushed)"
    panels = [Panel(words, boundary(points, facets, held, pushed), side)]
    for column, (state, u) in enumerate(zip(shown, moved, strict=True)):
        lengths = np.linalg.norm(u, axis=1)
        # Bars of one picture need names of their own.
        name = f"displacement [mm]{' ' * column}"
        coloured = Surface(points + u, facets, values=lengths, values_name=name, largest=largest)
        title = f"{state.label if several else f'{state.strain} strain'} (green: original)"
        panels.append(Panel(title, [coloured, original], side))
    errors = [
        Panel(f"{states[one].label} - {states[other].label}", [surface], side)
        for (one, other), surface in _errors(result, _best(looks), facets)
    ]
    return {"states": panels} | ({"errors": errors} if errors else {})


def _best(looks: Sequence[Look]) -> list[Look]:
    """The same mesh, then the best truth, which comes first of all."""
    own, true = ([look for look in looks if look.is_truth is kind][:1] for kind in (False, True))
    return own + true


def _errors(
    result: CaseResult, looks: Sequence[Look], facets: Indices
) -> Iterator[tuple[tuple[int, int], Surface]]:
    """Length of the error of each pair on the candidate's shape, a look's on one scale [mm]."""
    column = 0
    for look in looks:
        pairs = [(result.states[one], result.states[other]) for one, other in look.pairs]
        lengths = [np.linalg.norm(a.displacement - b.displacement, axis=1) for a, b in pairs]
        largest = _MILLI * error_top(result, max(float(length.max()) for length in lengths))
        for numbers, (candidate, _), length in zip(look.pairs, pairs, lengths, strict=True):
            yield (
                numbers,
                Surface(
                    (result.problem.mesh.points + candidate.displacement) * _MILLI,
                    facets,
                    values=_MILLI * length,
                    values_name=f"error [mm]{' ' * column}",
                    largest=largest,
                    colours="magma_r",
                ),
            )
            column += 1


def _side(everything: Points) -> tuple[float, float, float]:
    """Along the axis in which body and motion reach least, a little from beside."""
    axis = int(np.argmin(np.ptp(everything, axis=0)))
    side = [0.0, 0.0, 0.0]
    side[axis] = -1.0 if axis == 1 else 1.0
    side[1 if axis == 0 else 0] = 0.18
    x, y, z = side
    return (x, y, z)
