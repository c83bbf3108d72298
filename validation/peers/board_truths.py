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
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.case import Case
from palpate.validation.judging.case_references import find_references
from palpate.validation.peers.board_kept import Kept, key_of
from palpate.validation.references.adaptive_truth import TruthRequest
from palpate.validation.references.motions import solve_motion_set
from palpate.validation.references.reference_set import BOTH, ReferenceSet
from palpate.validation.references.statics import solve_live
from palpate.validation.references.stored import (
    MissingReferenceError,
    UntrustedReferenceError,
    problem_key,
    read_reference,
    write_reference,
)
from palpate.validation.states import Progress

# After which no finer mesh of a truth is begun, and that the runs of a motion take together: a
# board has many of them [s]; and unknowns of the largest mesh of statics.
_SECONDS, _SECONDS_OF_A_MOTION, _UNKNOWNS = 120.0, 240.0, 2e5
_TOLD_SECONDS, _WHY = "seconds", "why"


@dataclass(frozen=True, eq=False)
class Truth:
    """The references of a case under a law; None where there are none, and why.

    Attributes:
        case: Under the law.
        references: States and bars.
        why: There are none, or none but on the case's own mesh.
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
    limit = _SECONDS if problem.time is None else _SECONDS_OF_A_MOTION
    key = key_of(problem_key(problem), *made_by(), f"{limit:g} {_UNKNOWNS:g}")
    path = kept.path(name, key, ".npz")
    if (none := kept.read(name, key)) is not None:
        return Truth(case, why=str(none[0].get(_WHY)))
    try:
        references, made_for = read_reference(path)
        if made_for == key:
            why = str(references.provenance.get(_WHY, ""))
            return Truth(case, references, why, _seconds_of(references))
    except (MissingReferenceError, UntrustedReferenceError):
        pass
    begin = time.monotonic()
    try:
        references = _solve(case, limit, progress)
    except ReferenceUnavailableError as error:
        return Truth(case, why=str(error))
    except (ReferenceFailedError, InputError) as error:
        kept.write(name, key, {_WHY: str(error)}, None)
        return Truth(case, why=str(error))
    why = ""
    if references.truth(case.strain) is None:
        why = "; ".join(references.failures.values()) or "the reference found no answer"
    if why and references.same_mesh(case.strain) is None:
        kept.write(name, key, {_WHY: why}, None)
        return Truth(case, why=why)
    seconds = time.monotonic() - begin
    told = {**references.provenance, _TOLD_SECONDS: seconds, _WHY: why}
    references = dataclasses.replace(references, provenance=told)
    write_reference(path, case.name, key, references, told)
    return Truth(case, references, why, seconds)


def _solve(case: Case, seconds: float, progress: Progress) -> ReferenceSet:
    """The references of a case under another law, of its own strain measure."""
    problem, strains = case.problem, (case.strain,)
    if problem.time is not None:
        # Without a stated step there is none on the same mesh to be equal to.
        wanted = {"truth"} if problem.time.time_step is None else BOTH
        return solve_motion_set(problem, progress, wanted=wanted, strains=strains, seconds=seconds)
    # The distance of displacement is all that is told of it.
    request = TruthRequest(seconds=seconds, metrics={case.strain: ("displacement_l2",)})
    return solve_live(
        problem, progress, strains=strains, has_stress=False, request=request, unknowns=_UNKNOWNS
    )


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
