"""One case with its references: every check of it, for any answer, wrong ones included."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.case import Case
from palpate.validation.case.regions import part_of_check
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import judge_check
from palpate.validation.judging.published import metric_of_bar, name_of_bar, number_of
from palpate.validation.judging.record import case_name
from palpate.validation.judging.results import CheckResult
from palpate.validation.judging.spoiled import null_answer, spoiled_answers
from palpate.validation.metrics import Number, is_still
from palpate.validation.references.bars import BarParts
from palpate.validation.references.geometry import shape_of
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import State, Verdict


@dataclass(frozen=True, eq=False)
class CaseJudge:
    """What an answer to a case is held against.

    Attributes:
        case: The case.
        references: Of the case.
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
        """Which of the candidate's answers a check is about."""
        return spec.strain or self.case.strain

    def check(self, spec: CheckSpec, candidate: State | None, failure: str = "") -> CheckResult:
        """Judge one check of an answer; `failure` says why there is none."""
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
            shape=shape_of(self.references),
        )
        if spec.is_of_truth_alone:
            return found
        return replace(found, element=self.references.element)

    def is_vacuous(self, spec: CheckSpec) -> bool:
        """Whether the check says nothing of a candidate: the null answer passes it too.

        So does every answer where the reference itself does not move, and where the truth and not
        the candidate is held against a published number.
        """
        reference, strain = self._reference(spec), self.strain_of(spec)
        if spec.is_of_truth_alone:
            return True
        if spec.against != "candidate" and reference and is_still(self.problem.mesh, reference):
            return True
        basis = reference or self._any_reference(strain)
        answer = null_answer(self.problem, strain, basis)
        return self.check(spec, answer).verdict is Verdict.PASSED

    def unseen(self) -> tuple[str, ...]:
        """Plainly wrong answers that no check of the case turns red, by name."""
        reference = self._any_reference(self.case.strain)
        if reference is None:
            return ()
        specs = [spec for spec in self.checks if self.strain_of(spec) is self.case.strain]
        return tuple(
            answer.label
            for answer in spoiled_answers(self.problem, reference)
            if not any(self.check(spec, answer).verdict is Verdict.FAILED for spec in specs)
        )

    def _reference(self, spec: CheckSpec) -> State | None:
        strain = self.strain_of(spec)
        if spec.against != "truth":
            return self.references.same_mesh(strain)
        if not spec.about.is_of_integrals:
            return self.references.truth(strain)
        truth = self.references.stress_truth(strain)
        is_told = truth and (spec.about.read is None or self._number(spec, truth))
        name = name_of_bar(spec, self.problem, self.case.spec.units)
        return truth if is_told and self.references.was_asked(strain, name) else None

    def _number(self, spec: CheckSpec, state: State) -> Number | None:
        return number_of(spec, self.problem, state, self.case.spec.units)

    def _bar_of_part(self, spec: CheckSpec) -> float:
        """Of the truth in the part that a check names; every answer is held against the same."""
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
            kept = "stresses" if spec.about.read is None else "stresses and energy"
            return (
                f"the stored truth of this case was not asked for {kept} in this part: build it "
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
