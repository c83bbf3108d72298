"""Which cases a candidate can be asked: it can pose the problem, and a check is of its strain."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.meshes.errors import InputError
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.case import Case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.states import Progress


def is_answered(spec: CheckSpec, case: Case, candidate: Candidate) -> bool:
    """Whether a candidate is asked for the strain measure that a check is about."""
    return (spec.strain or case.strain) in candidate.strains_of(case.strain)


def missing_check(case: Case, candidate: Candidate) -> str:
    """Why a case judges nothing of a candidate; empty where it does."""
    if any(is_answered(spec, case, candidate) for spec in case.checks):
        return ""
    asked = " and ".join(candidate.strains_of(case.strain))
    return f"no check for {asked} strain, for which {candidate.name} is asked"


def askable_cases(
    cases: Sequence[Case], candidates: Sequence[Candidate], progress: Progress
) -> list[Case]:
    """The cases that every candidate can be asked; of the others `progress` is told why not.

    Raises:
        InputError: None is left.
    """
    left = []
    for case in cases:
        reasons = (missing_check(case, c) or c.refusal(case.problem) for c in candidates)
        reason = next(filter(None, reasons), "")
        if reason:
            progress(f"left out: {case.name}: {reason}")
        else:
            left.append(case)
    if not left:
        raise InputError("none of these cases can be asked of this candidate")
    return left
