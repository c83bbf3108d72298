"""What linear strain costs: its distance from the truth with Green strain, and whether it will do.

Measured between the two truths there is the strain measure alone in it, not a candidate's mesh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.meshes.problem import Element, Strain
from palpate.validation.judging.checks import decide
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.metrics import measure
from palpate.validation.states import State, Verdict


@dataclass(frozen=True)
class LinearStrain:
    """Whether linear strain may stand in for Green's, and the sentence that says so."""

    verdict: Verdict
    says: str


def green_truth(result: CaseResult) -> State | None:
    """The best solution with Green strain of a case at rest; None where there is none."""
    if result.problem.time is not None:
        return None
    found = [
        s for s in result.states if s.is_reference and s.strain is Strain.GREEN and s.degree > 1
    ]
    # The finer truth has the longer name.
    return max(found, key=lambda state: len(state.label), default=None)


def off_of(result: CaseResult, state: State) -> float | None:
    """How far a state's displacement is from that truth, over the truth's own length (L2) [-].

    None where there is no truth, for the truth itself, and where the meshes are not the same.
    """
    truth = green_truth(result)
    if truth is None or state is truth or state.displacement.shape != truth.displacement.shape:
        return None
    value = measure("displacement_l2", result.problem, state, truth).value
    return value if math.isfinite(value) else None


def percent_off(result: CaseResult, state: State) -> float | None:
    """`off_of` in per cent, for tables."""
    value = off_of(result, state)
    return None if value is None else 100.0 * value


def linear_strain_of(result: CaseResult, far: Sequence[CheckResult]) -> LinearStrain | None:
    """Whether linear strain may stand in for Green's; None where the case does not tell.

    `far` are the checks against the truth.
    """
    asked = next((c for c in far if c.metric == "displacement_l2"), None)
    if asked is None or asked.strain is not Strain.GREEN:
        return None
    linear = [s for s in result.states if s.strain is Strain.LINEAR]
    # The truth's own linear solution comes first, then smoothed tetrahedra's, whose own error is
    # small beside that of the strain.
    linear = [s for s in linear if s.degree > 1 or not s.is_reference]
    linear.sort(key=lambda s: (s.degree, len(s.label), s.element is Element.SMOOTHED), reverse=True)
    found = [s for s in linear if s.is_reference] or linear
    value = off_of(result, found[0]) if found else None
    if value is None:
        return None
    verdict = decide(value, asked.reference_error, asked.limit)
    may = {Verdict.PASSED: "may stand in", Verdict.FAILED: "may not stand in"}.get(
        verdict, "can neither be allowed nor ruled out to stand in"
    )
    says = (
        f"Linear strain {may} for Green's: with it displacement is off by {100.0 * value:.2g} % "
        f"(allowed: {100.0 * asked.limit:.2g} %)."
    )
    return LinearStrain(verdict, says)
