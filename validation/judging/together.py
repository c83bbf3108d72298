"""Several candidates on one case, as one result: their checks, states and words together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.metrics import CATALOGUE
from palpate.validation.states import gravest


def is_of_truth(check: CheckResult) -> bool:
    """Whether the truth itself is held against a number, whoever the candidate is."""
    return check.against == "truth" and CATALOGUE[check.metric].is_published


def together(results: Sequence[CaseResult]) -> CaseResult:
    """One result of several candidates' on the same case; the gravest verdict is its own.

    What is said of the references, and checked of the truth itself, stands there once.
    """
    first, *others = results
    if not others:
        return first
    states = {(s.label, s.strain): s for r in results for s in r.states if not s.is_reference}
    states |= {(s.label, s.strain): s for r in results for s in r.states if s.is_reference}
    more = [check for other in others for check in other.checks if not is_of_truth(check)]
    return replace(
        first,
        verdict=gravest([result.verdict for result in results]),
        candidates=tuple(judged for result in results for judged in result.candidates),
        checks=(*first.checks, *more),
        states=tuple(states.values()),
        metrics={name: value for result in results for name, value in result.metrics.items()},
        notes=tuple(dict.fromkeys(note for result in results for note in result.notes)),
        error_fields={name: f for result in results for name, f in result.error_fields.items()},
        candidate_says={key: said for r in results for key, said in r.candidate_says.items()},
        unseen=tuple(dict.fromkeys(name for result in results for name in result.unseen)),
        diagnoses=tuple(found for result in results for found in result.diagnoses),
    )
