"""A result held against the equations it should satisfy, without solving them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.reference.errors import ReferenceUnavailableError
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.case import Case
from palpate.validation.metrics.possible_motion import unmeasurable_state
from palpate.validation.states import CandidateFailedError, Progress, State

if TYPE_CHECKING:
    from palpate.reference.result import Audit


@dataclass(frozen=True, eq=False)
class Audited:
    """What was audited, and what was found."""

    state: State
    audit: Audit


def audit_result(
    case: Case, candidate: Candidate, *, strain: Strain, degree: int, progress: Progress
) -> Audited:
    """Audit a candidate's answer: on degree 1 by the judge itself, beyond that by the reference.

    Degree 1 is the equations of the answer's own tetrahedra, plain or smoothed; degrees 2 and 3
    are the continuum's, whatever it was made with.

    Raises:
        InputError: A case that moves, or a result that cannot be read.
        CandidateFailedError: The result holds NaN, numbers too large to measure, or a body
            of quite another size.
        ReferenceFailedError, ReferenceUnavailableError: The audit could not be done.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import AuditTask
    from palpate.validation.metrics.audit import audit_on_own_mesh

    problem = case.problem
    if problem.time is not None:
        raise InputError(f"{case.name} is dynamic: what moves is not in equilibrium")
    state = candidate.solve(problem, strain, progress)
    unmeasurable = unmeasurable_state(state)
    if unmeasurable:
        raise CandidateFailedError(unmeasurable)
    displacement = state.displacement
    if degree == 1:
        progress(f"audit on degree 1: {displacement.size} degrees of freedom")
        return Audited(state, audit_on_own_mesh(problem, displacement, strain, state.element))
    task = AuditTask(displacement, strain, degree)
    try:
        return Audited(state, run_task(task, problem, progress=progress))
    except ReferenceUnavailableError as error:
        raise ReferenceUnavailableError(f"{error}; degree 1 needs none of it") from None
