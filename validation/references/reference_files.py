"""References as a file: fields and header in one .npz, and a SHA-256 over all of it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.problem import Element, Strain
from palpate.meshes.untrusted_arrays import read_npz
from palpate.meshes.untrusted_text import parse_json
from palpate.validation.exchange.case_folder import array_hash
from palpate.validation.references.errors import MissingReferenceError, UntrustedReferenceError
from palpate.validation.references.sets import ReferenceSet
from palpate.validation.references.soundness import SCALARS
from palpate.validation.states import REFERENCE, State, StressIntegrals, Trajectory

SCHEMA = 1
# Of a symmetric tensor: xx, yy, zz, yz, xz, xy.
_UPPER = ([0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1])
_HASH = "sha256"


def content_hash(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over name, type, shape and bytes of every array of a file, its header among them."""
    return array_hash("palpate reference file", arrays)


def write_reference(
    path: Path, name: str, key: str, references: ReferenceSet, provenance: dict[str, Any]
) -> None:
    """Write references with their hash, whole or not at all.

    Args:
        path: Where.
        name: Of the case.
        key: Of the problem they belong to.
        references: What is written.
        provenance: Who made and accepted them, and with what.
    """
    header: dict[str, Any] = {
        "schema": SCHEMA,
        "key": key,
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
    arrays: dict[str, NDArray[Any]] = {}
    for index, state in enumerate(references.states.values()):
        header["states"].append(
            {
                "label": state.label,
                "strain": state.strain.value,
                "degree": state.degree,
                **({} if state.element is Element.LINEAR else {"element": state.element.value}),
                "details": _details(state),
                **_of_integrals(state.integrals),
                **{scalar: getattr(state, scalar) for scalar in SCALARS},
            }
        )
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


def _of_integrals(kept: StressIntegrals | None) -> dict[str, Any]:
    """What the header says beside the stresses; files of before have no energy."""
    return (
        {} if kept is None or kept.strain_energy is None else {"strain_energy": kept.strain_energy}
    )


def _details(state: State) -> dict[str, Any]:
    """Details of a state with what else the header of schema 1 keeps among them."""
    forces = None if state.tool_forces is None else state.tool_forces.tolist()
    more = {"tool_forces": forces, "versions": dict(state.versions)}
    return {**state.details, **{name: value for name, value in more.items() if value}}


def read_reference(path: Path) -> tuple[ReferenceSet, str, bool]:
    """Read a file of references, whatever it was made for.

    Returns:
        The references, not yet held against any case; their key; whether the file has a hash,
        which then is that of its contents.

    Raises:
        MissingReferenceError: Missing, damaged, or of another schema.
        UntrustedReferenceError: Its contents have another hash than it says.
    """
    try:
        arrays = read_npz(path)
        stored_hash = arrays.pop(_HASH, None)
        if stored_hash is not None and str(stored_hash) != content_hash(arrays):
            raise UntrustedReferenceError(
                f"was altered: its contents have the SHA-256 {content_hash(arrays)[:12]}..., "
                f"not {str(stored_hash)[:12]}... as when it was written"
            )
        header = parse_json(str(arrays["header"]))
        if header["schema"] != SCHEMA:
            raise ValueError(f"schema {header['schema']}")
        return _unpacked(header, arrays), str(header["key"]), stored_hash is not None
    except UntrustedReferenceError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        if not Path(path).is_file():
            raise MissingReferenceError("missing") from None
        raise MissingReferenceError(f"damaged ({type(error).__name__})") from error


def _unpacked(header: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> ReferenceSet:
    states = {}
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
    for place, bar in dict(header["bars"]).items():
        metric, strain_name = place.split("|")
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
