"""Pictures of a judged case: its states side by side, and where they are wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain
from palpate.validation.drawing.scene import GREEN, Panel, Surface, boundary, draw, joined
from palpate.validation.judging.results import CaseResult

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
    """The boundary, its states and their errors, in millimetres."""
    mesh, problem = result.problem.mesh, result.problem
    points, facets = mesh.points * _MILLI, mesh.boundary_facets
    answers = {s: result.state(result.candidates[0].name, s) for s in Strain}
    moved = {s: state.displacement * _MILLI for s, state in answers.items() if state is not None}
    side = _side(np.vstack([points, *(points + u for u in moved.values())]))
    largest = max((float(np.linalg.norm(u, axis=1).max()) for u in moved.values()), default=1.0)
    held = joined([support.facets for support in problem.supports])
    pushed = joined([getattr(load, "facets", None) for load in problem.loads])
    original = Surface(points, facets, GREEN, opacity=0.55, is_wireframe=True)
    words = "original (blue: held, red: pushed)"
    states = [Panel(words, boundary(points, facets, held, pushed), side)]
    for strain, u in moved.items():
        lengths = np.linalg.norm(u, axis=1)
        shown = Surface(
            points + u, facets, values=lengths, values_name="displacement [mm]", largest=largest
        )
        states.append(Panel(f"{strain} strain (green: original)", [shown, original], side))
    pictures = {"states": states}
    if Strain.GREEN in moved:
        places = points + moved[Strain.GREEN]
        errors = [
            Panel(
                name.removesuffix(", green"),
                [
                    Surface(
                        places,
                        facets,
                        values=_MILLI * error,
                        values_name=f"error [mm]{' ' * column}",
                        largest=_MILLI * float(error.max()),
                        colours="magma_r",
                    )
                ],
                side,
            )
            for column, (name, error) in enumerate(
                pair for pair in result.error_fields.items() if pair[0].endswith("green")
            )
        ]
        pictures |= {"errors": errors} if errors else {}
    return pictures


def _side(everything: Points) -> tuple[float, float, float]:
    """Along the axis in which body and motion reach least, a little from beside."""
    axis = int(np.argmin(np.ptp(everything, axis=0)))
    side = [0.0, 0.0, 0.0]
    side[axis] = -1.0 if axis == 1 else 1.0
    side[1 if axis == 0 else 0] = 0.18
    x, y, z = side
    return (x, y, z)
