"""The first screen: can this simulator be trusted for this?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.problem import Element, Strain
from palpate.validation.judging.checks import STATED
from palpate.validation.judging.results import CaseResult, CheckResult, Judged, Scope, error_name
from palpate.validation.report.comparisons import comparisons_of
from palpate.validation.states import Verdict

# Most rows of the scale, the worst first; nobody takes in more at a glance.
_MOST_ROWS = 6
# Upper end of the scale [limits]; beyond it stand an arrow and the number.
_END = 2.0
# A bar above this fraction of the limit is mentioned.
_WIDE = 0.25
# Names of quantities on the first screen; the tables below it use the metrics' names.
_QUANTITIES = {
    "displacement_l2": "displacement",
    "displacement_max": "displacement at the worst point",
    "max_displacement": "largest displacement",
    "stress_l2": "stress",
    "trajectory_l2": "displacement over time",
    "tool_force": "force on the tool",
    "traction_resultant": "force through a cut",
}
_FIRST = ("displacement_l2", "trajectory_l2")
# Where nothing was compared with the truth, this replaces "passed".
_NARROW = {Scope.SAME_MESH: "same mesh only", Scope.OWN: "no reference"}


@dataclass(frozen=True)
class Row:
    """One distance on the scale; positions are in per cent of its width."""

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

    The verdict's `css` class (see `CaseResult.tone`) and `word` (if it passed without a truth, what
    it was judged against), the `answer` in one sentence, a sentence on each group of `failures`,
    distances from the truth beside what the use needs (`scale`, the worst first), the `context` of
    use, the reason for the limit that is `needed`, the gravest `caveat`, and the most probable
    `explanation` of a failure.
    """

    css: str
    word: str
    answer: str
    failures: tuple[str, ...]
    scale: tuple[Row, ...]
    context: str
    needed: str
    caveat: str
    explanation: str


def trust_of(result: CaseResult) -> Trust:
    """Summarise a judged case."""
    far = _from_truth(result.checks)
    several = len(result.candidates) > 1
    return Trust(
        css=result.tone,
        word=_NARROW[result.scope] if result.tone == "narrow" else str(result.verdict),
        answer=_answer(result, far),
        failures=tuple(
            _group(result, judged) for judged in result.candidates if _left(result, judged)
        ),
        scale=tuple(_row(check, _name(check, far, several)) for check in far[:_MOST_ROWS]),
        context=str(result.evidence.get("context_of_use") or "not stated"),
        # That on displacement, if there is one.
        needed=next((c.reason for c in sorted(far, key=lambda c: c.metric not in _FIRST)), ""),
        caveat=_caveat(result, far),
        explanation=_explanation(result),
    )


def _from_truth(checks: Sequence[CheckResult]) -> list[CheckResult]:
    """The candidate's checks against the truth or a published number, the worst first."""
    found = [c for c in checks if c.scope is Scope.TRUTH and c.value is not None and c.limit > 0.0]
    return sorted(found, key=_used, reverse=True)


def _used(check: CheckResult) -> float:
    """Error and bar as a fraction of the limit."""
    used = ((check.value or 0.0) + check.reference_error) / check.limit
    return used if math.isfinite(used) else math.inf


def _answer(result: CaseResult, far: Sequence[CheckResult]) -> str:
    if result.tone == "narrow":
        return result.scope.caution.capitalize() + "."
    if result.verdict is Verdict.PASSED:
        return f"Close enough: {_distance(far[0])}." if far else ""
    wrong = [c for c in result.checks if c.verdict is Verdict.FAILED]
    is_good = all(c.verdict in (Verdict.PASSED, Verdict.SKIPPED) for c in result.checks)
    if result.verdict is Verdict.INCONCLUSIVE and is_good:
        return "What was checked does not support a verdict; a line below says why."
    if result.verdict is not Verdict.FAILED or not wrong:
        return "The reference does not allow a verdict: it may be close enough, or not."
    same = [c for c in wrong if c.against == "same_mesh" and c.value is not None]
    worst = max(same, key=_used, default=None) or next((c for c in far if c in wrong), None)
    stated = next((c for c in wrong if c.metric == STATED), None)
    if worst is None and stated is not None:
        return f"It says that it solved other equations: {stated.message}."
    if worst is None:
        return "A check of the result itself failed."
    who = next((j.name for j in result.candidates if j.element is worst.element), "")
    if same:
        off = f"its {_quantity(worst)} is {100.0 * (worst.value or 0.0):.2g} % off"
        says = f"It does not solve the case's equations: on the same mesh already, {off}."
    else:
        says = f"Not close enough: {_distance(worst)}."
    return f"{who}: {says[0].lower()}{says[1:]}" if len(result.candidates) > 1 else says


