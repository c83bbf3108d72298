"""From numbers to a verdict; fail-closed: what cannot be judged never passes.

A check compares a result with a reference, with itself, or one of its numbers with one of the
case file that was published or is in closed form. `CaseJudge` finds the reference and error bar
that each check of a case needs, for any result, wrong ones included.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.candidates.equations import AskedSteps, differences, in_words
from palpate.validation.case import Case
from palpate.validation.case.regions import part_of_check, point_at
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.judging.results import CheckResult
from palpate.validation.judging.wrong_results import null_result, wrong_results
from palpate.validation.metrics import OWN_MESH_REMEDY, Number, Part, is_still, measure
from palpate.validation.metrics.difference import are_measurable
from palpate.validation.metrics.motion import may_be_alias, too_coarse
from palpate.validation.metrics.time_series import fit_oscillation, fit_uncertainty
from palpate.validation.references.adaptive_truth import ADAPTIVE, why_without_limit
from palpate.validation.references.bars import BarParts, name_of_part
from palpate.validation.references.branches import EXPLAINED, load_over_critical, mirror_images
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import Precision, State, Verdict

# The name of the check that a result is of the equations that were asked for.
STATED = "stated_equations"
_LENGTHS = ("amplitude", "mean")
_WHOLE = Part(np.zeros(0, dtype=np.int32), np.zeros((0, 3)))


def decide(error: float, bar: float, limit: float) -> Verdict:
    """Passed when error + bar <= limit, failed when error - bar > limit, else inconclusive.

    A worse reference never makes passing easier. A bar that is not finite, or below 0, is no bar:
    inconclusive. An error that is not finite, or below 0, is no error: the candidate's failure.
    """
    if not 0.0 <= error < math.inf:
        return Verdict.FAILED
    if not 0.0 <= bar < math.inf:
        return Verdict.INCONCLUSIVE
    if error + bar <= limit:
        return Verdict.PASSED
    return Verdict.FAILED if error - bar > limit else Verdict.INCONCLUSIVE


def judge_check(
    spec: CheckSpec,
    strain: Strain,
    problem: Problem,
    candidate: State | None,
    reference: State | None,
    bar: float,
    failure: str,
    units: Units | None = None,
    *,
    parts: BarParts | None = None,
    shape: str = "",
) -> CheckResult:
    """Judge one check.

    Args:
        spec: Metric, limit and reason.
        strain: Which solution is judged.
        problem: The case's problem.
        candidate: The candidate's state, or None with `failure` saying why.
        reference: The reference's, or None if there is none.
        bar: The reference's error bar, relative to the check's scale; of a published number that
            the truth is compared with, that of `metric_of_bar`.
        failure: Why a state is missing.
        units: The case's, of published numbers; SI where None.
        parts: What the bar is made of; all discretisation where None.
        shape: The case's curved shape, in words, where its mesh is a polyhedron of it.
    """
    about, is_of_truth = spec.about, spec.is_of_truth_alone
    judged = reference if is_of_truth else candidate
    made_of = parts or BarParts(discretisation=bar)
    if judged is None or (reference is None and about.is_compared):
        verdict, why = Verdict.INCONCLUSIVE, failure or "there is no reference"
        if candidate is None and not is_of_truth:
            verdict, why = Verdict.FAILED, failure or "the candidate gave no result"
        scale = about.scale if is_of_truth else "-"
        missing = unjudged_check(spec, strain, verdict, why)
        shown = made_of.reported(with_geometry=True)
        return dataclasses.replace(missing, scale=scale, reference_error=bar, bar_parts=shown)
    if about.own is not None:
        return _of_candidate_alone(spec, strain, problem, judged)
    scale = about.scale
    if about.is_published:
        compared = compare_published(spec, problem, judged, units)
        error = compared.error
        made_of = made_of.times(compared.scale) if is_of_truth else BarParts()
        made_of = dataclasses.replace(
            made_of, reading=compared.uncertainty - compared.stated, stated=compared.stated
        )
        # The number is of the true body.
        bar = made_of.whole + made_of.geometry
        verdict = decide(error, bar, spec.limit)
        message = "reference " if is_of_truth else ""
        message += compared.message + _shown(bar, made_of.says(with_geometry=True))
    else:
        assert reference is not None
        part = part_of(spec, problem, units or Units())
        difference = measure(spec.metric, problem, judged, reference, part)
        error, scale = difference.value, difference.scale_name
        made_of = dataclasses.replace(made_of, reading=difference.uncertainty)
        bar += difference.uncertainty
        verdict = decide(error, bar, spec.limit)
        sign = {Verdict.PASSED: "<=", Verdict.FAILED: ">"}.get(verdict, "~")
        message = f"{error:.3g}{_shown(bar, made_of.says())}"
        if spec.limit < math.inf:  # else it is reported, and decides nothing
            message += f" {sign} {spec.limit:g}"
        if part is not None:
            message += f", {part.says}"
        if verdict is Verdict.FAILED and about.where is not None:
            left = about.where(problem, judged, reference)
            message += f"; {left}" if left else ""
        message += f"; {difference.remark}" if difference.remark else ""
        if verdict is Verdict.INCONCLUSIVE and judged.own and difference.uncertainty > 0.0:
            message += f"; {OWN_MESH_REMEDY}"
    value = error if math.isfinite(error) else None
    if made_of.geometry and value is not None:
        of_what = f"a polyhedron of {shape}" if shape else "a polyhedron"
        beside = "" if is_of_truth else ", beside the bar"
        message += f"; the case's mesh is {of_what}: its geometry adds up to "
        message += f"{made_of.geometry:.2g}{beside}"
    return dataclasses.replace(
        unjudged_check(spec, strain, verdict, message),
        value=value,
        scale=scale,
        reference_error=bar,
        bar_parts=made_of.reported(with_geometry=True),
    )


def _of_candidate_alone(
    spec: CheckSpec, strain: Strain, problem: Problem, candidate: State
) -> CheckResult:
    """A check that needs no reference: its error bar is what reading the result may be off by."""
    about = spec.about
    assert about.own is not None
    worst = about.own(problem, candidate)
    verdict = decide(worst.value, worst.doubt, spec.limit)
    if about.is_lower_limit:
        is_good = worst.value > spec.limit and math.isfinite(worst.value)
        verdict = Verdict.PASSED if is_good else Verdict.FAILED
    above, below = (">", "not >") if about.is_lower_limit else ("<=", ">")
    sign = {Verdict.PASSED: above, Verdict.FAILED: below}.get(verdict, "~")
    bar = _shown(worst.doubt, "")
    message = about.says.format(worst, sign=sign, limit=spec.limit, bar=bar)
    value = worst.value if math.isfinite(worst.value) else None
    found = unjudged_check(spec, strain, verdict, message)
    parts = BarParts(reading=worst.doubt).reported(with_geometry=False)
    return dataclasses.replace(
        found, value=value, scale=about.scale, reference_error=worst.doubt, bar_parts=parts
    )


def unjudged_check(spec: CheckSpec, strain: Strain, verdict: Verdict, message: str) -> CheckResult:
    """A check without numbers: one that was skipped, say, with the reason."""
    return CheckResult(
        metric=spec.metric,
        against=spec.against,
        strain=strain,
        verdict=verdict,
        reason=spec.reason,
        message=message,
        limit=spec.limit,
        unit=spec.about.unit,
        precision=spec.precision or Precision.DOUBLE,
    )


def check_statements(
    case: Case,
    state: State,
    element: Element,
    asked: AskedSteps,
    checks: Sequence[CheckSpec],
) -> list[CheckResult]:
    """A failed check where a result states other equations than were asked for; else none.

    Args:
        case: The case.
        state: The result.
        element: The element that is asked for.
        asked: The scheme and step that are asked for.
        checks: Those of the case, at the precision that is granted.
    """
    is_single = any(spec.precision is Precision.SINGLE for spec in checks)
    found = differences(
        case.problem,
        state,
        element=element,
        steps=asked,
        is_stepped=has_same_mesh_check(case, state.strain),
        precision=Precision.SINGLE if is_single else Precision.DOUBLE,
    )
    if not found:
        return []
    return [
        CheckResult(
            metric=STATED,
            against="candidate",
            strain=state.strain,
            verdict=Verdict.FAILED,
            reason="a result is judged by the equations that were asked for, not by its own",
            message=in_words(found),
            element=element,
        )
    ]


def has_same_mesh_check(case: Case, strain: Strain) -> bool:
    """Whether a check of the case is about the same mesh, and so about its time steps."""
    return any(
        spec.against == "same_mesh" and (spec.strain or case.strain) is strain
        for spec in case.checks
    )


def _shown(bar: float, parts: str) -> str:
    """An error bar behind its number, with its parts where there are several."""
    return f" (+- {bar:.2g}{': ' if parts else ''}{parts})" if bar else ""


def metric_of_bar(spec: CheckSpec) -> str:
    """Which metric's error bar says how far the truth's number may be off."""
    if spec.quantity is not None:
        return f"oscillation_{spec.quantity}"
    return spec.about.bar_of or spec.metric


def part_of(spec: CheckSpec, problem: Problem, units: Units) -> Part | None:
    """The part of the body that a check is about; None where it is about all of it."""
    return part_of_check(spec, problem, units, f"check {spec.metric}")


def name_of_bar(spec: CheckSpec, problem: Problem, units: Units) -> str:
    """The same for the part of the body that the check is about."""
    part = part_of(spec, problem, units)
    metric = metric_of_bar(spec)
    if part is None or not spec.about.is_of_integrals:
        return metric
    return name_of_part(metric, part)


def number_of(spec: CheckSpec, problem: Problem, state: State, units: Units) -> Number | None:
    """The number of a state that a check is about, in SI units; None where it does not have it."""
    part = part_of(spec, problem, units)
    assert spec.about.read is not None
    with np.errstate(over="ignore", invalid="ignore"):
        return spec.about.read(problem, state, part or _WHOLE, spec.component or "")


@dataclass(frozen=True)
class Comparison:
    """One number of a result beside the number expected.

    Attributes:
        error: Relative to the number expected [-]; infinite where there is none to be had.
        message: One line on it.
        scale: What errors of `metric_of_bar` are divided by, over the number expected [-].
        uncertainty: Of the expected number, as the case states it, and of what was fitted or read
            between states, relative to the number expected [-]; infinite where the states tell
            nothing of it.
        stated: The part of `uncertainty` that the case states, also relative [-].
    """

    error: float
    message: str
    scale: float = math.inf
    uncertainty: float = 0.0
    stated: float = 0.0


def compare_published(
    spec: CheckSpec, problem: Problem, state: State, units: Units | None
) -> Comparison:
    """Compare a number of a state with the one expected.

    For an oscillation: what is fitted to a point's component over time.

    Raises:
        InputError: No point of the mesh lies there, or no such part of the body.
    """
    used = units or Units()
    if spec.about.read is not None:
        return _compare_number(spec, problem, state, used)
    assert spec.component is not None
    assert spec.at is not None
    point = point_at(problem.mesh, spec.at, used, "check")
    axis = "xyz".index(spec.component)
    metre = used.metres(1.0)
    if spec.quantity is None:
        found = float(state.displacement[point, axis]) / metre
        other = state.other_reading
        off = 0.0 if other is None else abs(found - float(other.displacement[point, axis]) / metre)
        # No component at a point is farther off than the largest error of displacement.
        return _compare(spec, found, used.length, state.max_displacement / metre, off)
    motion = state.given
    try:
        if motion is None:
            raise InputError("there is no trajectory")
        series = motion.times, motion.displacements[:, point, axis]
        swing = fit_oscillation(*series)
    except InputError as why:
        return Comparison(math.inf, f"no {spec.quantity} to be had: {why}")
    found = float(getattr(swing, spec.quantity))
    # Also of a truth: its bars are of two fits alike, not of what one fit makes of a motion.
    off = float(getattr(fit_uncertainty(*series, swing), spec.quantity))
    is_frequency = spec.quantity == "frequency"
    wanted = abs(spec.expected or 0.0) if is_frequency else swing.frequency
    why_not = too_coarse(motion, wanted)
    scale = swing.amplitude / metre if spec.quantity in _LENGTHS else swing.frequency
    unit = used.length if spec.quantity in _LENGTHS else "Hz" if is_frequency else "1/s"
    found = found / metre if spec.quantity in _LENGTHS else found
    compared = _compare(spec, found, unit, scale, off * scale)
    if not why_not and compared.error <= spec.limit:
        # What is wrong at any frequency is wrong; what is right may be an alias's.
        why_not = may_be_alias(problem, state.strain, motion, element=state.element)
    if not why_not:
        return compared
    message = f"{compared.message}; {why_not}"
    return dataclasses.replace(compared, message=message, uncertainty=math.inf)


def _compare_number(spec: CheckSpec, problem: Problem, state: State, units: Units) -> Comparison:
    if not are_measurable(*state.fields):
        return Comparison(math.inf, "the displacement is no number, or too large for one")
    found = number_of(spec, problem, state, units)
    if found is None:
        return Comparison(math.inf, f"{state.label} does not have it")
    unit, name = units.of(spec.about.dimension)
    scale = found.scale / unit
    off = found.doubt
    if state.other_reading is not None:
        other = number_of(spec, problem, state.other_reading, units)
        off += math.inf if other is None else abs(found.value - other.value)
    compared = _compare(spec, found.value / unit, name, scale, off / unit)
    part = part_of(spec, problem, units)
    if part is None:
        return compared
    where = f"{spec.component}, {part.says}"
    return dataclasses.replace(compared, message=f"{compared.message}; {where}")


def _compare(
    spec: CheckSpec, found: float, unit: str, scale: float, uncertainty: float
) -> Comparison:
    """The scale is that of the metric's bar; it and the uncertainty are in the unit."""
    assert spec.expected is not None
    size = abs(spec.expected)
    error = abs(found - spec.expected) / size
    # The uncertainty of a measured or published number counts like that of the result itself.
    stated = spec.uncertainty or 0.0
    expected = f"{spec.expected:.8g}" + (f" +- {stated:.3g}" if stated else "")
    shown = f"{found:.8g} {unit}, expected {expected}: {error:.2g}"
    message = f"{shown} {'<=' if error <= spec.limit else '>'} {spec.limit:g}"
    return Comparison(error, message, scale / size, (uncertainty + stated) / size, stated / size)


