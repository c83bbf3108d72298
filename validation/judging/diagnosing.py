"""What would explain a red gate: each answer that failed a check is diagnosed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from palpate.meshes.problem import Problem, Strain
from palpate.validation.diagnosis import Diagnosis, diagnose
from palpate.validation.diagnosis.asked import Ask
from palpate.validation.judging.results import CheckResult
from palpate.validation.references.sets import ReferenceSet
from palpate.validation.simulators.candidate import Candidate
from palpate.validation.states import State, Verdict

_OTHER = {Strain.GREEN: Strain.LINEAR, Strain.LINEAR: Strain.GREEN}
# A candidate that takes longer [s] is not asked again.
_QUICK = 10.0


def diagnose_failures(
    problem: Problem,
    candidate: Candidate,
    answers: Mapping[Strain, State],
    references: ReferenceSet,
    checks: Sequence[CheckResult],
    *,
    length_unit: str,
    progress: Callable[[str], None],
) -> tuple[Diagnosis, ...]:
    """One for each of the candidate's answers that a check failed; none where all is well.

    Args:
        problem: The case's problem.
        candidate: Asked again where it is quick and nothing else explains its answer.
        answers: Its states by strain measure; one that is missing cannot be diagnosed.
        references: Of the case: the one on the same mesh is held beside.
        checks: As they were judged.
        length_unit: The case's, for places.
        progress: Called with one line for each.
    """
    failed = {check.strain for check in checks if check.verdict is Verdict.FAILED}
    found = []
    for strain, answer in answers.items():
        if strain not in failed:
            continue
        progress(f"diagnosis, {strain} strain")
        found.append(
            diagnose(
                problem,
                answer,
                references.same_mesh(strain),
                other_strain=references.same_mesh(_OTHER[strain]),
                ask=_ask(candidate, strain) if answer.seconds < _QUICK else None,
                length_unit=length_unit,
            )
        )
    return tuple(found)


def _ask(candidate: Candidate, strain: Strain) -> Ask | None:
    if not candidate.can_be_asked:
        return None
    return lambda problem: candidate.solve(problem, strain, lambda _line: None).displacement
