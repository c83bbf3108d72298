"""The condensed linear model: what touched and seen points do under forces and supports.

u = u_loads + the columns of supports and of springs' anchors + C f, with C the compliance of the
touched points: small strain, so everything adds. Equal to the linear solve on the whole mesh
(eq. 5) at these points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.condensed.elimination import Condensed
from palpate.fastsim.condensed.setup import NotCondensableError
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem


class CompliancePrecision(StrEnum):
    """In which numbers the compliance is kept; everything is computed in double."""

    SINGLE = "single"
    DOUBLE = "double"

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the kept numbers."""
        return np.dtype(np.float32 if self is CompliancePrecision.SINGLE else np.float64)


class SupportTerm(NamedTuple):
    """A part of a support's movement that has a factor of its own.

    Attributes:
        support: Number of the support, from 0.
        kind: 0 is its displacement, with its factor s; 1 and 2 are its turn by an angle,
            sin(s angle) across and 1 - cos(s angle) inwards.
    """

    support: int
    kind: int

    def factor(self, problem: Problem, s: float) -> float:
        """Its factor at a part s of the support's full size."""
        rotation = problem.supports[self.support].rotation
        if self.kind == 0 or rotation is None:
            return s
        turned = s * rotation.angle
        return float(np.sin(turned) if self.kind == 1 else 2.0 * np.sin(0.5 * turned) ** 2)


@dataclass(frozen=True, eq=False)
class CondensedModel:
    """Compliance of a body's touched points, and its columns of loads and supports.

    Made by `condense`, or read by `load_condensed`.

    Attributes:
        problem: What was condensed.
        element: Its tetrahedra.
        precision: Of the compliance.
        touched: Points on which forces may act, ascending, shape (num_touched,).
        seen: Points whose displacements are known: those that are only seen, then the touched
            ones, shape (num_seen,).
        blocks: The compliance [m/N], 3 x 3 blocks row by row, shape (num_blocks, 9), as
            core/condensed/compliance.hpp has them: symmetric, so half of it.
        load_displacement: Of the seen points under the problem's loads [m], (num_seen, 3).
        terms: What moves the supports.
        term_displacements: Of the seen points under each term of factor 1 [m], (n, num_seen, 3).
        anchor_displacements: Of the seen points by the anchor of each spring along x, y, z [m/m],
            shape (num_springs, 3, num_seen, 3).
        key: Of problem, element and points; a file of another key is refused.
        inside: What the points inside follow by; None where that was not kept.
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

    @cached_property
    def compliance(self) -> _core.Compliance:
        """The compiled compliance."""
        num_touched = len(self.touched)
        return _core.Compliance(self.blocks, num_touched, len(self.seen) - num_touched)

    @property
    def num_bytes(self) -> int:
        """Of the compliance and the columns."""
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
                None is none. Components that are held take none.
            load_factor: Part of the problem's loads.
            support_factors: Part of the full size of all supports, or one for each.
            anchors: How far those of the springs are moved [m], shape (num_springs, 3); None is
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
        """How far the springs' anchors are moved [m], (num_springs, 3); None: as in statics."""
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
            forces: As of `displacement`; the other arguments as well.
            load_factor: Likewise.
            support_factors: Likewise.
            anchors: Likewise.

        Raises:
            NotCondensableError: The model was made without `keep_inside`.
        """
        if self.inside is None:
            raise NotCondensableError(
                "this model knows the seen points only; condense with keep_inside = True"
            )
        from palpate.fastsim.condensed.condense import extend_inside

        moved = self.anchors(anchors)
        terms = self.term_factors(support_factors)
        factors = np.concatenate([[load_factor], terms, moved.ravel()])
        seen = self.displacement(
            forces, load_factor=load_factor, support_factors=support_factors, anchors=moved
        )
        return extend_inside(self, seen[len(self.seen) - len(self.touched) :], factors)

    def save(self, path: str | Path) -> None:
        """Write the model to an .npz, whole or not at all, with its inside where that was kept."""
        from palpate.fastsim.condensed.model import write_model

        write_model(path, self)

    def _checked(self, forces: ArrayLike) -> Points:
        f = np.ascontiguousarray(forces, dtype=np.float64)
        if f.shape != (len(self.touched), 3) or not np.isfinite(f).all():
            raise InputError(
                f"forces of shape {f.shape}: {len(self.touched)} touched points need "
                f"({len(self.touched)}, 3), all finite"
            )
        return f
