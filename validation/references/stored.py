"""References that travel with palpate, so that gates work without FEniCSx.

The key is what the answer depends on: mesh, material, supports, loads and schema. Versions of
dolfinx and PETSc are provenance, not key. One file holds fields and header, so that it is
always of one piece.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.problem_files import problem_arrays
from palpate.validation.references.sets import ReferenceSet
from palpate.validation.states import State, Trajectory

SCHEMA = 1
_SCALARS = ("volume", "surface_area", "smallest_det_f", "max_displacement")


class MissingReferenceError(InputError):
    """No reference is stored for a case."""


class StaleReferenceError(InputError):
    """The stored reference belongs to another mesh, material, support, load or schema."""


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
    digest = hashlib.sha256(f"palpate reference schema {SCHEMA}".encode())
    for name, array in sorted(problem_arrays(problem).items()):
        digest.update(f"|{name}|{array.dtype.str}|{array.shape}|".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


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
    """Write a case's references, whole or not at all; as the accepted ones unless `path` is."""
    header: dict[str, Any] = {
        "schema": SCHEMA,
        "key": problem_key(problem),
        "case": name,
        "origin": references.origin,
        "provenance": provenance,
        # JSON knows no infinity, which is a bar that allows no verdict.
        "bars": {
            f"{m}|{s}": bar if math.isfinite(bar) else None
            for (m, s), bar in references.bars.items()
        },
        "states": [],
    }
    arrays: dict[str, Any] = {}
    for index, state in enumerate(references.states.values()):
        header["states"].append(
            {
                "label": state.label,
                "strain": state.strain.value,
                "degree": state.degree,
                "details": _details(state),
                **{scalar: getattr(state, scalar) for scalar in _SCALARS},
            }
        )
        arrays[f"displacement_{index}"] = state.displacement
        if state.trajectory is not None:
            arrays[f"times_{index}"] = state.trajectory.times
            arrays[f"displacements_{index}"] = state.trajectory.displacements
    arrays["header"] = np.array(json.dumps(header, sort_keys=True, allow_nan=False))
    path = path or accepted_path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    return path


def _details(state: State) -> dict[str, Any]:
    """Details of a state with what else the header of schema 1 keeps among them."""
    forces = None if state.tool_forces is None else state.tool_forces.tolist()
    more = {"tool_forces": forces, "versions": dict(state.versions)}
    return {**state.details, **{name: value for name, value in more.items() if value}}


def load_stored(
    name: str, problem: Problem, *, folder: Path | None = None, called: str = ""
) -> ReferenceSet:
    """Read a case's stored references and check that they belong to it.

    Args:
        name: Of the case.
        problem: Of the case now.
        folder: Where they lie; that of the built-in cases where None.
        called: What the case is called on the command line, if not by its name.

    Raises:
        MissingReferenceError: There are none, or the file is damaged.
        StaleReferenceError: They were made for something else.
    """
    path = (folder or references_folder()) / f"{name}.npz"
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
    if key != problem_key(problem):
        raise StaleReferenceError(
            f"the stored reference of {name!r} is stale: mesh, material, supports or loads have "
            f"changed since it was made; {remedy}"
        )
    for state in references.states.values():
        fits = state.displacement.shape == problem.mesh.points.shape
        if not fits or not np.isfinite(state.displacement).all():
            raise StaleReferenceError(f"the stored reference of {name!r} does not fit its mesh")
    return references


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
        StaleReferenceError: The case has changed since it was built.
    """
    pending = pending_path(name, beside)
    if not pending.is_file():
        raise MissingReferenceError(
            f"nothing was built for {name!r}; run `palpate reference build {name}` first"
        )
    references, key = read_reference(pending)
    if key != problem_key(problem):
        raise StaleReferenceError(
            f"{name!r} has changed since its reference was built; "
            f"run `palpate reference build {name}` again"
        )
    provenance = {**references.provenance, "accepted": acceptance}
    path = store(name, problem, references, provenance, path=accepted_path(name, beside))
    pending.unlink()
    return path


def read_reference(path: Path) -> tuple[ReferenceSet, str]:
    """Read a file of references, whatever it was made for, and its key.

    Raises:
        MissingReferenceError: Missing, damaged, or of another schema.
    """
    try:
        # Our own stream: numpy leaves a damaged file open.
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            header = json.loads(str(stored["header"]))
            fields = [stored[f"displacement_{k}"] for k in range(len(header["states"]))]
            motions = [
                Trajectory(stored[f"times_{k}"], stored[f"displacements_{k}"])
                if f"times_{k}" in stored.files
                else None
                for k in range(len(fields))
            ]
        if header["schema"] != SCHEMA:
            raise ValueError(f"schema {header['schema']}")
        return _unpacked(header, fields, motions), str(header["key"])
    except FileNotFoundError:
        raise MissingReferenceError("missing") from None
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile, zlib.error) as error:
        raise MissingReferenceError(f"damaged ({type(error).__name__})") from error


def _unpacked(
    header: dict[str, Any], fields: list[Any], motions: list[Trajectory | None]
) -> ReferenceSet:
    states = {}
    for entry, displacement, motion in zip(header["states"], fields, motions, strict=True):
        strain, details = Strain(entry["strain"]), dict(entry["details"])
        forces, versions = details.pop("tool_forces", None), details.pop("versions", {})
        states[entry["label"], strain] = State(
            label=entry["label"],
            simulator="reference",
            strain=strain,
            degree=entry["degree"],
            displacement=displacement,
            details=details,
            tool_forces=None if forces is None else np.array(forces, dtype=np.float64),
            versions=versions,
            trajectory=motion,
            **{scalar: entry[scalar] for scalar in _SCALARS},
        )
    bars = {}
    for place, bar in header["bars"].items():
        metric, strain_name = place.split("|")
        bars[metric, Strain(strain_name)] = math.inf if bar is None else float(bar)
    return ReferenceSet(states, bars, header["origin"], provenance=header["provenance"])
