"""The checks of a case at the precision that is granted.

Limits of single precision hold where the case or the gate's caller grants it: what a simulator
says of itself loosens nothing.
"""

from __future__ import annotations

from dataclasses import replace

from palpate.validation.case import Case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import metric_of_bar, number_of, part_of
from palpate.validation.judging.results import CheckResult
from palpate.validation.metrics.rounding import LARGEST, SinglePrecision
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import Precision, State, Verdict


class PrecisionGrant:
    """The checks of a case at the precision that is granted, and what single precision would do.

    Args:
        case: The case; its `precision`, or that of a check, grants single precision.
        references: The reference solutions of the case.
        granted: Precision that the caller grants every check that compares; None: as in the case.
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
        """A line on who granted single precision; empty where all is double."""
        if self._granted is Precision.SINGLE:
            return ["Single precision is granted by the caller of the gate."]
        if any(self._tier(spec) is Precision.SINGLE for spec in self._case.checks):
            return ["Single precision is granted by the case."]
        return []

    def checks(self) -> tuple[CheckSpec, ...]:
        """The case's checks; where single is granted no limit is below what rounding does."""
        return tuple(self._at_tier(spec) for spec in self._case.checks)

    def with_remark(self, spec: CheckSpec, found: CheckResult) -> CheckResult:
        """The check, which says so where a result fails by rounding to single and no more."""
        if found.verdict is not Verdict.FAILED or found.precision is Precision.SINGLE:
            return found
        base, value = self._base(spec), found.value
        if base is None or value is None or not _can_be_rounded(spec):
            return found
        if value > LARGEST * self._scale(spec, base) or value > (limit := self._limit(spec, base)):
            return found
        return replace(
            found,
            message=f"{found.message}; agrees to single precision (at most {limit:.2g}): grant it "
            'with --precision single, or precision = "single" in the case, if that is enough',
        )

    def _tier(self, spec: CheckSpec) -> Precision:
        if not _can_be_rounded(spec):
            return Precision.DOUBLE
        return self._granted or spec.precision or self._case.spec.precision

    def _at_tier(self, spec: CheckSpec) -> CheckSpec:
        tier, base = self._tier(spec), self._base(spec)
        changes: dict[str, object] = {"precision": tier}
        if tier is Precision.SINGLE and base is not None:
            limit = self._limit(spec, base)
            if limit > spec.limit:
                source = self._single.explain(base)
                changes["limit"] = limit
                changes["reason"] = f"{spec.reason}; in single precision: {source}"
        return spec.model_copy(update=changes)

    def _base(self, spec: CheckSpec) -> State | None:
        """The state that is rounded: the reference on the same mesh, for every check."""
        return self._references.same_mesh(spec.strain or self._case.strain)

    def _limit(self, spec: CheckSpec, base: State) -> float:
        problem, units, about = self._case.problem, self._case.spec.units, spec.about
        if about.read is not None and not about.needs_tools:
            expected = abs(spec.expected or 0.0) * units.of(about.dimension)[0]
            return self._single.limit_of_number(
                lambda state: number_of(spec, problem, state, units), base, expected
            )
        metric = spec.metric if about.is_fitted else metric_of_bar(spec)
        part = part_of(spec, problem, units)
        return self._single.limit(metric, base, part) * self._scale(spec, base)

    def _scale(self, spec: CheckSpec, base: State) -> float:
        """For a published displacement, the largest one over the number expected at a point.

        The same holds for the force on a tool.
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
