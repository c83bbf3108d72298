"""References that travel with palpate or lie beside a case, so that gates work without FEniCSx.

A file is one .npz of fields and a header, with a SHA-256 over all of it. Its key is what the
solution depends on: mesh, material, supports, loads and schema. Versions of dolfinx and PETSc are
provenance, not key. Whoever reads a reference has its hash checked and its contents compared with
the case (`soundness`).
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.fingerprint import array_hash
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.problem_files import problem_arrays
from palpate.meshes.temporaries import atomic_path
from palpate.meshes.untrusted import parse_json, read_npz
from palpate.validation.references.reference_set import SCALARS, ReferenceSet, StateKey
from palpate.validation.references.soundness import find_contradictions
from palpate.validation.states import REFERENCE, State, StressIntegrals, Trajectory

SCHEMA = 1
# Components of a symmetric tensor: xx, yy, zz, yz, xz, xy.
_UPPER = ([0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1])
_HASH = "sha256"


class MissingReferenceError(InputError):
    """No reference is stored for a case."""


class StaleReferenceError(InputError):
    """The stored reference belongs to another mesh, material, support, load or schema."""


class UntrustedReferenceError(StaleReferenceError):
    """The stored reference is not what was once written, or nobody can say."""


class UnsoundReferenceError(UntrustedReferenceError):
    """The stored reference contradicts itself or its case; `.contradictions` says how."""

    def __init__(self, what: str, contradictions: Sequence[str], remedy: str) -> None:
        self.contradictions = tuple(contradictions)
        shown = "; ".join(self.contradictions[:3])
        more = len(self.contradictions) - 3
        rest = f" and {more} more" if more > 0 else ""
        super().__init__(f"{what} cannot be right: {shown}{rest}; {remedy}")


def references_folder(beside: Path | None = None) -> Path:
    """The folder of stored references; PALPATE_REFERENCES names another folder.

    Args:
        beside: Folder of one's own case: they lie in `references` there. Built-in cases where None.
    """
    chosen = os.environ.get("PALPATE_REFERENCES")
    if chosen:
        return Path(chosen)
    return Path(__file__).parent if beside is None else beside / "references"


def problem_key(problem: Problem) -> str:
    """SHA-256 over everything the solution depends on."""
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
        name: Name of the case.
        problem: The case's problem as it is now.
        folder: Folder of the references; that of the built-in cases where None.
        called: What the case is called on the command line, if not by its name.

    Raises:
        MissingReferenceError: There are none, or the file is damaged.
        StaleReferenceError: They were made for something else.
        UntrustedReferenceError: No hash, or another one than the contents have.
        UnsoundReferenceError: They contradict themselves or the case.
    """
    return load_checked((folder or references_folder()) / f"{name}.npz", name, problem, called)


def load_checked(
    path: Path, name: str, problem: Problem, called: str = "", *, thoroughly: bool = False
) -> ReferenceSet:
    """`load_stored` of one file; `thoroughly` as in `find_contradictions`."""
    remedy = (
        f"make it with `palpate reference build {called or name}` where FEniCSx is installed, then "
        f"`palpate reference accept {called or name} --reason TEXT`"
    )
    if not path.is_file():
        raise MissingReferenceError(f"no stored reference for {name!r}; {remedy}")
    try:
        references, key = read_reference(path)
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
    wrong = find_contradictions(problem, references, thoroughly=thoroughly)
    if wrong:
        raise UnsoundReferenceError(f"the stored reference of {name!r}", wrong, remedy)
    return references


def read_for(problem: Problem, path: Path) -> ReferenceSet:
    """A stored set of a problem whose states on the case's mesh need not be right any more.

    Raises:
        MissingReferenceError, UntrustedReferenceError: As of `load_stored`.
        StaleReferenceError: It was made for something else.
    """
    references, key = read_reference(path)
    if key != problem_key(problem):
        raise StaleReferenceError(f"{path.name} was made for another problem: build it whole")
    return references


