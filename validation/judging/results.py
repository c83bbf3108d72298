"""What judging a case gives: checks and a verdict. Plain data for every output."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.case.units import Units
from palpate.validation.metrics import CATALOGUE
from palpate.validation.quoting import for_terminal
from palpate.validation.references.bars import BarParts
from palpate.validation.states import Precision, State, Verdict, gravest

if TYPE_CHECKING:
    from palpate.validation.diagnosis import Diagnosis

# Relative: sums in another order.
_SUMS = 1e-9
_AGAINST = {"same_mesh": "same mesh", "candidate": "own"}
# What a check is against that goes by a measurement of the real body.
MEASUREMENT = "measurement"


class Scope(StrEnum):
    """How far a result reaches; the furthest of its checks.

    TRUTH: compared with the converged reference, a published number, or a measurement.
    SAME_MESH: against the reference on the same mesh only: it may be as far from the continuum as
        its mesh is coarse.
    OWN: against no reference: by itself, or by another simulator.
    """

    TRUTH = "truth"
    SAME_MESH = "same_mesh"
    OWN = "own"

    @property
    def caution(self) -> str:
        """What must be said beside "passed"; nothing of the truth."""
        return {
            Scope.TRUTH: "",
            Scope.SAME_MESH: "verified on the same mesh only: not compared with the truth",
            Scope.OWN: "compared with no reference",
        }[self]


@dataclass(frozen=True)
class CheckResult:
    """One check: how far off, how far off it may be, and why.

    Attributes:
        metric: Name of the metric.
        against: "same_mesh" (P1 on the same mesh), "truth" (P2), "candidate" (on its own),
            "measurement" (of the real body), "relation" (of two of its own results), "versus"
            (another candidate) or "self-test" (of the gate).
        strain: Which of the candidate's solutions was judged.
        verdict: The outcome.
        reason: Why this limit, from the case.
        message: One line that says what was found.
        value: The error (or the quantity, for "candidate") in `unit`; None if there is none.
        limit: What `value` may be at most (at least, for smallest_det_f and for a relation that
            must be broken).
        scale: What the error was divided by, in words.
        unit: "-" or a unit.
        reference_error: The reference's own error bar, in the units of `value`.
        bar_parts: What that bar is made of, by name, in its units; `geometry` stands beside the
            whole but where the truth is compared with a published number: see `BarParts`.
        is_vacuous: Whether a result in which nothing moves passes it too.
        precision: What the limit allows for: single where the case or the caller granted it.
        element: What the tetrahedra of the judged result are; linear where it is the truth that
            is compared with a number.
    """

    metric: str
    against: str
    strain: Strain
    verdict: Verdict
    reason: str
    message: str
    value: float | None = None
    limit: float = 0.0
    scale: str = "-"
    unit: str = "-"
    reference_error: float = 0.0
    bar_parts: Mapping[str, float] = field(default_factory=dict)
    is_vacuous: bool = False
    precision: Precision = Precision.DOUBLE
    element: Element = Element.LINEAR

    @property
    def scope(self) -> Scope:
        """How far it reaches; one of the truth's own number says nothing of the candidate."""
        if self.against == MEASUREMENT:
            return Scope.TRUTH
        metric = CATALOGUE.get(self.metric)
        if metric is not None and metric.is_published:
            return Scope.TRUTH if self.against == "candidate" else Scope.OWN
        return Scope(self.against) if self.against in list(Scope) else Scope.OWN

    @property
    def name(self) -> str:
        """Metric, compared with what, strain, element and precision; only what is not usual."""
        precision = "" if self.precision is Precision.DOUBLE else f"{self.precision} precision"
        return check_name(self.metric, self.against, str(self.strain), str(self.element), precision)

    @property
    def is_of_truth_alone(self) -> bool:
        """Whether the truth itself is compared with a number, whoever the candidate is."""
        return self.against == "truth" and CATALOGUE[self.metric].is_published

    @property
    def bar_says(self) -> str:
        """The parts of the bar in words, where there are several, and what stands beside it."""
        return self.bar_in_words()

    def bar_in_words(self, times: float = 1.0, unit: str = "") -> str:
        """The same with its numbers so many `times` and followed by a unit."""
        parts = BarParts(**self.bar_parts)
        everything = parts.whole + parts.geometry
        counts = math.isclose(everything, self.reference_error, rel_tol=_SUMS)
        words = [parts.says(with_geometry=counts, times=times, unit=unit)]
        if parts.geometry and not counts:
            words.append(f"beside it: geometry {times * parts.geometry:.2g}{unit}")
        return "; ".join(filter(None, words))


@dataclass(frozen=True, eq=False)
class MeasuredValues:
    """What a candidate says to a measurement, beside it, in one unit of the case.

    Attributes:
        name: Of the measurement.
        candidate: Who computed.
        unit: Of the values.
        labels: Of each value.
        measured: Shape (n,).
        computed: Shape (n,).
        doubt: Two u_val of each, shape (n,).
        positions: Of the markers at rest, shape (n / 3, 3); empty of what is not of markers.
    """

    name: str
    candidate: str
    unit: str
    labels: tuple[str, ...]
    measured: Floats
    computed: Floats
    doubt: Floats
    positions: Points


