"""A result held against the equations it should satisfy, without solving them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Strain
from palpate.validation.case import Case
from palpate.validation.metrics.possible_motion import unmeasurable_state
from palpate.validation.simulators.candidate import Candidate
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
    """Audit a candidate's answer.

    Raises:
        InputError: A case that moves, or a result that cannot be read.
        CandidateFailedError: The result holds NaN, numbers too large to measure, or a body
            of quite another size.
        ReferenceFailedError, ReferenceUnavailableError: The audit could not be done.
    """
    from palpate.reference.child import run_task
    from palpate.reference.result import Audit
    from palpate.reference.tasks import AuditTask

    if case.problem.time is not None:
        raise InputError(f"{case.name} is dynamic: what moves is not in equilibrium")
    state = candidate.solve(case.problem, strain, progress)
    unmeasurable = unmeasurable_state(state)
    if unmeasurable:
        raise CandidateFailedError(unmeasurable)
    # Smoothed tetrahedra are of degree 1; beyond that it is the continuum's equations.
    element = state.element if degree == 1 else Element.LINEAR
    task = AuditTask(state.displacement, strain, degree, element)
    found = run_task(task, case.problem, progress=progress)
    assert isinstance(found, Audit)
    return Audited(state, found)