def accept_pending(
    name: str, problem: Problem, acceptance: dict[str, Any], *, beside: Path | None = None
) -> Path:
    """Make what was built for a case its accepted references.

    Args:
        name: Name of the case.
        problem: The case's problem as it is now.
        acceptance: Who accepted, why, when and what changed; stored in the provenance.
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
    _, key = read_reference(pending)
    if key != problem_key(problem):
        raise StaleReferenceError(
            f"{name!r} has changed since its reference was built; "
            f"run `palpate reference build {name}` again"
        )
    references = load_checked(pending, name, problem, thoroughly=True)
    provenance = {**references.provenance, "accepted": acceptance}
    path = store(name, problem, references, provenance, path=accepted_path(name, beside))
    pending.unlink()
    return path


def describe_acceptance(references: ReferenceSet) -> str:
    """Who accepted a reference, when and why, in one line; empty where the file does not say."""
    accepted = references.provenance.get("accepted")
    if not isinstance(accepted, dict):
        return ""
    date, by, reason = (accepted.get(key) for key in ("date", "by", "reason"))
    if not (date and by and reason):
        return ""
    return f"accepted {date} by {by}: {reason}"


def describe_time(references: ReferenceSet) -> str:
    """How long a reference took to build, after its date; empty where the file does not say."""
    spent = [references.provenance.get(key) for key in ("seconds", "processor_seconds")]
    clock, processor = (x if isinstance(x, int | float) else None for x in spent)
    if clock is None or processor is None:
        return ""
    return f" in {clock:.0f} s, {processor:.0f} s of the processor"


def describe_changes(before: Path, after: Path) -> list[str]:
    """Compare two files of references, whatever they were made for.

    Args:
        before: The accepted one; may be missing or damaged.
        after: The new one.

    Returns:
        One line for a state that is as it was; of another one for each number that every state
        carries, with its relative change, and for the largest change of displacement; and one for
        each error bar that changed.

    Raises:
        MissingReferenceError, UntrustedReferenceError: `after` is missing, damaged or altered.
    """
    new, new_key = read_reference(after)
    try:
        old, old_key = read_reference(before)
    except (MissingReferenceError, UntrustedReferenceError) as error:
        return [f"nothing to compare with: {error}"]
    lines = [] if old_key == new_key else ["mesh, material, supports or loads have changed"]
    for entry in sorted({*old.states, *new.states}):
        name = f"{entry[0]}, {entry[1]} strain"
        if entry in old.states and entry in new.states:
            lines += _changes_of_state(name, old.states[entry], new.states[entry])
        else:
            lines.append(f"{name}: {'gone' if entry in old.states else 'new'}")
    for metric, strain in sorted({*old.bars, *new.bars}):
        bars = [of.bars.get((metric, strain)) for of in (old, new)]
        if bars[0] != bars[1]:
            was, now = ("none" if bar is None else f"{bar:.3g}" for bar in bars)
            lines.append(f"error bar of {metric}, {strain} strain: {was}, now {now}")
    return lines


def _changes_of_state(name: str, a: State, b: State) -> list[str]:
    lines = []
    if not _are_same(_stress_fields(a), _stress_fields(b)):
        lines.append(f"{name}: stresses {'new' if a.integrals is None else 'changed'}")
    if _are_same(_fields(a), _fields(b)):
        return lines or [f"{name}: unchanged"]
    for metric in SCALARS:
        before, after = float(getattr(a, metric)), float(getattr(b, metric))
        relative = abs(after - before) / abs(before) if before else float(after != before)
        lines.append(
            f"{name}, {metric}: {before:.9g}, now {after:.9g} (relative change {relative:.2g})"
        )
    if a.displacement.shape != b.displacement.shape:
        counts = f"{len(a.displacement)} points, now {len(b.displacement)}"
        return [*lines, f"{name}, displacement: another mesh ({counts})"]
    largest = float(abs(b.displacement - a.displacement).max())
    scale = float(abs(a.displacement).max())
    relative = largest / scale if scale else float(largest > 0.0)
    return [
        *lines,
        f"{name}, displacement: at most {largest:.3g} m apart, {relative:.2g} of the largest",
    ]


def _fields(state: State) -> list[Any]:
    """All numbers of a stored state but its stresses."""
    motion = None if state.trajectory is None else state.trajectory.displacements
    scalars = [getattr(state, name) for name in SCALARS]
    return [scalars, state.displacement, state.tool_forces, motion]


def _stress_fields(state: State) -> list[Any]:
    stress = state.integrals
    if stress is None:
        return [None]
    return [stress.cauchy, stress.internal_force, stress.strain_energy]


def _are_same(one: list[Any], other: list[Any]) -> bool:
    """Whether two lists of arrays are the same to the last bit."""
    return len(one) == len(other) and all(
        a is b or (a is not None and b is not None and np.array_equal(a, b))
        for a, b in zip(one, other, strict=True)
    )


def content_hash(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over name, type, shape and bytes of every array of a file, its header among them."""
    return array_hash("palpate reference file", arrays)


def write_reference(
    path: Path, name: str, key: str, references: ReferenceSet, provenance: dict[str, Any]
) -> None:
    """Write references with their hash, whole or not at all.

    Args:
        path: The file to write.
        name: Name of the case.
        key: Key of the problem that they belong to.
        references: The references to write.
        provenance: Who made and accepted them, and with which versions.
    """
    header: dict[str, Any] = {
        "schema": SCHEMA,
        "key": key,
        "case": name,
        "origin": references.origin,
        "provenance": {k: v for k, v in provenance.items() if k != _HASH},
        # JSON knows no infinity, which is a bar that allows no verdict.
        "bars": {
            f"{m}|{s}": bar if math.isfinite(bar) else None
            for (m, s), bar in references.bars.items()
        },
        "states": [_entry(state) for state in references.states.values()],
    }
    arrays: dict[str, NDArray[Any]] = {}
    for index, state in enumerate(references.states.values()):
        arrays[f"displacement_{index}"] = state.displacement
        if state.integrals is not None:
            # Seven digits: its error bar allows for what is dropped.
            stress = state.integrals.cauchy[:, *_UPPER].astype(np.float32)
            arrays[f"cauchy_stress_{index}"] = stress
            arrays[f"internal_force_{index}"] = state.integrals.internal_force
        if state.trajectory is not None:
            arrays[f"times_{index}"] = state.trajectory.times
            arrays[f"displacements_{index}"] = state.trajectory.displacements
    arrays["header"] = np.array(json.dumps(header, sort_keys=True, allow_nan=False))
    arrays[_HASH] = np.array(content_hash(arrays))
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **dict(arrays))