@dataclass(frozen=True)
class Judged:
    """A judged candidate, and the gravest of the checks of its results.

    Attributes:
        name: The label of its states.
        verdict: Verdict of all its checks.
        element: What its tetrahedra are.
    """

    name: str
    verdict: Verdict
    element: Element = Element.LINEAR


@dataclass(frozen=True, eq=False)
class CaseResult:
    """A case, judged.

    Attributes:
        name: The case's name.
        title: Title of the case.
        verdict: The gravest of its checks.
        checks: The checks, in the order of the case file, candidate by candidate.
        problem: Mesh, material, supports and loads.
        states: Every solution that was made or read.
        metrics: Named numbers, SI units.
        provenance: Versions, hashes, machine, command.
        notes: Lines a reader must know (what meshed it, where the reference comes from).
        not_judged: Why there is no check at all: an input that cannot be used; else empty.
        published: Numbers of a paper with their source, from the case file.
        error_fields: Error at the points, by name [m], shape (num_points,).
        candidates: The candidates that were judged, with their verdicts.
        case_text: The case file as it was read.
        evidence: What the case says for a credibility file: question, context of use...
        candidate_says: What an outside candidate says of itself: its words, which nobody checked.
        unseen: Plainly wrong results that no check of the case turns red, by name.
        diagnoses: What would explain each result that a check failed.
        measured: What each candidate says to what was measured of the real body.
        units: Those of the case, in which everything is shown.
    """

    name: str
    title: str
    verdict: Verdict
    checks: tuple[CheckResult, ...]
    problem: Problem
    candidates: tuple[Judged, ...]
    states: tuple[State, ...] = ()
    metrics: Mapping[str, float | None] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    not_judged: str = ""
    published: Mapping[str, Any] = field(default_factory=dict)
    error_fields: Mapping[str, Points] = field(default_factory=dict)
    case_text: str = ""
    evidence: Mapping[str, Any] = field(default_factory=dict)
    candidate_says: Mapping[str, Any] = field(default_factory=dict)
    unseen: tuple[str, ...] = ()
    diagnoses: tuple[Diagnosis, ...] = ()
    measured: tuple[MeasuredValues, ...] = ()
    units: Units = field(default_factory=Units)

    def __str__(self) -> str:
        """The verdict, what did not pass, and the notes, a line each."""
        bad = [check for check in self.checks if check.verdict is not Verdict.PASSED]
        lines = [f"{c.verdict}: {c.name}: {c.message} ({c.reason})" for c in bad]
        lines = [f"  {line}" for line in (*lines, *self.notes)]
        return "\n".join(for_terminal(line) for line in [f"{self.name}: {self.verdict}", *lines])

    __repr__ = __str__  # its arrays would fill a notebook

    @property
    def candidate(self) -> str:
        """The names of the judged candidates, for people."""
        return " and ".join(judged.name for judged in self.candidates)

    @property
    def scope(self) -> Scope:
        """The references that the candidate was compared with; skipped checks do not count."""
        reached = {check.scope for check in self.checks if check.verdict is not Verdict.SKIPPED}
        return next((scope for scope in Scope if scope in reached), Scope.OWN)

    @property
    def tone(self) -> str:
        """The name of the colour that the verdict is shown in, everywhere: its own, or "narrow".

        Green is reserved for what was compared with the truth; what passed without is narrow.
        """
        is_narrow = self.verdict is Verdict.PASSED and self.scope is not Scope.TRUTH
        return "narrow" if is_narrow else str(self.verdict)

    def state(self, label: str, strain: Strain) -> State | None:
        """The state with this label and strain, if there is one."""
        for state in self.states:
            if state.label == label and state.strain is strain:
                return state
        return None


def tone_of(results: Sequence[CaseResult]) -> str:
    """The name of the colour of several cases' verdict; green where all of them are green."""
    verdict = gravest([result.verdict for result in results])
    is_narrow = verdict is Verdict.PASSED and any(result.tone == "narrow" for result in results)
    return "narrow" if is_narrow else str(verdict)


def check_name(metric: str, against: str, strain: str, element: str, precision: str = "") -> str:
    """The name of a check from plain words, as a results.json has them."""
    own = [] if element == Element.LINEAR else [element]
    if against in ("relation", "self-test"):
        return ", ".join([metric, *own])
    words = [_AGAINST.get(against, against), strain, *own, *([precision] if precision else [])]
    return f"{metric} ({', '.join(words)})"


def error_name(against: str, strain: Strain, element: Element, metric: str) -> str:
    """The name of an error among the metrics of a result."""
    which = f"{strain}" if element is Element.LINEAR else f"{strain}.{element}"
    return f"error.{against}.{which}.{metric}"


def merge_candidates(results: Sequence[CaseResult]) -> CaseResult:
    """One result of several candidates' on the same case; the gravest verdict is its own.

    What is said of the references, and checked of the truth itself, stands there once.
    """
    first, *others = results
    if not others:
        return first
    states = {(s.label, s.strain): s for r in results for s in r.states if not s.is_reference}
    states |= {(s.label, s.strain): s for r in results for s in r.states if s.is_reference}
    more = [check for other in others for check in other.checks if not check.is_of_truth_alone]
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
        measured=tuple(values for result in results for values in result.measured),
    )
