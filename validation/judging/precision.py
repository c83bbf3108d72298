"""Limits for answers in single precision, where the case or the gate's caller grants it.

What a simulator says of itself loosens nothing.
"""

from __future__ import annotations

import dataclasses

from palpate.validation.case import Case
from palpate.validation.case.regions import part_of_check
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.published import metric_of_bar, number_of
from palpate.validation.judging.results import CheckResult
from palpate.validation.metrics.rounding import LARGEST, SinglePrecision
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import Precision, State, Verdict


class PrecisionGrant:
    """The checks of a case at the precision that is granted, and what single precision would do.

    Args:
        case: Whose `precision`, or that of a check, grants single.
        references: Of the case.
        granted: By the caller, for every check that compares; None leaves it to the case.
    """

    def __init__(
        self, case: Case, references: ReferenceSet, granted: Precision | None = None
    ) -> None:
        self._case = case
        self._references = references
        self._granted = granted
        self._single = SinglePrecision(case.problem)

    @property
    def notes(self) -> list[str]:
        """Who granted what; empty where everything is double."""
        if self._granted is Precision.SINGLE:
            return ["Single precision is granted by the caller of the gate."]
        if any(self._tier(spec) is Precision.SINGLE for spec in self._case.checks):
            return ["Single precision is granted by the case."]
        return []

    def checks(self) -> tuple[CheckSpec, ...]:
        """The case's checks; where single is granted no limit is below what rounding does."""
        return tuple(self._at_tier(spec) for spec in self._case.checks)

    def with_remark(self, spec: CheckSpec, found: CheckResult) -> CheckResult:
        """The check, which says so where an answer fails by rounding to single and no more."""
        value = found.value
        if found.verdict is not Verdict.FAILED or found.precision is Precision.SINGLE:
            return found
        if not _can_be_rounded(spec) or value is None or value > self._ceiling(spec):
            return found
        limit = self._limit(spec)
        if limit is None or value > limit:
            return found
        return dataclasses.replace(
            found,
            message=f"{found.message}; agrees to single precision (at most {limit:.2g}): grant it "
            'with --precision single, or precision = "single" in the case, if that is enough',
        )

    def _tier(self, spec: CheckSpec) -> Precision:
        if not _can_be_rounded(spec):
            return Precision.DOUBLE
        return self._granted or spec.precision or self._case.spec.precision

    def _at_tier(self, spec: CheckSpec) -> CheckSpec:
        tier = self._tier(spec)
        limit = self._limit(spec) if tier is Precision.SINGLE else None
        changes: dict[str, object] = {"precision": tier}
        if limit is not None and limit > spec.limit:
            base = self._base(spec)
            assert base is not None
            changes["limit"] = limit
            changes["reason"] = f"{spec.reason}; in single precision: {self._single.explain(base)}"
        return spec.model_copy(update=changes)

    def _base(self, spec: CheckSpec) -> State | None:
        """What is rounded: the reference on the same mesh, whatever the check is against."""
        return self._references.same_mesh(spec.strain or self._case.strain)

    def _limit(self, spec: CheckSpec) -> float | None:
        base = self._base(spec)
        if base is None:
            return None
        metric = spec.metric if spec.about.is_fitted else metric_of_bar(spec)
        problem, units = self._case.problem, self._case.spec.units
        if spec.about.read is not None and not spec.about.needs_tools:
            unit, _ = units.of(spec.about.dimension)
            expected = abs(spec.expected or 0.0) * unit
            return self._single.limit_of_number(
                lambda state: number_of(spec, problem, state, units), base, expected
            )
        part = part_of_check(spec, problem, units, f"check {spec.metric}")
        return self._single.limit(metric, base, part) * self._scale(spec, base)

    def _ceiling(self, spec: CheckSpec) -> float:
        base = self._base(spec)
        return LARGEST * (self._scale(spec, base) if base else 1.0)

    def _scale(self, spec: CheckSpec, base: State) -> float:
        """Of a published displacement, the largest one over the number expected at a point.

        Of the force on a tool likewise.
        """
        about, units = spec.about, self._case.spec.units
        if not about.is_published or about.is_fitted or (about.read and not about.needs_tools):
            return 1.0
        expected = abs(spec.expected or 0.0) * units.of(about.dimension)[0]
        if about.read is None:
            return base.max_displacement / expected
        found = number_of(spec, self._case.problem, base, units)
        return 1.0 if found is None or found.scale is None else found.scale / expected


def _can_be_rounded(spec: CheckSpec) -> bool:
    """Whether a check compares numbers of the candidate, not the truth's own or a count."""
    return not (spec.about.is_own or spec.is_of_truth_alone)
