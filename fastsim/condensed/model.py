"""The condensed linear model: displacements at touched and seen points, and its file.

u = u_loads + the columns of supports and of springs' anchors + C f, with C the compliance of the
touched points: small strain, so everything adds. Equal to the linear solve on the whole mesh
(eq. 5) at these points.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.condensed.elimination import Condensed
from palpate.fastsim.condensed.setup import (
    CompliancePrecision,
    CondensedSetup,
    NotCondensableError,
    SupportTerm,
    prescribed_fields_of,
)
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.fingerprint import array_hash, date_now, palpate_hash
from palpate.meshes.problem import Element, Problem
from palpate.meshes.temporaries import atomic_path
from palpate.meshes.untrusted import read_npz


@dataclass(frozen=True, eq=False)
class CondensedModel:
    """Compliance of a body's touched points, and its columns of loads and supports.

    Made by `condense`, or read by `load_condensed`.

    Attributes:
        problem: What was condensed.
        element: Its tetrahedra.
        precision: Precision of the compliance.
        touched: Points on which forces may act, ascending, shape (num_touched,).
        seen: Points whose displacements are known: those that are only seen, then the touched
            ones, shape (num_seen,).
        blocks: The compliance [m/N], 3 x 3 blocks row by row, shape (num_blocks, 9), as
            core/condensed/compliance.hpp has them: symmetric, so half of it.
        load_displacement: Displacement of seen points by the problem's loads [m], (num_seen, 3).
        terms: What moves the supports.
        term_displacements: Displacement of seen points by terms of factor 1, (n, num_seen, 3) [m].
        anchor_displacements: Displacement of seen points by each anchor along x, y, z [m/m],
            shape (num_springs, 3, num_seen, 3).
        key: Hash of problem, element and points; a file of another key is refused.
        inside: From which the points inside follow; None if it was not stored.
        made: Of a model that was read from a file: when it was made, in UTC; else "".
    """

    problem: Problem
    element: Element
    precision: CompliancePrecision
    touched: Indices
    seen: Indices
    blocks: NDArray[Any]
    load_displacement: Points
    terms: tuple[SupportTerm, ...]
    term_displacements: Floats
    anchor_displacements: Floats
    key: str
    inside: Condensed | None = None
    made: str = ""

    @cached_property
    def compliance(self) -> _core.Compliance:
        """The compiled compliance."""
        num_touched = len(self.touched)
        return _core.Compliance(self.blocks, num_touched, len(self.seen) - num_touched)

    @property
    def num_bytes(self) -> int:
        """Memory of the compliance and the columns [bytes]."""
        columns = (self.load_displacement, self.term_displacements, self.anchor_displacements)
        return self.blocks.nbytes + sum(array.nbytes for array in columns)

    def displacement(
        self,
        forces: ArrayLike | None = None,
        *,
        load_factor: float = 1.0,
        support_factors: float | Sequence[float] = 1.0,
        anchors: ArrayLike | None = None,
    ) -> Points:
        """Displacement of the seen points [m], shape (num_seen, 3).

        Args:
            forces: On the touched points, besides the problem's loads [N], shape (num_touched, 3);
                None is none. Fixed components take none.
            load_factor: Factor of the problem's loads.
            support_factors: Factor of the full size of all supports, or one for each.
            anchors: Displacements of the springs' anchors [m], shape (num_springs, 3); None is
                the end of their paths.

        Raises:
            InputError: Another shape, or a number that is not finite.

        Note:
            Small strain and small rotation: see `palpate.validation` for its error against Green
            strain. A turned support is turned exactly.
        """
        found: Points = load_factor * self.load_displacement
        factors = self.term_factors(support_factors)
        found = found + np.tensordot(factors, self.term_displacements, axes=1)
        if self.problem.springs:
            found = found + np.tensordot(self.anchors(anchors), self.anchor_displacements, axes=2)
        if forces is not None:
            found = found + self.compliance.response(self._checked(forces))
        return found

    def term_factors(self, support_factors: float | Sequence[float] = 1.0) -> Floats:
        """The factor of each term at parts of the supports' full size [-], shape (n,)."""
        given = np.asarray(support_factors, dtype=np.float64)
        supports = self.problem.supports
        if given.shape not in ((), (len(supports),)) or not np.isfinite(given).all():
            raise InputError(
                f"support factors of shape {given.shape}: give one number, or one for each of the "
                f"{len(supports)} supports, all finite"
            )
        each = np.broadcast_to(given, len(supports))
        factors = [t.factor(self.problem, float(each[t.support])) for t in self.terms]
        return np.array(factors, dtype=np.float64)

    def anchors(self, given: ArrayLike | None = None) -> Floats:
        """Displacements of the springs' anchors [m], (num_springs, 3); None: as in statics."""
        springs = self.problem.springs
        if given is None:
            given = [spring.path.end for spring in springs]
        moved = np.asarray(given, dtype=np.float64)
        if moved.size == 0 and not springs:
            return np.zeros((0, 3))
        if moved.shape != (len(springs), 3) or not np.isfinite(moved).all():
            raise InputError(
                f"anchors of shape {moved.shape}: {len(springs)} springs need "
                f"({len(springs)}, 3), all finite"
            )
        return moved

    def whole_displacement(
        self,
        forces: ArrayLike | None = None,
        *,
        load_factor: float = 1.0,
        support_factors: float | Sequence[float] = 1.0,
        anchors: ArrayLike | None = None,
    ) -> Points:
        """Displacement of all points of the mesh [m], shape (num_points, 3).

        Args:
            forces: On the touched points [N], shape (num_touched, 3), as in `displacement`.
            load_factor: Factor of the problem's loads.
            support_factors: Factor of all supports, or one for each.
            anchors: Displacements of the springs' anchors [m], shape (num_springs, 3).

        Raises:
            NotCondensableError: The model was made without `keep_inside`.
        """
        if self.inside is None:
            raise NotCondensableError(
                "this model knows the seen points only; condense with keep_inside = True"
            )
        moved = self.anchors(anchors)
        terms = self.term_factors(support_factors)
        factors = np.concatenate([[load_factor], terms, moved.ravel()])
        seen = self.displacement(
            forces, load_factor=load_factor, support_factors=support_factors, anchors=moved
        )
        touched = seen[len(self.seen) - len(self.touched) :]
        problem, supports = self.problem, FixedPoints(self.problem)
        fields = prescribed_fields_of(problem, supports, self.terms)
        prescribed = (fields @ factors[: fields.shape[1]]).reshape(-1, 3)
        at_touched = np.zeros_like(problem.mesh.points)
        at_touched[self.touched] = touched
        # Free components follow the elimination; fixed ones are where their supports put them.
        is_free = supports.is_free != 0
        own = np.where(is_free, supports.to_local(at_touched), 0.0)[self.touched]
        found = self.inside.extend(own.reshape(-1, 1), problem.mesh.num_points, factors[:, None])
        return supports.to_global(np.where(is_free, found.reshape(-1, 3), prescribed))

    def save(self, path: str | Path) -> None:
        """Write the model to an .npz, whole or not at all, with its inside where it was stored."""
        inside = self.inside
        couplings = [] if inside is None else inside.couplings
        offsets = [] if inside is None else inside.offsets
        given = {
            "version": _VERSION,
            "key": self.key,
            "made": self.made or date_now(),
            "made_by": palpate_hash(),
            "precision": self.precision.value,
            "element": self.element.value,
            "touched": self.touched,
            "seen": self.seen,
            "blocks": self.blocks,
            "load_displacement": self.load_displacement,
            "terms": np.array(self.terms, dtype=np.int64).reshape(-1, 2),
            "term_displacements": self.term_displacements,
            "anchor_displacements": self.anchor_displacements,
            "has_inside": inside is not None,
            "couplings": _in_a_row(couplings),
            "offsets": _in_a_row(offsets),
        }
        fields = {name: np.asarray(value) for name, value in given.items()}
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **fields, sha256=np.array(content_hash(fields)))

    def _checked(self, forces: ArrayLike) -> Points:
        f = np.ascontiguousarray(forces, dtype=np.float64)
        if f.shape != (len(self.touched), 3) or not np.isfinite(f).all():
            raise InputError(
                f"forces of shape {f.shape}: {len(self.touched)} touched points need "
                f"({len(self.touched)}, 3), all finite"
            )
        return f


