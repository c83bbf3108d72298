"""The first screen: can this simulator be trusted for this?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.validation.judging.outputs import check_name
from palpate.validation.judging.results import CaseResult, CheckResult, Judged, Scope
from palpate.validation.states import Verdict

# Rows of the scale, the worst first; nobody takes in more at a glance.
_MOST_ROWS = 6
# The scale ends here [limits]; beyond it an arrow and the number.
_END = 2.0
# A bar above this part of the limit is worth a word.
_WIDE = 0.25


@dataclass(frozen=True)
class Row:
    """One distance on the scale; places in per cent of its width."""

    name: str
    css: str
    dot: float
    start: float
    width: float
    needed: float
    says: str
    is_beyond: bool


@dataclass(frozen=True)
class Trust:
    """What a person who must decide reads first.

    Attributes:
        css: Class of the verdict's colour: a verdict, or "narrow" of what passed without a truth.
        word: The verdict, short.
        answer: One sentence.
        failures: What did not pass, grouped, a sentence each.
        scale: Distances from the truth beside what the use needs, the worst first.
        context: Context of use, as the case states it.
        caveat: The largest.
        explanation: The most probable one of what failed.
    """

    css: str
    word: str
    answer: str
    failures: tuple[str, ...]
    scale: tuple[Row, ...]
    context: str
    caveat: str
    explanation: str


def trust_of(result: CaseResult) -> Trust:
    """Sum up a judged case."""
    far = _from_truth(result.checks)
    is_narrow = result.verdict is Verdict.PASSED and result.scope is not Scope.TRUTH
    explained = [str(found) for found in result.diagnoses]
    return Trust(
        css="narrow" if is_narrow else str(result.verdict),
        word=str(result.verdict),
        answer=_answer(result, far),
        failures=tuple(
            _group(result, judged) for judged in result.candidates if _left(result, judged)
        ),
        scale=tuple(_row(check) for check in far[:_MOST_ROWS]),
        context=str(result.evidence.get("context_of_use") or "not stated"),
        caveat=_caveat(result, far),
        explanation=explained[0] if explained else "",
    )


def _from_truth(checks: Sequence[CheckResult]) -> list[CheckResult]:
    """The candidate's checks against the truth or a published number, the worst first."""
    found = [c for c in checks if c.scope is Scope.TRUTH and c.value is not None and c.limit > 0.0]
    return sorted(found, key=_used, reverse=True)


def _used(check: CheckResult) -> float:
    """Error and bar in parts of the limit."""
    used = ((check.value or 0.0) + check.reference_error) / check.limit
    return used if math.isfinite(used) else math.inf


def _answer(result: CaseResult, far: Sequence[CheckResult]) -> str:
    if result.verdict is Verdict.PASSED:
        if result.scope is not Scope.TRUTH:
            return result.scope.caution.capitalize() + "."
        return (
            f"At most {_percent(far[0])} from the truth, where {_limit(far[0])} is needed."
            if far
            else ""
        )
    wrong = [c for c in result.checks if c.verdict is Verdict.FAILED]
    if result.verdict is Verdict.FAILED and wrong:
        same = [c for c in wrong if c.against == "same_mesh"]
        if same:
            return "It does not solve the case's equations: wrong on the same mesh already."
        if any(c in far for c in wrong):
            worst = next(c for c in far if c in wrong)
            return f"{_percent(worst)} from the truth, where {_limit(worst)} is needed."
        return "A check of the answer itself failed."
    return "The reference does not allow a verdict."


def _percent(check: CheckResult) -> str:
    value, bar = check.value or 0.0, check.reference_error
    if not math.isfinite(bar):
        return f"{100.0 * value:.2g} % (the truth's own error is not known)"
    return f"{100.0 * value:.2g} % ± {100.0 * bar:.1g} %"


def _limit(check: CheckResult) -> str:
    return f"{100.0 * check.limit:.2g} %"


def _left(result: CaseResult, judged: Judged) -> list[CheckResult]:
    """Checks of one candidate that did not pass."""
    bad = (Verdict.FAILED, Verdict.INCONCLUSIVE)
    return [c for c in result.checks if c.verdict in bad and c.element is judged.element]


def _group(result: CaseResult, judged: Judged) -> str:
    """The failures of one candidate in one sentence: how many, how far, where the worst is."""
    left = _left(result, judged)
    total = sum(c.element is judged.element for c in result.checks)
    who = f"{judged.name}: " if len(result.candidates) > 1 else ""
    words = "not passed" if any(c.verdict is Verdict.INCONCLUSIVE for c in left) else "failed"
    told = [c for c in left if c.value is not None and c.limit > 0.0]
    if not told:
        return f"{who}{len(left)} of {total} checks {words}: {left[0].message}"
    worst = max(told, key=_used)
    return (
        f"{who}{len(left)} of {total} checks {words}. The worst by its limit: {check_name(worst)}, "
        f"{worst.message}"
    )


def _caveat(result: CaseResult, far: Sequence[CheckResult]) -> str:
    """What a reader must know most, by gravity."""
    if result.scope is Scope.SAME_MESH:
        return "How far this mesh is from the continuum was not asked."
    if result.scope is Scope.OWN:
        return "Nothing independent was compared with."
    if result.unseen:
        return f"Plainly wrong answers would pass too: {', '.join(result.unseen)}."
    if fitted := result.evidence.get("fitted"):
        return f"Fitted, so no evidence where it was fitted to: {', '.join(fitted)}."
    wide = [c for c in far if c.reference_error > _WIDE * c.limit]
    if wide:
        bar = max(c.reference_error / c.limit for c in wide)
        told = f"{100.0 * bar:.0f} % of the limit" if math.isfinite(bar) else "no known size"
        return f"The truth itself has an error bar of {told}."
    return (
        "This is verification: the equations are solved well. Whether they are those of the "
        "tissue, only measurements tell."
    )


def _row(check: CheckResult) -> Row:
    """A check on a scale from 0 to `_END` limits."""
    value, bar = (check.value or 0.0) / check.limit, check.reference_error / check.limit
    known = bar if math.isfinite(bar) else _END

    def at(part: float) -> float:
        return 100.0 * min(max(part, 0.0), _END) / _END

    start, end = at(value - known), at(value + known)
    return Row(
        name=check_name(check).replace("(truth, ", "(").replace("(own, ", "("),
        css=str(check.verdict),
        dot=at(value),
        start=start,
        width=end - start,
        needed=100.0 / _END,
        says=f"{_percent(check)} of {_limit(check)}",
        is_beyond=value > _END,
    )
