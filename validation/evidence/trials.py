"""A trial of the gates themselves, in the form of a check."""

from __future__ import annotations

from palpate.meshes.problem import Strain
from palpate.validation.judging.results import CheckResult
from palpate.validation.states import Verdict


def trial_check(
    name: str, strain: Strain, is_good: bool, message: str, *, reason: str
) -> CheckResult:
    """Passed where the gate did what it should; it has no number and no limit."""
    return CheckResult(
        metric=name,
        against="self-test",
        strain=strain,
        value=None,
        limit=0.0,
        scale="-",
        unit="-",
        reference_error=0.0,
        verdict=Verdict.PASSED if is_good else Verdict.FAILED,
        reason=reason,
        message=message,
    )