def _entry(state: State) -> dict[str, Any]:
    """The header's record of a state."""
    forces = None if state.tool_forces is None else state.tool_forces.tolist()
    more = {"tool_forces": forces, "versions": dict(state.versions)}
    entry = {
        "label": state.label,
        "strain": state.strain.value,
        "degree": state.degree,
        "details": {**state.details, **{name: value for name, value in more.items() if value}},
        **{scalar: getattr(state, scalar) for scalar in SCALARS},
    }
    if state.element is not Element.LINEAR:
        entry["element"] = state.element.value
    if state.integrals is not None and state.integrals.strain_energy is not None:
        entry["strain_energy"] = state.integrals.strain_energy
    return entry


def read_reference(path: Path) -> tuple[ReferenceSet, str]:
    """Read a file of references, whatever it was made for.

    Returns:
        The references, not yet compared with any case, with the hash of their contents in their
        provenance; their key.

    Raises:
        MissingReferenceError: Missing, damaged, or of another schema.
        UntrustedReferenceError: It has no hash, or its contents have another one.
    """
    try:
        arrays = read_npz(path)
        stored_hash = arrays.pop(_HASH, None)
        if stored_hash is None:
            raise UntrustedReferenceError("has no hash: what it holds may have been altered")
        if str(stored_hash) != content_hash(arrays):
            raise UntrustedReferenceError(
                f"was altered: its contents have the SHA-256 {content_hash(arrays)[:12]}..., "
                f"not {str(stored_hash)[:12]}... as when it was written"
            )
        header = parse_json(str(arrays["header"]))
        if header["schema"] != SCHEMA:
            raise ValueError(f"schema {header['schema']}")
        found = _unpacked(header, arrays)
        about = {**found.provenance, _HASH: str(stored_hash)}
        return dataclasses.replace(found, provenance=about), str(header["key"])
    except UntrustedReferenceError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        if not Path(path).is_file():
            raise MissingReferenceError("missing") from None
        raise MissingReferenceError(f"damaged ({type(error).__name__})") from error


def _unpacked(header: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> ReferenceSet:
    states: dict[StateKey, State] = {}
    for index, entry in enumerate(header["states"]):
        strain, details = Strain(entry["strain"]), dict(entry["details"])
        forces, versions = details.pop("tool_forces", None), dict(details.pop("versions", {}))
        scalars: Any = {scalar: float(entry[scalar]) for scalar in SCALARS}
        motion = None
        if f"times_{index}" in arrays:
            motion = Trajectory(
                _numbers(arrays[f"times_{index}"]), _numbers(arrays[f"displacements_{index}"])
            )
        states[str(entry["label"]), strain] = State(
            label=str(entry["label"]),
            simulator=REFERENCE,
            strain=strain,
            degree=int(entry["degree"]),
            element=Element(entry.get("element", Element.LINEAR)),
            displacement=_numbers(arrays[f"displacement_{index}"]),
            details=details,
            tool_forces=None if forces is None else _numbers(forces),
            versions=versions,
            trajectory=motion,
            integrals=_integrals(entry, arrays, index),
            **scalars,
        )
    bars = {}
    for bar_of, bar in dict(header["bars"]).items():
        metric, strain_name = bar_of.split("|")
        bars[metric, Strain(strain_name)] = math.inf if bar is None else float(bar)
    provenance = dict(header["provenance"])
    if "versions" in provenance:
        provenance["versions"] = dict(provenance["versions"])
    return ReferenceSet(states, bars, str(header["origin"]), provenance=provenance)


def _integrals(
    entry: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], index: int
) -> StressIntegrals | None:
    if f"cauchy_stress_{index}" not in arrays:
        return None
    six = _numbers(arrays[f"cauchy_stress_{index}"])
    stress = np.zeros((len(six), 3, 3))
    stress[:, *_UPPER] = stress[:, *_UPPER[::-1]] = six
    force = _numbers(arrays[f"internal_force_{index}"])
    energy = entry.get("strain_energy")
    return StressIntegrals(stress, force, None if energy is None else float(energy))


def _numbers(values: Any) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64)
