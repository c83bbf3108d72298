"""One case with its references: every check of it, for any result, wrong ones included.

A check that the null result passes says nothing about a candidate: a body that nobody pushes, a
limit of 1, a change of volume too small to matter. Each case is judged with the null result too,
and with results that are plainly wrong, so that what it cannot see is named.

Limits of single precision hold where the case or the gate's caller grants it: what a simulator
says of itself loosens nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.candidates.faults import Fault, corrupt_displacement
from palpate.validation.case import Case
from palpate.validation.case.regions import part_of_check
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.case_references import case_name
from palpate.validation.judging.checks import (
    judge_check,
    metric_of_bar,
    name_of_bar,
    number_of,
)
from palpate.validation.judging.results import CheckResult
from palpate.validation.metrics import Number, is_still, make_state
from palpate.validation.metrics.difference import measures_of
from palpate.validation.metrics.rounding import LARGEST, SinglePrecision
from palpate.validation.references.bars import BarParts
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import Precision, State, Trajectory, Verdict

_Change = Callable[[NDArray[np.float64]], NDArray[np.float64]]


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
        strain = self.strain_of(spec)
        is_truth = spec.against == "truth"
        if not is_truth:
            parts = BarParts()
        elif spec.about.is_of_integrals:
            name = name_of_bar(spec, self.problem, self.case.spec.units)
            beside = self.references.bar_parts(name, strain).geometry
            parts = BarParts(discretisation=self._bar_of_part(spec), geometry=beside)
        else:
            parts = self.references.bar_parts(metric_of_bar(spec), strain)
        found = judge_check(
            spec,
            strain,
            self.problem,
            candidate,
            self._reference(spec),
            parts.whole,
            failure or self._why_missing(spec),
            self.case.spec.units,
            parts=parts,
            shape=self._shape() if parts.geometry else "",
        )
        if spec.is_of_truth_alone:
            return found
        return replace(found, element=self.references.element)

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

    def _bar_of_part(self, spec: CheckSpec) -> float:
        """The truth's error bar in the part that a check names; the same for every result."""
        if spec.against != "truth":
            return 0.0
        if spec not in self._bars_of_parts:
            problem, units, strain = self.problem, self.case.spec.units, self.strain_of(spec)
            if spec.about.read is not None:
                read, name = partial(self._number, spec), name_of_bar(spec, problem, units)
                bar = self.references.bar_of_number(problem, strain, spec.metric, name, read)
            else:
                part = part_of_check(spec, problem, units, f"check {spec.metric}")
                assert part is not None
                bar = self.references.bar_of_part(problem, strain, spec.metric, part)
            self._bars_of_parts[spec] = bar
        return self._bars_of_parts[spec]

    @cached_property
    def _bars_of_parts(self) -> dict[CheckSpec, float]:
        return {}

    def _why_missing(self, spec: CheckSpec) -> str:
        """Why there is no reference for a check; "" where there is, or nobody knows."""
        references, strain = self.references, self.strain_of(spec)
        known = references.failure(spec.against, strain)
        is_truth = spec.against == "truth" and references.truth(strain) is not None
        if is_truth and self._reference(spec) is None:
            called = case_name(self.case)
            asked = "stresses" if spec.about.read is None else "stresses and energy"
            return (
                f"the stored truth of this case was not asked for {asked} in this part: build it "
                f"anew with `palpate reference build {called}` where FEniCSx is installed, then "
                f"`palpate reference accept {called} --reason TEXT`"
            )
        is_there = spec.against != "same_mesh" or references.same_mesh(strain) is not None
        if known or is_there or references.element is Element.LINEAR:
            return known
        called = case_name(self.case)
        return (
            f"no reference of {references.element} tetrahedra is stored for this case: make it "
            f"with `palpate reference build {called}` where "
            f"FEniCSx is installed, then `palpate reference accept {called} --reason TEXT`"
        )

    def _any_reference(self, strain: Strain) -> State | None:
        return self.references.same_mesh(strain) or self.references.truth(strain)


def null_result(problem: Problem, strain: Strain, reference: State | None) -> State:
    """The result of a simulator that does nothing, at the reference's times, with no force."""
    still = np.zeros_like(problem.mesh.points)
    motion = None if reference is None else reference.trajectory
    if motion is None and problem.time is not None:
        times = np.linspace(0.0, problem.time.end_time, problem.time.num_outputs + 1)
        motion = Trajectory(times, np.zeros((len(times), *still.shape)))
    elif motion is not None:
        motion = Trajectory(motion.times, np.zeros_like(motion.displacements))
    forces = None if reference is None else reference.tool_forces
    return make_state(
        problem.mesh,
        still,
        label="nothing moves",
        simulator="null answer",
        strain=strain,
        trajectory=motion,
        tool_forces=None if forces is None else np.zeros_like(forces),
    )


def wrong_results(problem: Problem, reference: State) -> Iterator[State]:
    """Results made from the right one by a plain mistake; each is labelled with it."""
    yield null_result(problem, reference.strain, reference)
    yield _from(problem, reference, "turned round", lambda u: -u)
    yield _from(problem, reference, "twice as large", lambda u: 2.0 * u)
    yield _from(problem, reference, "axes exchanged", lambda u: u[..., [1, 2, 0]])
    for label, fault in (
        ("last state repeated", Fault.LAST_STATE_REPEATED),
        ("every second state still", Fault.EVERY_SECOND_STATE),
    ):
        if reference.trajectory is not None:
            change = partial(corrupt_displacement, problem.mesh, fault=fault)
            yield _from(problem, reference, label, change, keeps_tool_forces=True)


def _from(
    problem: Problem,
    reference: State,
    label: str,
    change: _Change,
    *,
    keeps_tool_forces: bool = False,
) -> State:
    states, motion, forces = change(reference.displacements), reference.trajectory, None
    if reference.tool_forces is not None:
        forces = reference.tool_forces if keeps_tool_forces else change(reference.tool_forces)
    return replace(
        reference,
        label=label,
        simulator="wrong answer",
        stresses=None,
        integrals=None,
        trajectory=None if motion is None else Trajectory(motion.times, states),
        tool_forces=forces,
        **measures_of(problem.mesh, states[-1]),
    )


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
        value = found.value
        if found.verdict is not Verdict.FAILED or found.precision is Precision.SINGLE:
            return found
        if not _can_be_rounded(spec) or value is None or value > self._ceiling(spec):
            return found
        limit = self._limit(spec)
        if limit is None or value > limit:
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
        """The state that is rounded: the reference on the same mesh, for every check."""
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
