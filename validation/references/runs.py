"""One run of the reference in a process of its own, as a state: equilibrium or a motion."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.linalg import norm

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.reference.result import (
    AdaptiveResult,
    Formulation,
    ImplicitResult,
    ReferenceResult,
    SteppedResult,
    formulation_for,
)
from palpate.reference.schemes import Integrator, Steps, are_whole_steps_apart
from palpate.validation.exchange.time_reading import read_at, to_the_end
from palpate.validation.metrics import make_state, stress_integrals
from palpate.validation.metrics.difference import measures_of
from palpate.validation.references.reference_set import OF_ELEMENT, QUADRATIC, SAME_MESH, StateKey
from palpate.validation.states import REFERENCE, CellStresses, Progress, State, Trajectory

if TYPE_CHECKING:
    from palpate.reference.tasks import Task

_Result = TypeVar("_Result")
# Little is taken from what the mesh resolves, all of what it does not within some hundred steps.
_SPECTRAL_RADIUS = 0.9
# The force of a tool is that of where it is at a step's end, along the normals there. So all forces
# are balanced there: else it would push backwards as it slides, by a part of its way in a step.
_WITH_TOOLS = 0.0
# Residual of a step's forces, relative: no bar of a tool's force is within a thousand times that.
_BALANCED_WITH_TOOLS = 1e-6
# Steps per output of an implicit truth: the shortest of those that bound its error.
STEPS_PER_OUTPUT = 4
TIME_LIMIT = 4 * 3600.0


def solve_state(
    problem: Problem,
    strain: Strain,
    degree: int,
    progress: Progress,
    *,
    formulation: Formulation | None = None,
    element: Element = Element.LINEAR,
    start: Points | None = None,
    time_limit: float = 3600.0,
) -> State:
    """Equilibrium on the problem's mesh.

    Mixed by itself for nearly incompressible material: see `formulation_for`; `start`: see
    `solve_static`; `time_limit` [s]: see `run_task`.

    Raises:
        InputError: The problem has a time span: see `solve_reference`.
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    from palpate.reference.tasks import StaticTask

    if problem.time is not None:
        raise InputError("a problem in time has no static solution; solve its motion")
    label = OF_ELEMENT[element] if degree == 1 else f"{REFERENCE} P{degree}"
    progress(f"{label}, {strain} strain, {problem.mesh.num_cells} cells")
    form = formulation or formulation_for(problem, degree)
    task = StaticTask(strain, degree, formulation=form, element=element, start=start)
    result, seconds = _timed(task, problem, time_limit, progress)
    stresses = stresses_of(result)
    return state_of(
        result,
        strain,
        label=label,
        degree=degree,
        seconds=seconds,
        element=element,
        stresses=stresses,
        integrals=None
        if degree == 1
        else stress_integrals(problem.mesh, stresses, result.strain_energy),
    )


