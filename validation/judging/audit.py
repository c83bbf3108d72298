"""The audit of a candidate's result: by the equations that it should satisfy, nothing solved."""

from __future__ import annotations

import dataclasses

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.reference.errors import ReferenceUnavailableError
from palpate.reference.result import Audit
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.candidates.equations import differences, in_words
from palpate.validation.case import Case
from palpate.validation.metrics.audit import audit_on_own_mesh
from palpate.validation.metrics.validity import unmeasurable_state
from palpate.validation.states import CandidateFailedError, Precision, Progress, State


def audit_result(
    case: Case, candidate: Candidate, *, strain: Strain, degree: int, progress: Progress
) -> tuple[State, Audit]:
    """A candidate's solution with its audit: of degree 1 by the judge, beyond by the reference.

    Degree 1 tests the equations of the candidate's tetrahedra, plain or smoothed, as the caller
    says; degrees 2 and 3 test those of the continuum, whatever the element. See `audit`.

    Raises:
        InputError: The case is a motion, or the result cannot be read, is on another mesh, or
            states other equations than the case's or the caller's.
        CandidateFailedError: The result contains NaN, numbers too large to measure, or a body
            of quite another size.
        ReferenceFailedError, ReferenceUnavailableError: The audit could not be done.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import AuditTask

    problem = case.problem
    if problem.time is not None:
        raise InputError(f"{case.name} is dynamic: what moves is not in equilibrium")
    state = candidate.solve(problem, strain, progress)
    unmeasurable = unmeasurable_state(state)
    if unmeasurable:
        raise CandidateFailedError(unmeasurable)
    if state.own is not None:
        own, mesh = state.own.mesh, problem.mesh
        raise InputError(
            f"{candidate.name} is on a mesh of its own, of {own.num_points} points and "
            f"{own.num_cells} cells; the case has {mesh.num_points} and {mesh.num_cells}. An audit "
            "sees the case's points alone, and nothing between them: send the displacement at "
            "these, without other points, or judge it where it is by `palpate compare`"
        )
    displacement = state.displacement
    # Degrees 2 and 3 ask nothing of the element.
    left_out = () if degree == 1 else ("element",)
    says = {key: value for key, value in state.says.items() if key not in left_out}
    stated = differences(
        problem,
        dataclasses.replace(state, says=says),
        element=candidate.element,
        steps=candidate.asked,
        is_stepped=False,
        precision=Precision.SINGLE,
    )
    if stated:
        raise InputError(f"{candidate.name}: {in_words(stated)}")
    if degree == 1:
        progress(f"audit on degree 1: {displacement.size} degrees of freedom")
        return state, audit_on_own_mesh(problem, displacement, strain, state.element)
    task = AuditTask(displacement, strain, degree)
    try:
        return state, run_task(task, problem, progress=progress)
    except ReferenceUnavailableError as error:
        raise ReferenceUnavailableError(f"{error}; degree 1 needs none of it") from None