@dataclass(frozen=True, eq=False)
class CaseJudge:
    """What a result of a case is judged against.

    Attributes:
        case: The case.
        references: The reference solutions of the case.
        granted: Its checks at the precision that was granted; as they stand in it where None.
    """

    case: Case
    references: ReferenceSet
    granted: tuple[CheckSpec, ...] | None = None
    _images: dict[State, tuple[State, ...]] = field(default_factory=dict, init=False)
    _bars_of_integrals: dict[CheckSpec, BarParts] = field(default_factory=dict, init=False)

    @property
    def checks(self) -> tuple[CheckSpec, ...]:
        """Every check, in the order of the case."""
        return tuple(self.case.checks) if self.granted is None else self.granted

    @property
    def problem(self) -> Problem:
        """The case's problem."""
        return self.case.problem

    def strain_of(self, spec: CheckSpec) -> Strain:
        """Which of the candidate's results a check is about."""
        return spec.strain or self.case.strain

    def check(self, spec: CheckSpec, candidate: State | None, failure: str = "") -> CheckResult:
        """Judge one check of a result; `failure` says why there is none."""
        parts = self._bar_parts(spec)
        found = judge_check(
            spec,
            self.strain_of(spec),
            self.problem,
            candidate,
            self._reference(spec),
            parts.whole,
            failure or self._why_missing(spec),
            self.case.spec.units,
            parts=parts,
            shape=self._shape() if parts.geometry else "",
        )
        why = self._why_no_bar(spec)
        if why and found.verdict is Verdict.INCONCLUSIVE and math.isinf(parts.whole):
            found = dataclasses.replace(found, message=f"{found.message}; {why}")
        found = self._beside_branches(spec, candidate, found)
        if spec.is_of_truth_alone:
            return found
        return dataclasses.replace(found, element=self.references.element)

    def _shape(self) -> str:
        """The true surface that the case's mesh is a polyhedron of, in words."""
        from palpate.validation.references.geometry import shape_of

        return shape_of(self.references)

    def is_vacuous(self, spec: CheckSpec) -> bool:
        """Whether the check says nothing of a candidate: the null result passes it too.

        So does every result where the reference itself does not move, and where the truth and not
        the candidate is compared with a published number.
        """
        reference, strain = self._reference(spec), self.strain_of(spec)
        if spec.is_of_truth_alone:
            return True
        if spec.against != "candidate" and reference and is_still(self.problem.mesh, reference):
            return True
        basis = reference or self._any_reference(strain)
        solution = null_result(self.problem, strain, basis)
        return self.check(spec, solution).verdict is Verdict.PASSED

    def unseen(self) -> tuple[str, ...]:
        """Plainly wrong results that no check of the case turns red, by name."""
        reference = self._any_reference(self.case.strain)
        if reference is None:
            return ()
        specs = [spec for spec in self.checks if self.strain_of(spec) is self.case.strain]
        return tuple(
            solution.label
            for solution in wrong_results(self.problem, reference)
            if not any(self.check(spec, solution).verdict is Verdict.FAILED for spec in specs)
        )

    def _reference(self, spec: CheckSpec) -> State | None:
        strain = self.strain_of(spec)
        if spec.against != "truth":
            return self.references.same_mesh(strain)
        if not spec.about.is_of_integrals:
            return self.references.truth(strain)
        truth = self.references.stress_truth(strain)
        is_known = truth and (spec.about.read is None or self._number(spec, truth))
        name = name_of_bar(spec, self.problem, self.case.spec.units)
        return truth if is_known and self.references.was_asked(strain, name) else None

    def _number(self, spec: CheckSpec, state: State) -> Number | None:
        return number_of(spec, self.problem, state, self.case.spec.units)

    def _bar_parts(self, spec: CheckSpec) -> BarParts:
        """The parts of the truth's error bar; the same for every result."""
        references, strain, problem = self.references, self.strain_of(spec), self.problem
        if spec.against != "truth":
            return BarParts()
        if not spec.about.is_of_integrals:
            return references.bar_parts(metric_of_bar(spec), strain)
        if spec not in self._bars_of_integrals:
            name = name_of_bar(spec, problem, self.case.spec.units)
            if spec.about.read is not None:
                read = partial(self._number, spec)
                bar = references.bar_of_number(problem, strain, spec.metric, name, read)
            else:
                part = part_of(spec, problem, self.case.spec.units)
                assert part is not None
                bar = references.bar_of_part(problem, strain, spec.metric, part)
            geometry = references.bar_parts(name, strain).geometry
            parts = BarParts(discretisation=bar, geometry=geometry)
            self._bars_of_integrals[spec] = parts
        return self._bars_of_integrals[spec]

    def _why_no_bar(self, spec: CheckSpec) -> str:
        """Why the truth's meshes leave a check without a bar; "" where nobody knows."""
        if spec.against != "truth":
            return ""
        strain, record = self.strain_of(spec), self._record(spec)
        return why_without_limit(record, self.problem, strain, metric_of_bar(spec))

    def _record(self, spec: CheckSpec) -> Any:
        """The record of the truth's meshes; None where there is none."""
        records = self.references.provenance.get(ADAPTIVE)
        strain = self.strain_of(spec)
        return records.get(strain.value) if isinstance(records, Mapping) else None

    def _beside_branches(
        self, spec: CheckSpec, candidate: State | None, found: CheckResult
    ) -> CheckResult:
        """The check, inconclusive where the reference's own mirror image explains why it failed.

        Only past the critical load that the reference found; whatever the candidate says of itself.
        """
        ratio = load_over_critical(self._record(spec))
        is_failed = found.verdict is Verdict.FAILED and found.value is not None
        reference = self._reference(spec)
        if not (is_failed and ratio > 1.0 and spec.about.is_compared and candidate and reference):
            return found
        if reference not in self._images:
            self._images[reference] = tuple(mirror_images(self.problem, reference))
        part = part_of(spec, self.problem, self.case.spec.units)
        errors = {
            image.label: measure(spec.metric, self.problem, candidate, image, part).value
            for image in self._images[reference]
        }
        nearest = min(errors, key=lambda label: errors[label], default="")
        assert found.value is not None
        if not nearest or not errors[nearest] <= EXPLAINED * found.value:
            return found
        message = (
            f"{found.message}; the load is {ratio:.3g} times the first critical one, so that the "
            f"reference is one of several equilibria: the result is {errors[nearest]:.2g} from its "
            f"{nearest}, which is as good; add a load or an imperfection that prefers one side"
        )
        return dataclasses.replace(found, verdict=Verdict.INCONCLUSIVE, message=message)

    def _why_missing(self, spec: CheckSpec) -> str:
        """Why there is no reference for a check; "" where there is, or nobody knows."""
        references, strain, called = self.references, self.strain_of(spec), self.case.called
        if spec.against == "truth" and references.truth(strain) is not None:
            if self._reference(spec) is not None:
                return references.failure(spec.against, strain)
            asked = "stresses" if spec.about.read is None else "stresses and energy"
            return (
                f"the stored truth of this case was not asked for {asked} in this part: build it "
                f"anew with `palpate reference build {called}` where FEniCSx is installed, then "
                f"`palpate reference accept {called} --reason TEXT`"
            )
        known = references.failure(spec.against, strain)
        is_there = spec.against != "same_mesh" or references.same_mesh(strain) is not None
        if known or is_there or references.element is Element.LINEAR:
            return known
        return (
            f"no reference of {references.element} tetrahedra is stored for this case: make it "
            f"with `palpate reference build {called}` where FEniCSx is installed, then "
            f"`palpate reference accept {called} --reason TEXT`"
        )

    def _any_reference(self, strain: Strain) -> State | None:
        return self.references.same_mesh(strain) or self.references.truth(strain)
