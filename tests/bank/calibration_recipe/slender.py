"""Slender bars with a clamped end, whose answers are found once, by far better meshes, and kept.

Quadratic tetrahedra are held against cubic ones on meshes that are graded towards what is singular,
further than the bar of any truth asks; the difference of the last two of those meshes, which holds
the error of the last one where that falls by half or more, says how well an answer is known.
`find_missing` finds those that a new generation of problems lacks.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from calibration_recipe.answers import Answer, reported
from calibration_recipe.shapes import BAR_THICKNESS, shape_mesh
from palpate.meshes.arrays import Floats
from palpate.meshes.boundary_conditions import BodyForce, Load, Traction
from palpate.meshes.bricks import side, support_of
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.metrics import WHOLE_BODY_METRICS

_ANSWERS = Path(__file__).with_name("answers.npz")
# The reference's budget for an answer: unknowns, so that a busy machine finds the same.
_UNKNOWNS, _TOLERANCE = 120_000.0, 2e-4
_SECONDS = 6 * 3600.0


def slender_problem(*, nu: float, load: str, strain: str) -> tuple[Problem, Strain]:
    """A bar of Young's modulus 1 Pa, held where x is smallest.

    Args:
        nu: Poisson's ratio.
        load: "bend", "weight", or "push-60": sixty per cent of what buckles it, with a little
            aside.
        strain: "green" or "linear".
    """
    mesh, h = shape_mesh("bar"), BAR_THICKNESS
    far = side(mesh, 0, 1.0)
    push: Load
    if load == "bend":
        push = Traction(far, (0.0, 0.01 * h**2, -0.04 * h**2))
    elif load == "weight":
        push = BodyForce((0.0, 0.0, -0.1 * h**2))
    else:
        euler = (np.pi * h) ** 2 / 48.0
        part = float(load.removeprefix("push-")) / 100.0
        push = Traction(far, (-part * euler, 0.0, -0.002 * h**2))
    supports = (support_of(side(mesh, 0, 0.0)),)
    return Problem(mesh, Material(1.0, nu, 1.0), supports, (push,)), Strain(strain)


@cache
def _kept() -> dict[str, Floats]:
    if not _ANSWERS.is_file():
        return {}
    with np.load(_ANSWERS, allow_pickle=False) as file:
        return dict(file)


def kept_answer(name: str, problem: Problem, strain: Strain) -> Answer | None:
    """The answer that is kept of a problem; None where there is none.

    Raises:
        ValueError: It is of another mesh.
    """
    values = _kept()
    if name not in values:
        return None
    displacement, numbers = values[name].astype(np.float64), values[f"{name}/numbers"]
    if displacement.shape != problem.mesh.points.shape:
        raise ValueError(f"{name}: the kept answer has {len(displacement)} points; find it again")
    doubts = dict(zip(WHOLE_BODY_METRICS, numbers[2:], strict=True))
    return reported(problem.mesh, displacement, (numbers[0], numbers[1]), strain, doubts)


def find_answer(name: str, problem: Problem, strain: Strain) -> None:
    """Find an answer and keep it: minutes."""
    from palpate.reference.adaptivity.goals import Budget, Goal, Quantity
    from palpate.reference.child import run_task
    from palpate.reference.result import AdaptiveResult, formulation_for
    from palpate.reference.tasks import AdaptiveTask

    goals = tuple(Goal(Quantity(metric), _TOLERANCE) for metric in WHOLE_BODY_METRICS)
    formulation = formulation_for(problem, 3)
    task = AdaptiveTask(goals, Budget(_SECONDS, 5.0, _UNKNOWNS), strain, 3, formulation)
    found = run_task(task, problem, time_limit=4.0 * _SECONDS)
    assert isinstance(found, AdaptiveResult)
    numbers = np.array([found.volume, found.surface_area, *found.differences[-1]])
    values = _kept()
    values[name] = found.displacement.astype(np.float32)
    values[f"{name}/numbers"] = numbers
    np.savez_compressed(_ANSWERS, **values)
    print(name, problem.mesh.num_cells, found.num_cells, found.seconds.sum(), numbers[2:])
