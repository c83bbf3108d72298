"""What answers are held against: a case's stored truth, or one solved here under another law."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.reference.errors import ReferenceFailedError
from palpate.validation.case import Case
from palpate.validation.judging.judge import find_references
from palpate.validation.references.adaptive_truth import TruthRequest
from palpate.validation.references.errors import MissingReferenceError, UntrustedReferenceError
from palpate.validation.references.live import solve_live
from palpate.validation.references.reference_files import read_reference, write_reference
from palpate.validation.references.sets import BOTH, ReferenceSet
from palpate.validation.references.stored import problem_key
from palpate.validation.scoreboard.kept import Kept
from palpate.validation.states import Progress

# After which no finer mesh of a truth is begun: a board has many of them [s].
_SECONDS = 60.0


@dataclass(frozen=True, eq=False)
class Truth:
    """The references of a case under a law; None where there are none, and why.

    Attributes:
        case: Under the law.
        references: States and bars.
        why: There are none.
    """

    case: Case
    references: ReferenceSet | None = None
    why: str = ""

    @property
    def law(self) -> Law:
        """That it solves."""
        return self.case.problem.material.law


def case_under(case: Case, law: Law) -> Case:
    """A case of finite strain under a law; one of linear strain is Hooke's, whatever the law."""
    return case.under(law) if case.strain is Strain.GREEN else case


def find_truth(case: Case, kept: Kept, progress: Progress) -> Truth:
    """The stored references of a case; of one under another law those kept, or solved now.

    Args:
        case: Under the law that is asked for.
        kept: Where such truths are kept.
        progress: Called with one line for each thing done.
    """
    if case.other_law is None:
        try:
            return Truth(case, find_references(case, live=False, progress=progress))
        except InputError as error:
            return Truth(case, why=str(error))
    problem, name = case.problem, f"truth-{case.name}"
    key = problem_key(problem)
    failed = kept.read(name, key)
    if failed is not None:
        return Truth(case, why=str(failed[0].get("why", "")))
    path = kept.path(name, key, ".npz")
    try:
        references, made_for, _ = read_reference(path)
        if made_for == key:
            return Truth(case, references)
    except (MissingReferenceError, UntrustedReferenceError):
        pass
    try:
        references = solve_live(
            problem,
            progress,
            wanted=BOTH,
            strains=(case.strain,),
            has_stress=False,
            # The distance of displacement is all that is told of it.
            request=TruthRequest(seconds=_SECONDS, metrics={case.strain: ("displacement_l2",)}),
        )
    except (ReferenceFailedError, InputError) as error:
        return _keep_failure(case, kept, name, key, str(error))
    if references.truth(case.strain) is None and references.same_mesh(case.strain) is None:
        why = "; ".join(references.failures.values()) or "the reference found no answer"
        return _keep_failure(case, kept, name, key, why)
    write_reference(path, case.name, key, references, dict(references.provenance))
    return Truth(case, references)


def _keep_failure(case: Case, kept: Kept, name: str, key: str, why: str) -> Truth:
    kept.write(name, key, {"why": why}, None)
    return Truth(case, why=why)
