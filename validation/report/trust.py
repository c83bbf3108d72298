"""The first screen: can this simulator be trusted for this?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.problem import Element, Strain
from palpate.validation.judging.results import CaseResult, CheckResult, Judged, Scope, error_name
from palpate.validation.report.answer import (
    Band,
    Step,
    amount_of,
    bands_of,
    key_in_words,
    next_steps,
    quantity_of,
    used_of,
)
from palpate.validation.report.comparisons import comparisons_of
from palpate.validation.states import Verdict

# Most rows of the scale, the worst first; nobody takes in more at a glance.
_MOST_ROWS = 6
# Upper end of the scale [limits]; beyond it stand an arrow and the number.
_END = 2.0
# A bar above this fraction of the limit is mentioned.
_WIDE = 0.25
_FIRST = ("displacement_l2", "trajectory_l2")


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

    A verdict on each candidate and on linear strain (`bands`), what to do `next`, a sentence on
    each group of `failures`, distances from the truth beside what the use needs (`scale`, the worst
    first), the `context` of use, the reason for the limit that is `needed`, the gravest `caveat`,
    and the most probable `explanation` of a failure.
    """

    bands: tuple[Band, ...]
    next: tuple[Step, ...]
    failures: tuple[str, ...]
    scale: tuple[Row, ...]
    context: str
    needed: str
    caveat: str
    explanation: str

    @property
    def answer(self) -> str:
        """The sentences of all bands."""
        return " ".join(band.says for band in self.bands)


def trust_of(result: CaseResult) -> Trust:
    """Summarise a judged case."""
    far = _from_truth(result.checks)
    several = len(result.candidates) > 1
    return Trust(
        bands=bands_of(result, far),
        next=next_steps(result, far, result.units.in_case_units(_mistake(result))),
        failures=tuple(
            _group(result, judged) for judged in result.candidates if _left(result, judged)
        ),
        scale=tuple(_row(check, _name(check, far, several)) for check in far[:_MOST_ROWS]),
        context=str(result.evidence.get("context_of_use") or "not stated"),
        # That on displacement, if there is one.
        needed=next((c.reason for c in sorted(far, key=lambda c: c.metric not in _FIRST)), ""),
        caveat=_caveat(result, far),
        explanation=result.units.in_case_units(_explanation(result)),
    )


def _from_truth(checks: Sequence[CheckResult]) -> list[CheckResult]:
    """The candidate's checks against the truth or a published number, the worst first."""
    found = [c for c in checks if c.scope is Scope.TRUTH and c.value is not None and c.limit > 0.0]
    return sorted(found, key=used_of, reverse=True)


def _name(check: CheckResult, far: Sequence[CheckResult], several: bool) -> str:
    """The name of a row: the quantity, and whatever else distinguishes the rows."""
    words = [quantity_of(check)]
    if len({c.strain for c in far}) > 1:
        words.append(f"{check.strain} strain")
    if several:
        words.append("smoothed" if check.element is Element.SMOOTHED else "linear tetrahedra")
    return ", ".join(words)


def _mistake(result: CaseResult) -> str:
    """The mistake that the diagnosis names, with the next most probable; "" for none."""
    found = [diagnosis for diagnosis in result.diagnoses if diagnosis.explanations]
    mistakes = [d.explanations for d in found if d.explanations[0].complexity > 0]
    return ", or ".join(each.name for each in mistakes[0][:2]) if mistakes else ""


def _explanation(result: CaseResult) -> str:
    """The most probable explanation in short; the diagnosis below states all of it."""
    if mistake := _mistake(result):
        return mistake
    if any(diagnosis.explanations for diagnosis in result.diagnoses):
        return "the equations are solved right; the mesh or the element is too coarse for this use"
    return next((str(diagnosis) for diagnosis in result.diagnoses if diagnosis.tested), "")


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
    first = max(shown, key=used_of) if shown else left[0]
    where = where_wrong(result, judged) or f"{first.name}, {first.message}"
    return f"{who}{len(left)} of {total} checks {words}; {where}"


def _caveat(result: CaseResult, far: Sequence[CheckResult]) -> str:
    """The gravest caveat that a reader must know."""
    if result.scope is Scope.SAME_MESH:
        return f"How far this mesh is from the continuum was not asked{_unasked(result)}."
    if result.scope is Scope.OWN:
        return "Nothing independent was compared with."
    if result.unseen:
        return f"Plainly wrong results would pass too: {', '.join(result.unseen)}."
    if fitted := result.evidence.get("fitted"):
        names = ", ".join(key_in_words(key) for key in fitted)
        return f"Fitted, so no evidence where it was fitted to: {names}."
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
        says=amount_of(check),
        is_beyond=value > _END,
    )


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
    """As "at its points displacement is off by about 18 % of what each moves, most where ...".

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
        amount = f"about {_rough(middle)}"
    else:
        amount = f"{_rough(low)} to {_rough(high)}"
    size, unit = result.units.of("length")
    position = ", ".join(f"{x / size:.3g}" for x in result.problem.mesh.points[worst])
    what = "point by point, displacement is off"
    if len(candidate) > 1:
        what += " at the worst moment"
    where = f"{_place(result, worst, moved)}, at ({position}) {unit}"
    return f"{what} by {amount} of how far each moves, most {where}"


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
