"""Files of condensed models: .npz of a stated version, read without pickle."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.condensed.elimination import Condensed
from palpate.fastsim.condensed.model import CompliancePrecision, CondensedModel, SupportTerm
from palpate.fastsim.condensed.setup import CondensedSetup
from palpate.meshes.arrays import Floats
from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Element

# Of the file and of what is in it; another one is refused.
_VERSION = 2
_NO_FLOATS = np.zeros(0)


def model_key(setup: CondensedSetup, precision: CompliancePrecision) -> str:
    """SHA-256 by which a model is known again.

    Of the version, the element, the precision, and type, shape and bytes of what is condensed:
    places, matrix (and so material, springs and supports), right sides, touched and seen points.
    """
    words = (str(_VERSION), setup.element.value, precision.value)
    digest = hashlib.sha256("|".join(words).encode())
    for array in setup.arrays:
        digest.update(f"|{array.dtype.str}|{array.shape}|".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write_model(path: str | Path, model: CondensedModel) -> None:
    """Write a model, whole or not at all, with its inside where that was kept."""
    inside = model.inside
    couplings = [] if inside is None else inside.couplings
    offsets = [] if inside is None else inside.offsets
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            version=_VERSION,
            key=model.key,
            precision=model.precision.value,
            element=model.element.value,
            touched=model.touched,
            seen=model.seen,
            blocks=model.blocks,
            load_displacement=model.load_displacement,
            terms=np.array(model.terms, dtype=np.int64).reshape(-1, 2),
            term_displacements=model.term_displacements,
            anchor_displacements=model.anchor_displacements,
            has_inside=inside is not None,
            couplings=_in_a_row(couplings),
            offsets=_in_a_row(offsets),
        )


def read_model(path: str | Path, setup: CondensedSetup) -> CondensedModel:
    """What `write_model` wrote, for what is set up.

    Raises:
        FileFormatError: No such file, no model, or one of another version, problem, element or
            points.
    """
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            fields = {name: file[name] for name in file.files}
        if int(fields["version"]) != _VERSION:
            raise FileFormatError(path, f"is of version {int(fields['version'])}, not {_VERSION}")
        precision = CompliancePrecision(str(fields["precision"]))
        if str(fields["key"]) != model_key(setup, precision):
            raise FileFormatError(path, "is the model of another problem; condense this one anew")
        return _model_of(fields, precision, setup)
    except FileFormatError:
        raise
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise FileFormatError(path, f"is no condensed model ({error})") from error


def _model_of(
    fields: dict[str, NDArray[Any]], precision: CompliancePrecision, setup: CondensedSetup
) -> CondensedModel:
    seen, springs = len(setup.seen), len(setup.problem.springs)

    def checked(name: str, *shape: int, dtype: str = "float64") -> NDArray[Any]:
        array = fields[name]
        if array.shape != shape or array.dtype != dtype:
            raise ValueError(f"{name} is of shape {array.shape}, {array.dtype}")
        return np.ascontiguousarray(array)

    inside = None
    if bool(fields["has_inside"]):
        fronts = setup.dissection.nodes
        num_sides = setup.right_sides.shape[1]
        inside = Condensed(
            np.zeros((0, 0)),
            np.zeros((0, num_sides)),
            setup.dissection,
            _cut(fields["couplings"], [(3 * len(n.own), 3 * len(n.border)) for n in fronts]),
            _cut(fields["offsets"], [(3 * len(n.own), num_sides) for n in fronts]),
        )
    return CondensedModel(
        problem=setup.problem,
        element=Element(str(fields["element"])),
        precision=precision,
        touched=setup.touched,
        seen=setup.seen,
        blocks=checked("blocks", setup.num_blocks, 9, dtype=str(precision.dtype)),
        load_displacement=checked("load_displacement", seen, 3),
        terms=tuple(SupportTerm(int(s), int(k)) for s, k in fields["terms"]),
        term_displacements=checked("term_displacements", len(setup.terms), seen, 3),
        anchor_displacements=checked("anchor_displacements", springs, 3, seen, 3),
        key=str(fields["key"]),
        inside=inside,
    )


def _in_a_row(arrays: Sequence[Floats]) -> Floats:
    return np.concatenate([_NO_FLOATS, *(array.ravel() for array in arrays)])


def _cut(numbers: Floats, shapes: Sequence[tuple[int, int]]) -> list[Floats]:
    sizes = [rows * columns for rows, columns in shapes]
    if numbers.shape != (sum(sizes),) or numbers.dtype != np.float64:
        raise ValueError(f"the inside has {numbers.size} numbers, not {sum(sizes)}")
    pieces = np.split(numbers, np.cumsum(sizes)[:-1]) if sizes else []
    return [piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)]
