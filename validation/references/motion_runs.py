"""One run of the reference through a motion, as a state: explicit, or implicit."""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.pairs import make_state
from palpate.validation.references.sets import OF_ELEMENT, QUADRATIC, SAME_MESH
from palpate.validation.states import REFERENCE, Progress, State, Trajectory

# Little is taken from what the mesh resolves, all of what it does not within some hundred steps.
_SPECTRAL_RADIUS = 0.9
# Of an implicit motion that is to be the truth, the shortest of those that bound its error.
STEPS_PER_OUTPUT = 4
_TIME_LIMIT = 4 * 3600.0


def solve_explicit(
    problem: Problem,
    strain: Strain,
    progress: Progress,
    *,
    element: Element = Element.LINEAR,
) -> State:
    """The trajectory of the case's tetrahedra, from rest, with the case's time step.

    Raises:
        InputError: The case states no time step: then there is nothing to be equal to.
        ReferenceFailedError: No FEniCSx, or the run failed.
    """
    from palpate.reference.child import run_task
    from palpate.reference.result import ExplicitResult
    from palpate.reference.tasks import ExplicitTask

    if problem.time is None or problem.time.time_step is None:
        raise InputError("a dynamic case needs time_step in [time] for its reference")
    progress(f"{OF_ELEMENT[element]} in motion, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    found = run_task(ExplicitTask(strain, element), problem)
    assert isinstance(found, ExplicitResult)
    return make_state(
        problem.mesh,
        found.displacements[-1],
        label=OF_ELEMENT[element],
        element=element,
        simulator=REFERENCE,
        strain=strain,
        seconds=time.perf_counter() - start,
        details={
            "time_step": found.time_step,
            "num_steps": found.num_steps,
        },
        tool_forces=found.tool_forces if problem.tools else None,
        trajectory=Trajectory(found.times, found.displacements),
    )


def solve_implicit(
    problem: Problem,
    strain: Strain,
    steps_per_output: int,
    progress: Progress,
    *,
    degree: int = 2,
    at: TetMesh | None = None,
) -> State:
    """The trajectory by the implicit reference, from rest.

    Args:
        problem: With a time span; its own time step is not used.
        strain: Strain measure.
        steps_per_output: Steps from one output to the next, >= 1.
        progress: Called with one line now and then.
        degree: Of the elements.
        at: The mesh whose points are kept; one it was refined from has them first.

    Raises:
        InputError: Tools, or a load that cannot be used.
        ReferenceFailedError: No FEniCSx, or a step without an answer.
    """
    from palpate.reference.child import run_task
    from palpate.reference.result import ImplicitResult
    from palpate.reference.tasks import ImplicitTask

    span = problem.time
    assert span is not None
    step = span.end_time / span.num_outputs / steps_per_output
    progress(
        f"{QUADRATIC if degree == 2 else SAME_MESH} in motion, implicit, steps of {step:g} s, "
        f"{strain} strain, {problem.mesh.num_cells} cells"
    )
    stepped = dataclasses.replace(problem, time=dataclasses.replace(span, time_step=step))
    start = time.perf_counter()
    task = ImplicitTask(strain, degree, _SPECTRAL_RADIUS)
    found = run_task(task, stepped, time_limit=_TIME_LIMIT)
    assert isinstance(found, ImplicitResult)
    mesh = at or problem.mesh
    # A truth in seven digits: its error bar is far above, and the file half as large.
    kept = found.displacements[:, : mesh.num_points].astype(np.float32).astype(np.float64)
    return make_state(
        mesh,
        kept[-1],
        label=QUADRATIC,
        simulator=REFERENCE,
        strain=strain,
        degree=degree,
        seconds=time.perf_counter() - start,
        details={
            "time_step": found.time_step,
            "newton_iterations": found.newton_iterations,
            "largest_energy_error": float(np.abs(found.energy_errors).max()),
        },
        versions=dict(found.versions),
        trajectory=Trajectory(found.times, kept),
    )