def solve_by_steps(
    problem: Problem,
    strain: Strain,
    steps: Steps | None,
    progress: Progress,
    *,
    element: Element = Element.LINEAR,
    time_limit: float = TIME_LIMIT,
) -> State:
    """The trajectory of the case's tetrahedra, from rest, by a scheme and step, each step solved.

    What a simulator that states them differs by from it is its solver's, or that it does not do
    what it states; what it differs by from the motion itself is the scheme's.

    Args:
        problem: With a time span.
        strain: Strain measure.
        steps: Scheme and time step; the case's own step by central differences where None. Where
            its outputs are not whole steps apart, the state is read between them: `sent` has the
            steps, `other_reading` says how far the reading may be off.
        progress: Called with one line.
        element: Linear tetrahedra, plain or smoothed.
        time_limit: Time limit of the run [s], > 0.

    Raises:
        InputError: No time step in the case and none given: then there is nothing to be equal to.
            Outputs that are not whole steps apart, of the case's own step or with tools; or an
            element, load or tool that cannot be used.
        ReferenceFailedError: No FEniCSx, or a step without a solution.
    """
    from palpate.reference.tasks import SteppedTask

    stepped = problem if steps is None else at_every_step(steps.of(problem))
    if stepped.time is None or stepped.time.time_step is None:
        raise InputError("a dynamic case needs time_step in [time] for its reference")
    integrator = Integrator.CENTRAL_DIFFERENCES if steps is None else steps.integrator
    label, by = OF_ELEMENT[element], "" if steps is None else f" by {steps}"
    progress(f"{label} in motion{by}, {strain} strain, {problem.mesh.num_cells} cells")
    found, seconds = _timed(SteppedTask(integrator, strain, element), stepped, time_limit)
    details: dict[str, Any] = {"time_step": found.time_step, "num_steps": found.num_steps}
    if integrator is not Integrator.CENTRAL_DIFFERENCES:
        details |= {
            "integrator": str(integrator),
            "newton_iterations": found.newton_iterations,
            "largest_residual": found.largest_residual,
        }
    make = functools.partial(
        _motion_state, problem, problem.mesh, found, strain=strain, label=label,
        element=element, seconds=seconds, details=details, steps=steps,
    )  # fmt: skip
    if problem.time is None or stepped.time.num_outputs == problem.time.num_outputs:
        return make(found.displacements)
    span = problem.time
    wanted, slack = span.output_times, 1e-9 * span.end_time
    read = read_at(found.times, found.displacements, wanted, slack=slack)
    sent = to_the_end(found.times, found.displacements, read.states[-1:], wanted[-1], slack)
    other = make(read.others, times=wanted)
    return dataclasses.replace(make(read.states, times=wanted), sent=sent, other_reading=other)


def at_every_step(problem: Problem) -> Problem:
    """A problem whose outputs are its steps, to the first at its end or after it.

    Where its outputs are whole steps apart, or it has tools, whose forces are means from output to
    output, it is the problem itself.
    """
    span = problem.time
    if span is None or span.time_step is None or problem.tools:
        return problem
    if are_whole_steps_apart(span, span.time_step):
        return problem
    count = math.ceil(span.end_time / span.time_step * (1.0 - 1e-9))
    every = dataclasses.replace(span, end_time=count * span.time_step, num_outputs=count)
    return dataclasses.replace(problem, time=every)


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
        degree: Degree of the elements.
        at: The mesh at whose points the result is given; a mesh refined from it has them first.
        time_limit: Time limit of the run [s], > 0.

    Raises:
        InputError: A load or tool that cannot be used.
        ReferenceFailedError: No FEniCSx, or a step without a solution.
    """
    from palpate.reference.tasks import ImplicitTask

    span = problem.time
    assert span is not None
    step = span.end_time / span.num_outputs / steps_per_output
    progress(
        f"{QUADRATIC if degree == 2 else SAME_MESH} in motion, implicit, steps of {step:g} s, "
        f"{strain} strain, {problem.mesh.num_cells} cells"
    )
    stepped = dataclasses.replace(problem, time=dataclasses.replace(span, time_step=step))
    task = ImplicitTask(strain, degree, _SPECTRAL_RADIUS)
    if problem.tools:
        task = dataclasses.replace(
            task, spectral_radius=_WITH_TOOLS, relative_tolerance=_BALANCED_WITH_TOOLS
        )
    found, seconds = _timed(task, stepped, time_limit)
    mesh = problem.mesh if at is None else at
    # A truth in seven digits: its error bar is far above, and the file half as large.
    seven = found.displacements[:, : mesh.num_points].astype(np.float32)
    return _motion_state(
        problem,
        mesh,
        found,
        seven.astype(np.float64),
        strain=strain,
        label=QUADRATIC,
        degree=degree,
        seconds=seconds,
        details={
            "time_step": found.time_step,
            "newton_iterations": found.newton_iterations,
            "largest_energy_error": float(np.abs(found.energy_errors).max()),
        },
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
    """The reference's solution of a problem.

    A motion of degree 1 takes the problem's own steps, explicitly, where it states one; every
    other is implicit, with four steps from output to output.

    Args:
        problem: The problem; statics take the tools at the end of their paths.
        strain: Strain measure.
        degree: Degree of the elements, 1 to 3; of a motion 1 or 2.
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
        return solve_by_steps(problem, strain, None, progress, element=element)
    if element is Element.SMOOTHED:
        raise InputError(
            "the reference moves smoothed tetrahedra by explicit steps only: take degree 1, and "
            "give time_step in [time]"
        )
    return solve_implicit(problem, strain, STEPS_PER_OUTPUT, progress, degree=degree)