# Version of the file and its content; another one is refused.
_VERSION = 3
_NO_FLOATS = np.zeros(0)


def model_key(setup: CondensedSetup, precision: CompliancePrecision) -> str:
    """SHA-256 that identifies a model.

    Of the version, the element, the precision, and type, shape and bytes of the input:
    positions, matrix (and so material, springs and supports), right sides, touched and seen points.
    """
    words = (str(_VERSION), setup.element.value, precision.value)
    digest = hashlib.sha256("|".join(words).encode())
    for array in setup.arrays:
        digest.update(f"|{array.dtype.str}|{array.shape}|".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def content_hash(fields: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over every array of a model's file but the hash itself."""
    rest = {name: array for name, array in fields.items() if name != "sha256"}
    return array_hash("palpate condensed model", rest)


def read_model(path: str | Path, setup: CondensedSetup) -> CondensedModel:
    """Read a model that `CondensedModel.save` wrote, for a body that has been set up.

    Raises:
        FileFormatError: No such file, no model, one that has changed since it was written, or one
            of another version, problem, element or points, or made by another palpate.
    """
    try:
        fields = read_npz(path, most_bytes=_most_bytes(setup))
        if int(fields["version"]) != _VERSION:
            raise FileFormatError(path, f"is of version {int(fields['version'])}, not {_VERSION}")
        if str(fields["sha256"]) != content_hash(fields):
            raise FileFormatError(
                path, "has changed since it was written: its numbers do not have its hash"
            )
        precision = CompliancePrecision(str(fields["precision"]))
        if str(fields["key"]) != model_key(setup, precision):
            raise FileFormatError(path, "is the model of another problem; condense this one anew")
        if str(fields["made_by"]) != palpate_hash():
            raise FileFormatError(
                path, f"was made by another palpate on {fields['made']}; condense anew"
            )
        return _model_of(fields, precision, setup)
    except FileFormatError:
        raise
    except (ValueError, KeyError, TypeError) as error:
        raise FileFormatError(path, f"is no condensed model ({error})") from error


def _most_bytes(setup: CondensedSetup) -> int:
    """Memory of the arrays of a model with its inside, in double precision, and of its words."""
    columns = len(setup.terms) + 3 * len(setup.problem.springs) + 1
    sides = setup.right_sides.shape[1]
    inside = sum(9 * len(n.own) * len(n.border) for n in setup.dissection.nodes)
    inside += sum(3 * len(n.own) * sides for n in setup.dissection.nodes)
    numbers = 9 * setup.num_blocks + 3 * len(setup.seen) * columns + inside
    return 8 * (numbers + 2 * (len(setup.touched) + len(setup.seen))) + 100_000


def _model_of(
    fields: dict[str, NDArray[Any]], precision: CompliancePrecision, setup: CondensedSetup
) -> CondensedModel:
    seen, springs = len(setup.seen), len(setup.problem.springs)

    def checked(name: str, *shape: int, dtype: str = "float64") -> NDArray[Any]:
        array = fields[name]
        if array.shape != shape or array.dtype != dtype:
            raise ValueError(f"{name} is of shape {array.shape}, {array.dtype}")
        return np.ascontiguousarray(array)

    if fields["terms"].tolist() != [list(term) for term in setup.terms]:
        raise ValueError(f"its terms are not the {len(setup.terms)} of this problem's supports")
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
        terms=setup.terms,
        term_displacements=checked("term_displacements", len(setup.terms), seen, 3),
        anchor_displacements=checked("anchor_displacements", springs, 3, seen, 3),
        key=str(fields["key"]),
        inside=inside,
        made=str(fields["made"]),
    )


def _in_a_row(arrays: Sequence[Floats]) -> Floats:
    return np.concatenate([_NO_FLOATS, *(array.ravel() for array in arrays)])


def _cut(numbers: Floats, shapes: Sequence[tuple[int, int]]) -> list[Floats]:
    sizes = [rows * columns for rows, columns in shapes]
    if numbers.shape != (sum(sizes),) or numbers.dtype != np.float64:
        raise ValueError(f"the inside has {numbers.size} numbers, not {sum(sizes)}")
    pieces = np.split(numbers, np.cumsum(sizes)[:-1]) if sizes else []
    return [piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)]
