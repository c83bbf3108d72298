"""From numbers to a verdict; fail-closed: what cannot be judged never passes."""

from __future__ import annotations

import dataclasses
import math

from palpate.meshes.problem import Problem, Strain
from palpate.validation.case.regions import part_of_check
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.judging.published import compare_published
from palpate.validation.judging.results import CheckResult
from palpate.validation.metrics import OWN_MESH_REMEDY, measure
from palpate.validation.references.bars import BarParts
from palpate.validation.states import Precision, State, Verdict


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


def _number(value: float) -> float | None:
    """What outputs can hold: None where there is no number."""
    return value if math.isfinite(value) else None


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
            the truth is held against, that of `metric_of_bar`.
        failure: Why a state is missing.
        units: The case's, of published numbers; SI where None.
        parts: What the bar is made of; all discretisation where None.
        shape: The case's curved shape, in words, where its mesh is a polyhedron of it.
    """
    made_of = parts or BarParts(discretisation=bar)
    value: float | None = None
    about, is_of_truth = spec.about, spec.is_of_truth_alone
    judged = reference if is_of_truth else candidate
    scale = about.scale if is_of_truth else "-"
    if judged is None and not is_of_truth:
        verdict, message = Verdict.FAILED, failure or "the candidate gave no answer"
    elif judged is None:
        verdict, message = Verdict.INCONCLUSIVE, failure or "there is no reference"
    elif about.is_published:
        compared = compare_published(spec, problem, judged, units)
        value, scale = _number(compared.error), about.scale
        made_of = made_of.times(compared.scale) if is_of_truth else BarParts()
        made_of = dataclasses.replace(
            made_of, reading=compared.uncertainty - compared.stated, stated=compared.stated
        )
        # The number is of the true body.
        bar = made_of.whole + made_of.geometry
        verdict = decide(compared.error, bar, spec.limit)
        message = "reference " if is_of_truth else ""
        message += compared.message + _shown(bar, made_of.says(with_geometry=True))
    elif about.own is not None:
        worst, made_of = about.own(problem.mesh, judged), BarParts()
        value, scale, bar = _number(worst.value), about.scale, 0.0
        is_within = worst.value > spec.limit if about.is_lower_limit else worst.value <= spec.limit
        is_good = is_within and math.isfinite(worst.value)
        verdict = Verdict.PASSED if is_good else Verdict.FAILED
        sign = ">" if is_good else "not >"
        message = about.says.format(worst, sign=sign, limit=spec.limit)
    elif reference is None:
        verdict, message = Verdict.INCONCLUSIVE, failure or "there is no reference"
    else:
        part = part_of_check(spec, problem, units or Units(), f"check {spec.metric}")
        difference = measure(spec.metric, problem, judged, reference, part)
        made_of = dataclasses.replace(made_of, reading=difference.uncertainty)
        scale, bar = difference.scale_name, bar + difference.uncertainty
        verdict = decide(difference.value, bar, spec.limit)
        value = _number(difference.value)
        sign = {Verdict.PASSED: "<=", Verdict.FAILED: ">"}.get(verdict, "~")
        shown = f"{difference.value:.3g}{_shown(bar, made_of.says())}"
        message = f"{shown} {sign} {spec.limit:g}"
        if part is not None:
            message += f", {part.says}"
        message += f"; {difference.remark}" if difference.remark else ""
        if verdict is Verdict.INCONCLUSIVE and judged.own and difference.uncertainty > 0.0:
            message += f"; {OWN_MESH_REMEDY}"
    if made_of.geometry and value is not None:
        message += f"; {_of_polyhedron(shape, made_of.geometry, counts=is_of_truth)}"
    return dataclasses.replace(
        _result(spec, strain, verdict, message),
        value=value,
        scale=scale,
        reference_error=bar,
        bar_parts=made_of.told(with_geometry=True),
    )


def _shown(bar: float, parts: str) -> str:
    """An error bar behind its number, with its parts where there are several."""
    return f" (+- {bar:.2g}{': ' if parts else ''}{parts})" if bar else ""


def _of_polyhedron(shape: str, geometry: float, *, counts: bool) -> str:
    """What the case's mesh leaves out of the true surface, in words."""
    of_what = f"a polyhedron of {shape}" if shape else "a polyhedron"
    rest = "" if counts else ", beside the bar"
    return f"the case's mesh is {of_what}: its geometry adds up to {geometry:.2g}{rest}"


def skipped_check(spec: CheckSpec, strain: Strain, why: str) -> CheckResult:
    """A check that was not made, with the reason: it stands in every output."""
    return _result(spec, strain, Verdict.SKIPPED, why)


def _result(spec: CheckSpec, strain: Strain, verdict: Verdict, message: str) -> CheckResult:
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