def state_of(
    found: ReferenceResult, strain: Strain, *, label: str, degree: int, seconds: float, **rest: Any
) -> State:
    """A static solution of the reference, named and timed; `rest` are further fields of `State`."""
    return State(
        label=label,
        simulator=REFERENCE,
        strain=strain,
        degree=degree,
        displacement=found.displacement,
        volume=found.volume,
        surface_area=found.surface_area,
        smallest_det_f=found.smallest_det_f,
        max_displacement=float(norm(found.displacement, axis=1).max()),
        seconds=seconds,
        tool_forces=np.array([tool.forces[-1] for tool in found.tools]) if found.tools else None,
        details={
            "relative_residual": found.relative_residual,
            "newton_iterations": found.newton_iterations,
            "formulation": found.formulation.value,
        },
        versions=dict(found.versions),
        **rest,
    )


def first_state(found: AdaptiveResult, **rest: Any) -> State:
    """The result of an adaptive truth, begun from nothing, on the case's mesh; as `state_of`."""
    first, seconds = found.first, float(found.seconds[0])
    assert first is not None
    return state_of(
        first, first.strain, label=QUADRATIC, degree=found.degree, seconds=seconds, **rest
    )


def stresses_of(found: ReferenceResult) -> CellStresses:
    """Cell stresses of a result."""
    return CellStresses(
        found.second_piola_kirchhoff_stress,
        found.cauchy_stress,
        found.first_piola_kirchhoff_stress,
    )


def at_points_of(mesh: TetMesh, state: State) -> State:
    """A state of a refined mesh at the points of the mesh it came from, which come first.

    Of a static one volume and area stay those of its own mesh; its stresses, which are of other
    cells, are left out.
    """
    motion = state.trajectory
    if motion is not None:
        moved = motion.displacements[:, : mesh.num_points]
        measures = measures_of(mesh, moved[-1])
        return dataclasses.replace(state, trajectory=Trajectory(motion.times, moved), **measures)
    at_points = state.displacement[: mesh.num_points]
    return dataclasses.replace(
        state,
        displacement=at_points,
        max_displacement=float(norm(at_points, axis=1).max()),
        stresses=None,
        integrals=None,
    )


@contextmanager
def failure_recorded(
    failures: dict[StateKey, str], key: StateKey, is_for_storing: bool = False, how: str = ""
) -> Iterator[None]:
    """Record why a run failed, unless it is for storing, or none can succeed here."""
    try:
        yield
    except ReferenceFailedError as error:
        if is_for_storing or isinstance(error, ReferenceUnavailableError):
            raise
        failures[key] = f"{key[0]}{how}: {error}"


def _motion_state(
    problem: Problem,
    mesh: TetMesh,
    found: SteppedResult | ImplicitResult,
    displacements: Floats,
    *,
    times: Floats | None = None,
    **more: Any,
) -> State:
    """A motion of the reference at the points of a mesh; `more` are further fields of `State`."""
    return make_state(
        mesh,
        displacements[-1],
        simulator=REFERENCE,
        trajectory=Trajectory(found.times if times is None else times, displacements),
        tool_forces=found.tool_forces if problem.tools else None,
        versions=dict(found.versions),
        **more,
    )


def _timed(
    task: Task[_Result],
    problem: Problem,
    time_limit: float,
    progress: Callable[[str], None] | None = None,
) -> tuple[_Result, float]:
    """The result of a task in a process of its own, and the seconds that it took."""
    from palpate.reference.child import run_task

    start = time.perf_counter()
    found = run_task(task, problem, time_limit=time_limit, progress=progress)
    return found, time.perf_counter() - start
