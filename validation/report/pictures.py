"""Pictures of a judged case: its states side by side, and where they are wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.problem import Problem, Strain
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.camera import first_eye, way_to_eye
from palpate.validation.report.looks import STRAIN_NAMES, Look, error_top, looks_of
from palpate.validation.report.scene import (
    BLUE,
    GREEN,
    RED,
    Marks,
    Panel,
    Surface,
    boundary,
    draw,
    joined,
)
from palpate.validation.report.surroundings import arrows_around, tools_placed

_MILLI = 1e3


def draw_pictures(result: CaseResult, folder: Path, form: str = "png") -> dict[str, Path]:
    """Draw the states and the errors of a case, seen as the page's 3-D view begins.

    Args:
        result: With the states.
        folder: Where they go, that exists.
        form: As of `drawing.scene.draw`.

    Returns:
        Path of each picture that came about, by name ("states", "errors"); none is required.
    """
    made = {}
    for name, picture in draw(_pictures(result), form=form).items():
        made[name] = folder / f"{result.name}-{name}.{form}"
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
    x, y, z = way_to_eye(*first_eye(result))
    side = (float(x), float(y), float(z))
    largest = max((float(np.linalg.norm(u, axis=1).max()) for u in moved), default=1.0)
    held = joined([support.facets for support in problem.supports])
    pushed = [*problem.springs, *problem.loads]
    red = joined([getattr(load, "facets", None) for load in pushed])
    original = Surface(points, facets, GREEN, opacity=0.55, is_wireframe=True)
    words = "original (blue: held, red: pushed)"
    marks, single = _arrows(problem), [s.points for s in problem.supports if not len(s.facets)]
    dots = [Marks(points[np.concatenate(single)], BLUE)] if single else []
    tools, ended = (tools_placed(problem, at_end=at_end) for at_end in (False, True))
    panels = [Panel(words, [*boundary(points, facets, held, red), *tools], side, [*marks, *dots])]

    def around(u: Points) -> list[Surface]:
        return [Surface(points + u, held, BLUE, is_wireframe=True), *ended]

    for column, (state, u) in enumerate(zip(shown, moved, strict=True)):
        lengths = np.linalg.norm(u, axis=1)
        # Bars of one picture need names of their own.
        name = f"displacement [mm]{' ' * column}"
        coloured = Surface(points + u, facets, values=lengths, values_name=name, largest=largest)
        title = f"{state.label if several else STRAIN_NAMES[state.strain]} (wires: original)"
        panels.append(Panel(title, [coloured, original, *around(u)], side, marks))
    errors = [
        Panel(
            f"{states[one].label} - {states[other].label}",
            [surface, *around(states[one].displacement * _MILLI)],
            side,
            marks,
        )
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


def _arrows(problem: Problem) -> list[Marks]:
    """Loads, and the ways of springs' anchors [mm]."""
    pairs = arrows_around(problem, np.zeros(3))
    return [Marks(pairs[:, 0], RED, vectors=pairs[:, 1])] if len(pairs) else []