def _distance(check: CheckResult) -> str:
    return f"{_quantity(check)} is {_percent(check)} from the truth; {_limit(check)} is needed"


def _quantity(check: CheckResult) -> str:
    """The quantity of a check, in words."""
    return _QUANTITIES.get(check.metric, check.metric.replace("_", " "))


def _name(check: CheckResult, far: Sequence[CheckResult], several: bool) -> str:
    """The name of a row: the quantity, and whatever else distinguishes the rows."""
    words = [_quantity(check)]
    if len({c.strain for c in far}) > 1:
        words.append(f"{check.strain} strain")
    if several:
        words.append("smoothed" if check.element is Element.SMOOTHED else "linear tetrahedra")
    return ", ".join(words)


def _explanation(result: CaseResult) -> str:
    """The most probable explanation in short; the diagnosis below states all of it."""
    found = [diagnosis for diagnosis in result.diagnoses if diagnosis.explanations]
    mistakes = [d.explanations for d in found if d.explanations[0].complexity > 0]
    if mistakes:
        names = [each.name for each in mistakes[0]]
        more = f", or {names[1]}" if len(names) > 1 else ""
        return f"{names[0]}{more}"
    if found:
        return "the equations are solved right; the mesh or the element is too coarse for this use"
    return next((str(diagnosis) for diagnosis in result.diagnoses if diagnosis.tested), "")


def _percent(check: CheckResult) -> str:
    value, bar = check.value or 0.0, check.reference_error
    if not math.isfinite(bar):
        return f"{100.0 * value:.2g} % (the truth's own error is not known)"
    return f"{100.0 * value:.2g} % ± {100.0 * bar:.1g} %"


def _limit(check: CheckResult) -> str:
    return f"{100.0 * check.limit:.2g} %"


def _left(result: CaseResult, judged: Judged) -> list[CheckResult]:
    """The checks of one candidate that did not pass."""
    bad = (Verdict.FAILED, Verdict.INCONCLUSIVE)
    return [c for c in result.checks if c.verdict in bad and c.element is judged.element]


def _group(result: CaseResult, judged: Judged) -> str:
    """The failures of one candidate in one sentence: how many, how far, where the worst is."""
    left = _left(result, judged)
    total = sum(c.element is judged.element for c in result.checks)
    who = f"{judged.name}: " if len(result.candidates) > 1 else ""
    words = "not passed" if any(c.verdict is Verdict.INCONCLUSIVE for c in left) else "failed"
    shown = [c for c in left if c.value is not None and c.limit > 0.0]
    first = max(shown, key=_used) if shown else left[0]
    where = where_wrong(result, judged) or f"{first.name}, {first.message}"
    return f"{who}{len(left)} of {total} checks {words}: {where}"


def _caveat(result: CaseResult, far: Sequence[CheckResult]) -> str:
    """The gravest caveat that a reader must know."""
    if result.scope is Scope.SAME_MESH:
        return f"How far this mesh is from the continuum was not asked{_unasked(result)}."
    if result.scope is Scope.OWN:
        return "Nothing independent was compared with."
    if result.unseen:
        return f"Plainly wrong answers would pass too: {', '.join(result.unseen)}."
    if fitted := result.evidence.get("fitted"):
        return f"Fitted, so no evidence where it was fitted to: {', '.join(fitted)}."
    wide = [c for c in far if c.reference_error > _WIDE * c.limit]
    if wide:
        bar = max(c.reference_error / c.limit for c in wide)
        size = f"{100.0 * bar:.0f} % of the limit" if math.isfinite(bar) else "no known size"
        return f"The truth itself has an error bar of {size}."
    return (
        "This is verification: the equations are solved well. Whether they are those of the "
        "tissue, only measurements tell."
    )


