"""The condensed linear model of fastsim as a candidate: the body as its compliance, linear strain.

What it cannot pose, it refuses as an input, with the reason: nobody has failed there. Where the
environment variable PALPATE_CONDENSED names a folder, models are kept there from run to run.
"""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.cell_stress import cauchy_stress, cell_stress
from palpate.fastsim.condensed import NotCondensableError, solve_condensed
from palpate.fastsim.condensed.solve import require_posable
from palpate.fastsim.errors import FastsimError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.metrics import make_state
from palpate.validation.metrics.linear_validity import describe_rotation
from palpate.validation.states import CandidateFailedError, CellStresses, Progress, State

CONDENSED = "condensed"
FOLDER_VARIABLE = "PALPATE_CONDENSED"


def condensed_name(element: Element) -> str:
    """What the condensed model with an element is called."""
    return CONDENSED if element is Element.LINEAR else f"{CONDENSED} ({element})"


def condensed_refusal(problem: Problem) -> str:
    """Why the condensed model cannot pose a problem by linear strain; empty where it can."""
    try:
        require_posable(problem, Strain.LINEAR)
    except NotCondensableError as error:
        return str(error)
    return ""


def run_condensed(
    problem: Problem, strain: Strain, progress: Progress, *, element: Element = Element.LINEAR
) -> State:
    """Condense, and answer a static problem by linear strain.

    Args:
        problem: What is held and pushed.
        strain: Linear.
        progress: Called with one line now and then.
        element: Linear tetrahedra, plain or smoothed.

    Raises:
        NotCondensableError: Green strain, a motion, or what else it cannot pose.
        CondensedTooLargeError: It needs more memory than it may take.
        CandidateFailedError: A tool's contact did not settle.
    """
    name = condensed_name(element)
    progress(f"{name}, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    try:
        found = solve_condensed(
            problem, strain=strain, element=element, folder=_folder(), progress=progress
        )
    except FastsimError as error:
        raise CandidateFailedError(f"{name}: {error}") from error
    except np.linalg.LinAlgError as error:
        raise CandidateFailedError(f"{name}: the stiffness is singular ({error})") from error
    seconds = time.perf_counter() - start
    body = Body.of(problem, strain, element=element)
    u = found.displacement
    state = make_state(
        problem.mesh,
        u,
        label=name,
        element=element,
        simulator=CONDENSED,
        strain=strain,
        seconds=seconds,
        stresses=CellStresses(cell_stress(body, u), cauchy_stress(body, u)),
        details={
            "touched_points": found.num_touched,
            "model_bytes": found.model_bytes,
            "contact_steps": found.steps,
        },
        tool_forces=found.tool_forces if problem.tools else None,
    )
    turned = f"Linear strain: {describe_rotation(problem.mesh, u)}."
    return dataclasses.replace(state, remarks=(*state.remarks, turned))


def _folder() -> Path | None:
    name = os.environ.get(FOLDER_VARIABLE, "")
    return Path(name) if name else None
