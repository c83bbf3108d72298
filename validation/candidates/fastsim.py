"""fastsim as a candidate, and its condensed linear model.

A candidate that diverges, crashes or returns NaN has failed; that is a verdict, not an error. What
the condensed model cannot pose it refuses as an input, with the reason: nobody has failed there.
Where the environment variable PALPATE_CONDENSED names a folder, its models are stored there from
run to run.
"""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.metrics import make_state
from palpate.validation.states import (
    CandidateFailedError,
    CellStresses,
    Method,
    Precision,
    Progress,
    State,
    Trajectory,
)

CONDENSED = "condensed"
# The device that is the compiled core.
CORE = "cpu"
FOLDER_VARIABLE = "PALPATE_CONDENSED"


def name_of(element: Element, device: str = CORE, *, model: str = "fastsim") -> str:
    """Name of fastsim, or its condensed model, with an element and on a device."""
    name = model if element is Element.LINEAR else f"{model} ({element})"
    return name if device == CORE else f"{name} on {device}"


def run_fastsim(
    problem: Problem,
    strain: Strain,
    progress: Progress,
    *,
    method: Method = Method.NEWTON,
    element: Element = Element.LINEAR,
    device: str = CORE,
    precision: Precision = Precision.DOUBLE,
    multirate: bool = False,
) -> State:
    """Solve by fastsim: statics, or from rest where there is time.

    Args:
        problem: The body with its supports and loads.
        strain: Strain measure.
        progress: Called with one line now and then.
        method: Method of statics; a motion is stepped.
        element: Linear tetrahedra, plain or smoothed.
        device: Device of explicit steps: "cpu" is the compiled core.
        precision: Precision of a motion's steps.
        multirate: Steps of several lengths in a motion.

    Raises:
        CandidateFailedError: It diverged, or returned NaN.
    """
    from palpate.fastsim.errors import FastsimError

    name = name_of(element, device)
    progress(f"{name}, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    try:
        displacement, more = _solve(
            problem, strain, progress, method, element, device, precision, multirate
        )
    except FastsimError as error:
        raise CandidateFailedError(f"fastsim: {error}") from error
    seconds = time.perf_counter() - start
    bad = np.flatnonzero(~np.isfinite(displacement).all(axis=1))
    if bad.size:
        raise CandidateFailedError(
            f"the result holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}"
        )
    return make_state(
        problem.mesh,
        displacement,
        label=name,
        element=element,
        simulator="fastsim",
        strain=strain,
        seconds=seconds,
        stresses=_stresses(problem, strain, element, displacement),
        **more,
    )


def _stresses(problem: Problem, strain: Strain, element: Element, u: Points) -> CellStresses:
    from palpate.fastsim.body import Body, cauchy_stress, cell_stress

    body = Body.of(problem, strain, element=element)
    return CellStresses(cell_stress(body, u), cauchy_stress(body, u))


def _solve(
    problem: Problem, strain: Strain, progress: Progress, method: Method,
    element: Element, device: str, precision: Precision, multirate: bool,
) -> tuple[Any, dict[str, Any]]:  # fmt: skip
    """The last displacement [m], (num_points, 3), and what else a state has."""
    common: dict[str, Any] = {"strain": strain, "element": element, "progress": progress}
    if problem.time is not None:
        from palpate.fastsim.dynamics import simulate
        from palpate.fastsim.explicit_body import Precision as StepPrecision

        steps = StepPrecision[precision.name]
        motion = simulate(problem, precision=steps, device=device, multirate=multirate, **common)
        forces = [track.mean_forces for track in motion.tools]
        moving = ("time_step", "critical_time_step", "num_steps", "classes")
        return motion.displacements[-1], {
            "details": {name: getattr(motion, name) for name in moving},
            "trajectory": Trajectory(motion.times, motion.displacements),
            "tool_forces": np.array(forces) if forces else None,
        }
    if method is Method.RELAXATION:
        from palpate.fastsim.dynamic_relaxation import relax

        rested = relax(problem, device=device, **common)
        return rested.displacement, {
            "details": {
                "method": method.value,
                "steps": rested.steps,
                "relative_residual": rested.relative_residual,
            },
            "tool_forces": rested.tool_forces if problem.tools else None,
        }
    found: Any
    if problem.tools:
        from palpate.fastsim.contact.static_contact import solve_contact

        found = solve_contact(problem, **common)
        displacement, more = found.displacements[-1], {"tool_forces": found.forces[-1]}
    else:
        from palpate.fastsim.statics import solve_static

        found = solve_static(problem, **common)
        displacement, more = found.displacement, {}
    details = {
        "newton_iterations": found.iterations,
        "linear_iterations": found.linear_iterations,
        "relative_residual": found.residual_history[-1],
    }
    return displacement, {"details": details, **more}


def condensed_refusal(problem: Problem) -> str:
    """Why the condensed model cannot pose a problem by linear strain; empty where it can."""
    from palpate.fastsim.condensed import NotCondensableError
    from palpate.fastsim.condensed.solve import require_posable

    try:
        require_posable(problem, Strain.LINEAR)
    except NotCondensableError as error:
        return str(error)
    return ""


def run_condensed(
    problem: Problem, strain: Strain, progress: Progress, *, element: Element = Element.LINEAR
) -> State:
    """Condense, and solve a static problem by linear strain.

    Args:
        problem: The body with its supports and loads.
        strain: Linear.
        progress: Called with one line now and then.
        element: Linear tetrahedra, plain or smoothed.

    Raises:
        NotCondensableError: Green strain, a motion, or what else it cannot pose.
        CondensedTooLargeError: It needs more memory than it may take.
        CandidateFailedError: A tool's contact did not settle.
    """
    from palpate.fastsim.condensed import solve_condensed
    from palpate.fastsim.errors import FastsimError
    from palpate.validation.metrics.validity import describe_rotation

    name = name_of(element, model=CONDENSED)
    progress(f"{name}, {strain} strain, {problem.mesh.num_cells} cells")
    folder = os.environ.get(FOLDER_VARIABLE, "")
    start = time.perf_counter()
    try:
        found = solve_condensed(
            problem,
            strain=strain,
            element=element,
            folder=Path(folder) if folder else None,
            progress=progress,
        )
    except FastsimError as error:
        raise CandidateFailedError(f"{name}: {error}") from error
    except np.linalg.LinAlgError as error:
        raise CandidateFailedError(f"{name}: the stiffness is singular ({error})") from error
    seconds = time.perf_counter() - start
    u = found.displacement
    state = make_state(
        problem.mesh,
        u,
        label=name,
        element=element,
        simulator=CONDENSED,
        strain=strain,
        seconds=seconds,
        stresses=_stresses(problem, strain, element, u),
        details={
            "touched_points": found.num_touched,
            "model_bytes": found.model_bytes,
            "contact_steps": found.steps,
        },
        tool_forces=found.tool_forces if problem.tools else None,
    )
    remarks = [f"Linear strain: {describe_rotation(problem.mesh, u)}."]
    if found.model_made:
        remarks.append(
            f"The condensed model was made before, on {found.model_made}, and read from "
            f"{FOLDER_VARIABLE}: its making is not in the time."
        )
    return dataclasses.replace(state, remarks=(*state.remarks, *remarks))