def _unasked(result: CaseResult) -> str:
    """The distance from a truth that is at hand, though no check asks for it."""
    names = [
        error_name("truth", Strain.GREEN, j.element, "displacement_l2") for j in result.candidates
    ]
    known = [value for name in names if (value := result.metrics.get(name)) is not None]
    if result.problem.time is not None or not known:
        return ""
    return f"; a truth is available, and displacement is {100.0 * max(known):.2g} % from it"


def _row(check: CheckResult, name: str) -> Row:
    """A check on a scale from 0 to `_END` limits."""
    value, bar = (check.value or 0.0) / check.limit, check.reference_error / check.limit
    known = bar if math.isfinite(bar) else _END

    def at(part: float) -> float:
        return 100.0 * min(max(part, 0.0), _END) / _END

    start, end = at(value - known), at(value + known)
    return Row(
        name=name,
        css=str(check.verdict),
        dot=at(value),
        start=start,
        width=end - start,
        needed=100.0 / _END,
        says=f"{_percent(check)} of {_limit(check)}",
        is_beyond=value > _END,
    )


_MILLI = 1e3
# An error below this fraction of the largest displacement is not located.
_LEAST = 1e-6
# Points that move less than this fraction of the largest show no relative error.
_MOVES = 0.2
# The middle eight tenths of relative errors count as one number if within this factor.
_LOW, _HIGH, _EVEN = 0.1, 0.9, 1.5
# A point is "at" a part of the body within this fraction of its size.
_NEAR = 0.08
_MOST = 0.9


def where_wrong(result: CaseResult, judged: Judged) -> str:
    """As "wrong everywhere by about 18 %, most where the body moves most, at (20, 1, 90) mm".

    The error is that of Green strain against the truth, or else against the same mesh; for a motion
    it is the largest over all stored times at each point. "" where there is nothing to compare
    with, or no error worth locating.
    """
    for shown in comparisons_of(result):
        for one, other in shown.pairs:
            if result.states[one].label == judged.name:
                return _says(result, one, other)
    return ""


def _says(result: CaseResult, one: int, other: int) -> str:
    candidate, reference = result.states[one].displacements, result.states[other].displacements
    moved = np.linalg.norm(reference, axis=2).max(axis=0)
    apart = np.linalg.norm(candidate - reference, axis=2).max(axis=0)
    top, worst = float(moved.max()), int(np.argmax(apart))
    if not apart[worst] > _LEAST * top > 0.0:
        return ""
    there = moved > _MOVES * top
    low, middle, high = np.quantile(apart[there] / moved[there], (_LOW, 0.5, _HIGH))
    if high <= _EVEN * low:
        amount = f"wrong everywhere by about {_rough(middle)}"
    else:
        amount = f"wrong by {_rough(low)} to {_rough(high)} depending on where"
    position = ", ".join(f"{x * _MILLI:.3g}" for x in result.problem.mesh.points[worst])
    if len(candidate) > 1:
        amount += " at the worst moment"
    return f"{amount}, most {_place(result, worst, moved)}, at ({position}) mm"


def _place(result: CaseResult, point: int, moved: Floats) -> str:
    """The part of the body that a point belongs to."""
    if moved[point] >= _MOST * moved.max():
        return "where the body moves most"
    problem = result.problem
    fixed = [support.points for support in problem.supports]
    loaded = [
        rows
        for load in problem.loads
        for part in ("facets", "points")
        if (rows := getattr(load, part, None)) is not None
    ]
    if _is_near(result, point, fixed):
        return "at the support"
    return "at the load" if _is_near(result, point, loaded) else "between load and support"


def _is_near(result: CaseResult, point: int, parts: list[Indices]) -> bool:
    """Whether a point lies close to the points of one of the parts."""
    points = result.problem.mesh.points
    rows = np.unique(np.concatenate([part.ravel() for part in parts])) if parts else []
    if not len(rows):
        return False
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    apart = np.linalg.norm(points[rows] - points[point], axis=1)
    return bool(apart.min() <= _NEAR * size)


def _rough(value: float) -> str:
    return f"{100.0 * value:.2g} %"
