"""What answers are held against: a case's stored truth, or one solved here under another law."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path

from palpate import reference
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.reference import availability
from palpate.reference.errors import ReferenceFailedError
from palpate.validation.case import Case
from palpate.validation.judging.judge import find_references
from palpate.validation.references.adaptive_truth import TruthRequest
from palpate.validation.references.errors import MissingReferenceError, UntrustedReferenceError
from palpate.validation.references.live import solve_live
from palpate.validation.references.reference_files import read_reference, write_reference
from palpate.validation.references.sets import BOTH, ReferenceSet
from palpate.validation.references.stored import problem_key
from palpate.validation.scoreboard.kept import Kept, key_of
from palpate.validation.states import Progress

# After which no finer mesh of a truth is begun: a board has many of them [s].
_SECONDS = 60.0
_TOLD_SECONDS = "seconds"


@dataclass(frozen=True, eq=False)
class Truth:
    """The references of a case under a law; None where there are none, and why.

    Attributes:
        case: Under the law.
        references: States and bars.
        why: There are none.
        seconds: By the clock, that solving them took where they were solved for the board.
    """

    case: Case
    references: ReferenceSet | None = None
    why: str = ""
    seconds: float = 0.0

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
    key = key_of(problem_key(problem), *made_by(), f"{_SECONDS:g}")
    path = kept.path(name, key, ".npz")
    try:
        references, made_for, _ = read_reference(path)
        if made_for == key:
            return Truth(case, references, seconds=_seconds_of(references))
    except (MissingReferenceError, UntrustedReferenceError):
        pass
    begin = time.monotonic()
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
        return Truth(case, why=str(error))
    if references.truth(case.strain) is None and references.same_mesh(case.strain) is None:
        why = "; ".join(references.failures.values()) or "the reference found no answer"
        return Truth(case, why=why)
    seconds = time.monotonic() - begin
    told = {**references.provenance, _TOLD_SECONDS: seconds}
    references = dataclasses.replace(references, provenance=told)
    write_reference(path, case.name, key, references, told)
    return Truth(case, references, seconds=seconds)


def _seconds_of(references: ReferenceSet) -> float:
    told = references.provenance.get(_TOLD_SECONDS, 0.0)
    return float(told) if isinstance(told, int | float) else 0.0


@functools.cache
def made_by() -> tuple[str, ...]:
    """What a truth that is solved here hangs on: FEniCSx, and the sources of the reference."""
    sources = sorted(Path(reference.__file__).parent.rglob("*.py"))
    text = b"\0".join(source.read_bytes() for source in sources)
    installed = json.dumps(availability.versions(), sort_keys=True)
    return installed, hashlib.sha256(text).hexdigest()
