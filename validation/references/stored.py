"""References that travel with palpate, so that gates work without FEniCSx.

The key is what the answer depends on: mesh, material, supports, loads and schema. Versions of
dolfinx and PETSc are provenance, not key. Whoever reads a reference has its hash checked
(`reference_files`) and its contents held against the case (`soundness`). Files of version 0.1 have
no hash: they are refused until `palpate reference renew` has checked them (`renewal`).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from palpate.meshes.problem import Problem
from palpate.meshes.problem_files import problem_arrays
from palpate.validation.exchange.case_folder import array_hash
from palpate.validation.references.additions import (
    accept_additions,
    additions,
    altered_beside,
    waiting,
)
from palpate.validation.references.errors import (
    MissingReferenceError,
    StaleReferenceError,
    UnsoundReferenceError,
    UntrustedReferenceError,
)
from palpate.validation.references.reference_files import SCHEMA, read_reference, write_reference
from palpate.validation.references.sets import ReferenceSet
from palpate.validation.references.soundness import find_contradictions


def references_folder(beside: Path | None = None) -> Path:
    """Where stored references lie; PALPATE_REFERENCES names another folder.

    Args:
        beside: Folder of one's own case: they lie in `references` there. Built-in cases where None.
    """
    chosen = os.environ.get("PALPATE_REFERENCES")
    if chosen:
        return Path(chosen)
    return Path(__file__).parent if beside is None else beside / "references"


def problem_key(problem: Problem) -> str:
    """SHA-256 over everything the answer depends on."""
    return array_hash(f"palpate reference schema {SCHEMA}", problem_arrays(problem))


def accepted_path(name: str, beside: Path | None = None) -> Path:
    """File of a case's accepted references, which verdicts use."""
    return references_folder(beside) / f"{name}.npz"


def pending_path(name: str, beside: Path | None = None) -> Path:
    """File of a case's references that were built and wait to be accepted."""
    return references_folder(beside) / f"{name}.pending.npz"


def store(
    name: str,
    problem: Problem,
    references: ReferenceSet,
    provenance: dict[str, Any],
    *,
    path: Path | None = None,
) -> Path:
    """Write a case's references, whole or not at all; as the accepted ones unless `path` is.

    Raises:
        UnsoundReferenceError: They contradict themselves or the case; nothing is written.
    """
    wrong = find_contradictions(problem, references)
    if wrong:
        raise UnsoundReferenceError(f"the reference of {name!r}", wrong, "nothing was written")
    path = path or accepted_path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_reference(path, name, problem_key(problem), references, provenance)
    return path


def load_stored(
    name: str, problem: Problem, *, folder: Path | None = None, called: str = ""
) -> ReferenceSet:
    """Read a case's stored references and check that they belong to it and can be right.

    Args:
        name: Of the case.
        problem: Of the case now.
        folder: Where they lie; that of the built-in cases where None.
        called: What the case is called on the command line, if not by its name.

    Raises:
        MissingReferenceError: There are none, or the file is damaged.
        StaleReferenceError: They were made for something else.
        UntrustedReferenceError: No hash, or another one than the contents have.
        UnsoundReferenceError: They contradict themselves or the case.
    """
    return load_checked((folder or references_folder()) / f"{name}.npz", name, problem, called)


def load_checked(
    path: Path,
    name: str,
    problem: Problem,
    called: str = "",
    *,
    thoroughly: bool = False,
    needs_hash: bool = True,
    before_check: Callable[[ReferenceSet], ReferenceSet] | None = None,
) -> ReferenceSet:
    """`load_stored` of one file; `thoroughly` as in `find_contradictions`.

    Without `needs_hash` a file that has none is taken for its contents. What is checked and
    returned is what `before_check` makes of it.
    """
    remedy = (
        f"make it with `palpate reference build {called or name}` where FEniCSx is installed, then "
        f"`palpate reference accept {called or name} --reason TEXT`"
    )
    if not path.is_file():
        raise MissingReferenceError(f"no stored reference for {name!r}; {remedy}")
    try:
        references, key, is_hashed = read_reference(path)
    except MissingReferenceError as error:
        raise MissingReferenceError(
            f"the stored reference of {name!r} is {error}; {remedy}"
        ) from error
    except UntrustedReferenceError as error:
        raise UntrustedReferenceError(
            f"the stored reference of {name!r} {error}; restore the file, or {remedy}"
        ) from error
    if key != problem_key(problem):
        raise StaleReferenceError(
            f"the stored reference of {name!r} is stale: mesh, material, supports or loads have "
            f"changed since it was made; {remedy}"
        )
    if needs_hash and not is_hashed:
        raise UntrustedReferenceError(
            f"the stored reference of {name!r} has no hash, as files of version 0.1: what it "
            f"holds may have been altered; `palpate reference renew {called or name}` checks "
            "what can be checked and adds one"
        )
    if before_check is not None:
        references = before_check(references)
    wrong = find_contradictions(problem, references, thoroughly=thoroughly)
    if wrong:
        raise UnsoundReferenceError(f"the stored reference of {name!r}", wrong, remedy)
    return references


def describe_acceptance(references: ReferenceSet) -> str:
    """Who accepted a reference, when and why, in one line; empty where nobody did."""
    accepted = {"": references.provenance.get("accepted")}
    for what, about in additions(references).items():
        accepted[f"{what} tetrahedra "] = about.get("accepted")
    lines = []
    for what, told in accepted.items():
        if isinstance(told, dict):
            date, by, reason = (told.get(key, "?") for key in ("date", "by", "reason"))
            lines.append(f"{what}accepted {date} by {by}: {reason}")
    return "; ".join(lines)


def describe_time(references: ReferenceSet) -> str:
    """How long a reference took to build, after its date; empty where the file does not tell it."""
    told = [references.provenance.get(key) for key in ("seconds", "processor_seconds")]
    clock, processor = (x if isinstance(x, int | float) else None for x in told)
    if clock is None or processor is None:
        return ""
    return f" in {clock:.0f} s, {processor:.0f} s of the processor"


def accept_pending(
    name: str, problem: Problem, acceptance: dict[str, Any], *, beside: Path | None = None
) -> Path:
    """Make what was built for a case its accepted references.

    Args:
        name: Of the case.
        problem: Of the case now.
        acceptance: Who, why, when and what changed; kept in the provenance.
        beside: See `references_folder`.

    Raises:
        MissingReferenceError: Nothing was built, or it is damaged.
        StaleReferenceError: The case has changed since it was built, or what was built cannot be
            trusted.
    """
    pending = pending_path(name, beside)
    if not pending.is_file():
        raise MissingReferenceError(
            f"nothing was built for {name!r}; run `palpate reference build {name}` first"
        )
    _, key, _ = read_reference(pending)
    if key != problem_key(problem):
        raise StaleReferenceError(
            f"{name!r} has changed since its reference was built; "
            f"run `palpate reference build {name}` again"
        )
    references = load_checked(pending, name, problem, thoroughly=True)
    accepted = accepted_path(name, beside)
    if waiting(references):
        # Who accepted the rest did not see this; what they saw must still be what is there.
        altered = altered_beside(load_checked(accepted, name, problem), references)
        if altered:
            raise StaleReferenceError(
                f"the reference of {name!r} has changed since something was built beside it "
                f"({', '.join(altered)}); build it again"
            )
        provenance = accept_additions(references, acceptance)
    else:
        provenance = {**references.provenance, "accepted": acceptance}
    path = store(name, problem, references, provenance, path=accepted)
    pending.unlink()
    return path
