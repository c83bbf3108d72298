"""The reference of a dynamic case: central differences on FEniCSx, the same mesh and time step."""

from __future__ import annotations

import time
from collections.abc import Callable

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.validation.judging.results import State, Trajectory
from palpate.validation.metrics.pairs import make_state

SAME_MESH = "reference P1"


def solve_motion(problem: Problem, strain: Strain, progress: Callable[[str], None]) -> State:
    """The trajectory of linear tetrahedra, from rest, with the case's time step.

    Raises:
        InputError: The case states no time step: then there is nothing to be equal to.
        ReferenceFailedError: No FEniCSx, or the run failed.
    """
    from palpate.reference.child import run_task
    from palpate.reference.result import ExplicitResult
    from palpate.reference.tasks import ExplicitTask

    if problem.time is None or problem.time.time_step is None:
        raise InputError("a dynamic case needs time_step in [time] for its reference")
    progress(f"{SAME_MESH} in motion, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    found = run_task(ExplicitTask(strain), problem)
    assert isinstance(found, ExplicitResult)
    return make_state(
        problem.mesh,
        found.displacements[-1],
        label=SAME_MESH,
        simulator="reference",
        strain=strain,
        seconds=time.perf_counter() - start,
        details={"time_step": found.time_step, "num_steps": found.num_steps},
        trajectory=Trajectory(found.times, found.displacements),
    )
