"""One run of the reference, as a state: through a motion, or whatever the case asks for."""

from __future__ import annotations

import dataclasses
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.result import Formulation
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.metrics.pairs import make_state
from palpate.validation.references.sets import OF_ELEMENT, QUADRATIC, SAME_MESH, solve_state
from palpate.validation.states import REFERENCE, Progress, State, Trajectory

if TYPE_CHECKING:
    from palpate.reference.result import ExplicitResult, SteppedResult

# Little is taken from what the mesh resolves, all of what it does not within some hundred steps.
_SPECTRAL_RADIUS = 0.9
# The force of a tool is that of where it is at a step's end, along the normals there. So all forces
# are balanced there: else it would push backwards as it slides, by a part of its way in a step.
_WITH_TOOLS = 0.0
# Of a step's forces, what is left: no bar of a tool's force is within a thousand times that.
_BALANCED_WITH_TOOLS = 1e-6
# Of an implicit motion that is to be the truth, the shortest of those that bound its error.
STEPS_PER_OUTPUT = 4
TIME_LIMIT = 4 * 3600.0


def solve_explicit(
    problem: Problem,
    strain: Strain,
    progress: Progress,
    *,
    element: Element = Element.LINEAR,
    time_limit: float = TIME_LIMIT,
) -> State:
    """The trajectory of the case's tetrahedra, from rest, with the case's time step.

    Args:
        problem: With a time span.
        strain: Strain measure.
        progress: Called with one line.
        element: Linear tetrahedra, plain or smoothed.
        time_limit: Of the run [s], > 0.

    Raises:
        InputError: The case states no time step: then there is nothing to be equal to.
        ReferenceFailedError: No FEniCSx, or the run failed.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import ExplicitTask

    if problem.time is None or problem.time.time_step is None:
        raise InputError("a dynamic case needs time_step in [time] for its reference")
    progress(f"{OF_ELEMENT[element]} in motion, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    found = run_task(ExplicitTask(strain, element), problem, time_limit=time_limit)
    return _on_the_mesh(
        problem,
        strain,
        element,
        found,
        seconds=time.perf_counter() - start,
        details={"time_step": found.time_step, "num_steps": found.num_steps},
        tool_forces=found.tool_forces if problem.tools else None,
    )


def _on_the_mesh(
    problem: Problem,
    strain: Strain,
    element: Element,
    found: ExplicitResult | SteppedResult,
    **more: Any,
) -> State:
    """A run of the case's tetrahedra as a state."""
    return make_state(
        problem.mesh,
        found.displacements[-1],
        label=OF_ELEMENT[element],
        element=element,
        simulator=REFERENCE,
        strain=strain,
        trajectory=Trajectory(found.times, found.displacements),
        **more,
    )


def solve_by_steps(
    problem: Problem,
    strain: Strain,
    steps: Steps,
    progress: Progress,
    *,
    element: Element = Element.LINEAR,
) -> State:
    """The trajectory of the case's tetrahedra by a simulator's own scheme and step, each solved.

    What the simulator differs by from it is its solver's, or that it does not do what it states;
    what it differs by from the motion itself is the scheme's.

    Args:
        problem: With a time span; its own time step is not used.
        strain: Strain measure.
        steps: Scheme and time step.
        progress: Called with one line now and then.
        element: Linear tetrahedra, plain or smoothed.

    Raises:
        InputError: Outputs that are not whole steps apart, a tool, or an element or load that
            cannot be used.
        ReferenceFailedError: No FEniCSx, or a step without an answer.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import SteppedTask

    stepped = steps.of(problem)
    if steps.integrator is Integrator.CENTRAL_DIFFERENCES:
        found = solve_explicit(stepped, strain, progress, element=element)
        return dataclasses.replace(found, steps=steps)
    progress(
        f"{OF_ELEMENT[element]} in motion by {steps}, {strain} strain, "
        f"{problem.mesh.num_cells} cells"
    )
    start = time.perf_counter()
    result = run_task(
        SteppedTask(steps.integrator, strain, element), stepped, time_limit=TIME_LIMIT
    )
    return _on_the_mesh(
        problem,
        strain,
        element,
        result,
        seconds=time.perf_counter() - start,
        details={
            "integrator": str(steps.integrator),
            "time_step": result.time_step,
            "num_steps": result.num_steps,
            "newton_iterations": result.newton_iterations,
            "largest_residual": result.largest_residual,
        },
        versions=dict(result.versions),
        steps=steps,
    )


def solve_implicit(
    problem: Problem,
    strain: Strain,
    steps_per_output: int,
    progress: Progress,
    *,
    degree: int = 2,
    at: TetMesh | None = None,
    time_limit: float = TIME_LIMIT,
) -> State:
    """The trajectory by the implicit reference, from rest.

    Args:
        problem: With a time span; its own time step is not used.
        strain: Strain measure.
        steps_per_output: Steps from one output to the next, >= 1.
        progress: Called with one line now and then.
        degree: Of the elements.
        at: The mesh whose points are kept; one it was refined from has them first.
        time_limit: Of the run [s], > 0.

    Raises:
        InputError: A load or tool that cannot be used.
        ReferenceFailedError: No FEniCSx, or a step without an answer.
    """
    from palpate.reference.child import run_task
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
    if problem.tools:
        task = dataclasses.replace(
            task, spectral_radius=_WITH_TOOLS, relative_tolerance=_BALANCED_WITH_TOOLS
        )
    found = run_task(task, stepped, time_limit=time_limit)
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
        tool_forces=found.tool_forces if problem.tools else None,
        trajectory=Trajectory(found.times, kept),
    )


def solve_reference(
    problem: Problem,
    strain: Strain,
    degree: int,
    progress: Progress,
    *,
    formulation: Formulation | None = None,
    element: Element = Element.LINEAR,
) -> State:
    """The reference's answer to a problem.

    A motion of degree 1 takes the problem's own steps, explicitly, where it states one; every
    other is implicit, with four steps from output to output.

    Args:
        problem: In statics with the tools at the end of their paths.
        strain: Strain measure.
        degree: Of the elements, 1 to 3; of a motion 1 or 2.
        progress: Called with one line now and then.
        formulation: Of statics: with pressure among the unknowns where MIXED; see
            `formulation_for` where None.
        element: Linear tetrahedra, plain or smoothed.

    Raises:
        InputError: A motion of smoothed tetrahedra that is not of degree 1 with a stated step, a
            mixed motion, or an element, load or tool that cannot be used.
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    if problem.time is None:
        return solve_state(
            problem, strain, degree, progress, formulation=formulation, element=element
        )
    if degree > 2:
        raise InputError("the reference moves tetrahedra of degree 1 or 2; degree 3 is for statics")
    if formulation is Formulation.MIXED:
        raise InputError(
            "the mixed formulation finds equilibrium, and this problem is a motion; leave it out"
        )
    if degree == 1 and problem.time.time_step is not None:
        return solve_explicit(problem, strain, progress, element=element)
    if element is Element.SMOOTHED:
        raise InputError(
            "the reference moves smoothed tetrahedra by explicit steps only: take degree 1, and "
            "give time_step in [time]"
        )
    return solve_implicit(problem, strain, STEPS_PER_OUTPUT, progress, degree=degree)
