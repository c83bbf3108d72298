"""fastsim as a candidate.

A candidate that diverges, crashes or answers NaN has failed; that is a verdict, not an error.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.cell_stress import cauchy_stress, cell_stress
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import FastsimError
from palpate.fastsim.explicit_body import Precision as StepPrecision
from palpate.fastsim.gpu.devices import CORE
from palpate.fastsim.statics import solve_static
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.metrics import make_state
from palpate.validation.states import (
    CandidateFailedError,
    CellStresses,
    Method,
    Progress,
    State,
    Trajectory,
)

_STATIC = {"newton_iterations": "iterations", "linear_iterations": "linear_iterations"}
_MOVING = ("time_step", "critical_time_step", "num_steps")


@dataclass(frozen=True)
class Way:
    """How fastsim is to find its answers.

    Attributes:
        method: Of statics; a motion is stepped.
        element: Linear tetrahedra, plain or smoothed.
        device: Of explicit steps: "cpu" is the compiled core.
        precision: Of a motion's steps.
    """

    method: Method = Method.NEWTON
    element: Element = Element.LINEAR
    device: str = CORE
    precision: StepPrecision = StepPrecision.DOUBLE


def name_of(element: Element, device: str = CORE) -> str:
    """What fastsim with an element is called, on a device."""
    name = "fastsim" if element is Element.LINEAR else f"fastsim ({element})"
    return name if device == CORE else f"{name} on {device}"


def run_fastsim(
    problem: Problem,
    strain: Strain,
    progress: Progress,
    *,
    way: Way | None = None,
) -> State:
    """Solve by fastsim: statics, or from rest where there is time.

    Args:
        problem: What is held and pushed.
        strain: Strain measure.
        progress: Called with one line now and then.
        way: How; None is the usual one.

    Raises:
        CandidateFailedError: It diverged, or answered NaN.
    """
    way = way or Way()
    element, name = way.element, name_of(way.element, way.device)
    progress(f"{name}, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    try:
        displacement, more = _solve(problem, strain, progress, way)
    except FastsimError as error:
        raise CandidateFailedError(f"fastsim: {error}") from error
    seconds = time.perf_counter() - start
    bad = np.flatnonzero(~np.isfinite(displacement).all(axis=1))
    if bad.size:
        raise CandidateFailedError(
            f"the answer holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}"
        )
    body = Body.of(problem, strain, element=element)
    return make_state(
        problem.mesh,
        displacement,
        label=name,
        element=element,
        simulator="fastsim",
        strain=strain,
        seconds=seconds,
        stresses=CellStresses(cell_stress(body, displacement), cauchy_stress(body, displacement)),
        **more,
    )


def _solve(
    problem: Problem, strain: Strain, progress: Progress, way: Way
) -> tuple[Any, dict[str, Any]]:
    """The last displacement [m], (num_points, 3), and what else a state holds."""
    element = way.element
    if problem.time is not None:
        motion = simulate(
            problem,
            strain=strain,
            element=element,
            precision=way.precision,
            device=way.device,
            progress=progress,
        )
        forces = [track.mean_forces for track in motion.tools]
        return motion.displacements[-1], {
            "details": {name: getattr(motion, name) for name in _MOVING},
            "trajectory": Trajectory(motion.times, motion.displacements),
            "tool_forces": np.array(forces) if forces else None,
        }
    if way.method is Method.RELAXATION:
        rested = relax(
            problem, strain=strain, element=element, device=way.device, progress=progress
        )
        return rested.displacement, {
            "details": {
                "method": way.method.value,
                "steps": rested.steps,
                "relative_residual": rested.relative_residual,
            },
            "tool_forces": rested.tool_forces if problem.tools else None,
        }
    if problem.tools:
        pressed = solve_contact(problem, strain=strain, element=element, progress=progress)
        details = _static_details(pressed)
        return pressed.displacements[-1], {"details": details, "tool_forces": pressed.forces[-1]}
    found = solve_static(problem, strain=strain, element=element, progress=progress)
    return found.displacement, {"details": _static_details(found)}


def _static_details(found: Any) -> dict[str, object]:
    own = {name: getattr(found, attribute) for name, attribute in _STATIC.items()}
    return {**own, "relative_residual": found.residual_history[-1]}
