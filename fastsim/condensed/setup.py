"""Matrix, right-hand sides and order of points from which a model is condensed; its errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim.body import Body
from palpate.fastsim.condensed.elimination import Dissection, Graph, dissect
from palpate.fastsim.errors import FastsimError
from palpate.fastsim.forces import external_force, lumped_areas
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.supports import FixedPoints, turning
from palpate.meshes.arrays import Floats, Indices, Points, checked_indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.rigid_modes import require_supported

# Columns of the compliance extended to seen points at a time.
COLUMNS = 384


class CompliancePrecision(StrEnum):
    """Number format of the stored compliance; everything is computed in double precision."""

    SINGLE = "single"
    DOUBLE = "double"

    @property
    def dtype(self) -> np.dtype[Any]:
        """Data type of the stored numbers."""
        return np.dtype(np.float32 if self is CompliancePrecision.SINGLE else np.float64)


class SupportTerm(NamedTuple):
    """A part of a support's movement that has a factor of its own.

    Of kind 0 its displacement, with its factor s; 1 and 2 its turn by an angle, sin(s angle) across
    and 1 - cos(s angle) inwards. `support` counts from 0.
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


@dataclass(frozen=True)
class CondensedSize:
    """Memory and work of condensing, estimated without doing it.

    Attributes:
        num_touched: Points on which forces may act.
        num_seen: Points whose displacements are known, the touched ones included.
        model_bytes: Size of the stored compliance.
        peak_bytes: Largest memory in use while it is made.
        operations: Floating-point operations, about; a core does 10 to 40 in a nanosecond.
    """

    num_touched: int
    num_seen: int
    model_bytes: int
    peak_bytes: int
    operations: float

    def __str__(self) -> str:
        return (
            f"{self.num_touched} touched and {self.num_seen} seen points: "
            f"{self.model_bytes / 1e6:.0f} MB, {self.peak_bytes / 1e6:.0f} MB while it is made, "
            f"{self.operations / 1e9:.3g} GFlop"
        )


class CondensedSetup:
    """The matrix without fixed components, its right-hand sides, and the order of points."""

    def __init__(
        self,
        problem: Problem,
        element: Element,
        touched: ArrayLike | None,
        seen: ArrayLike | None,
    ) -> None:
        require_supported(problem)
        mesh = problem.mesh
        self.problem, self.element = problem, element
        self._supports = FixedPoints(problem)
        self.is_free = self._supports.is_free
        is_movable = self.is_free.any(axis=1)
        boundary = np.unique(mesh.boundary_facets)
        self.touched = _chosen(touched, boundary[is_movable[boundary]], mesh.num_points, "touched")
        if not is_movable[self.touched].all():
            bad = int(self.touched[~is_movable[self.touched]][0])
            raise NotCondensableError(f"touched point {bad} is held; leave it out")
        wanted = _chosen(seen, self.touched, mesh.num_points, "seen")
        self.others = np.setdiff1d(wanted, self.touched).astype(np.int32)
        self.seen = np.concatenate([self.others, self.touched]).astype(np.int32)
        self._assemble()
        eliminated = np.setdiff1d(np.flatnonzero(is_movable), self.touched).astype(np.int32)
        self.dissection: Dissection = dissect(mesh.points, self.graph, eliminated, self.touched)

    @property
    def num_blocks(self) -> int:
        """Number of 3 x 3 blocks of the stored compliance."""
        t = len(self.touched)
        return t * len(self.others) + t * (t + 1) // 2

    def size(self, precision: CompliancePrecision, keep_inside: bool) -> CondensedSize:
        """Memory and work of condensing."""
        model = self.num_blocks * 9 * precision.dtype.itemsize
        order, t = self.dissection, len(self.touched)
        keeps = keep_inside or len(self.others) > 0
        factors = order.factor_bytes if keeps else 0
        at_once = 3 * self.problem.mesh.num_points * min(3 * t, COLUMNS) * 8
        extending = 8 * 9 * t * t + model + (2 * at_once if len(self.others) else 0)
        matrix = self.blocks.nbytes + self.right_sides.nbytes
        peak = matrix + factors + max(order.peak_bytes, extending)
        return CondensedSize(t, len(self.seen), model, peak, order.operations)

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All arrays on which the model depends, besides element and precision."""
        return (
            self.problem.mesh.points, self.graph.row_start, self.graph.columns, self.blocks,
            self.right_sides, self.prescribed_fields, self.touched, self.seen,
        )  # fmt: skip

    def to_space(self, vectors: Points) -> Points:
        """Components along x, y, z of points' own ones."""
        return self._supports.to_global(vectors)

    def rows(self, numbers: NDArray[Any]) -> list[NDArray[Any]]:
        """Views of the rows of the compliance: blocks of each, shape (n, 3, 3)."""
        blocks = numbers.reshape(-1, 3, 3)
        lengths = len(self.others) + 1 + np.arange(len(self.touched))
        return np.split(blocks, np.cumsum(lengths)[:-1]) if len(lengths) else []

    def fill_touched(self, rows: list[NDArray[Any]], dense: Floats) -> None:
        """Put a compliance in the points' own components into the rows."""
        turns = self._turns()
        for k, row in enumerate(rows):
            blocks = dense[3 * k : 3 * k + 3, : 3 * k + 3].reshape(3, k + 1, 3).transpose(1, 0, 2)
            if turns is not None:
                own = turns[self.touched[: k + 1]]
                blocks = turns[self.touched[k]].T @ blocks @ own
            row[len(self.others) :] = blocks

    def fill_others(self, rows: list[NDArray[Any]], response: Floats, begin: int) -> None:
        """Put the response of the points that are only seen to columns of forces into the rows."""
        turns, n = self._turns(), len(self.others)
        for column in range(0, response.shape[1], 3):
            k = (begin + column) // 3
            # C_is is C_si transposed.
            blocks = response[:, column : column + 3].reshape(n, 3, 3).transpose(0, 2, 1)
            if turns is not None:
                blocks = turns[self.touched[k]].T @ blocks @ turns[self.others]
            rows[k][:n] = blocks

    def _turns(self) -> Floats | None:
        """Axes of every point, as rows; None where all are x, y, z."""
        slanted = self._supports.slanted
        if slanted is None:
            return None
        turns = np.tile(np.eye(3), (self.problem.mesh.num_points, 1, 1))
        turns[slanted.points] = slanted.axes
        return turns

    def _assemble(self) -> None:
        problem, supports = self.problem, self._supports
        body = Body.of(problem, Strain.LINEAR, element=self.element)
        if supports.slanted is not None:
            slanted = supports.slanted
            body.core.set_frames(slanted.points, slanted.axes.reshape(-1, 9))
        body.core.assemble_tangent(np.zeros_like(problem.mesh.points))
        springs = PatchSprings(problem.mesh.points, problem.springs)
        springs.add_to(body.core, 1.0)
        if supports.slanted is not None:
            body.core.turn_matrix()
        row_start, columns, numbers = body.core.matrix()
        self.graph = Graph(row_start.astype(np.int64), columns)
        free = self.is_free.astype(np.float64)
        rows = np.repeat(np.arange(len(row_start) - 1), np.diff(row_start))
        blocks = numbers.reshape(-1, 3, 3)
        blocks *= free[rows][:, :, None]
        blocks *= free[columns][:, None, :]
        # Fixed components are equations of their own.
        blocks[rows == columns] += (1.0 - free)[:, :, None] * np.eye(3)
        self.blocks: Floats = blocks
        self.terms = tuple(
            SupportTerm(number, kind)
            for number, support in enumerate(problem.supports)
            for kind in (0, 1, 2)
            if (any(support.displacement) if kind == 0 else support.rotation is not None)
        )
        self.prescribed_fields = prescribed_fields_of(problem, supports, self.terms)
        load = supports.to_local(external_force(problem))
        sides = [np.where(self.is_free != 0, load, 0.0)]
        for field in self.prescribed_fields.T[1:]:
            reaction = body.core.multiply(np.ascontiguousarray(field.reshape(-1, 3)))
            sides.append(np.where(self.is_free != 0, -reaction, 0.0))
        for pull in _anchor_pulls(problem, springs):
            sides.append(np.where(self.is_free != 0, supports.to_local(pull), 0.0))
        anchored = np.zeros((len(self.prescribed_fields), 3 * len(problem.springs)))
        self.prescribed_fields = np.hstack([self.prescribed_fields, anchored])
        self.right_sides: Floats = np.array(sides).reshape(len(sides), -1).T.copy()


def surface_points(problem: Problem) -> Indices:
    """Points of the boundary that are not fixed in all components, ascending."""
    mesh = problem.mesh
    is_free = FixedPoints(problem).is_free.any(axis=1)
    found: Indices = np.flatnonzero((lumped_areas(mesh, mesh.boundary_facets) > 0.0) & is_free)
    return found.astype(np.int32)


def prescribed_fields_of(
    problem: Problem, supports: FixedPoints, terms: tuple[SupportTerm, ...]
) -> Floats:
    """Fixed components by terms of factor 1, along the points' own axes; first a column of zeros.

    Shape (3 num_points, 1 + len(terms)).
    """
    points = problem.mesh.points
    fields = [np.zeros_like(points)]
    unturned = FixedPoints(
        dataclasses.replace(
            problem,
            supports=tuple(dataclasses.replace(s, rotation=None) for s in problem.supports),
            tools=(),
        )
    )
    for term in terms:
        factors = np.zeros(len(problem.supports))
        field = np.zeros_like(points)
        rotation = problem.supports[term.support].rotation
        if term.kind == 0:
            factors[term.support] = 1.0
            field = unturned.at(factors)
        elif rotation is not None:
            mine = supports.fixed_by(term.support)
            turned = turning(rotation, points)[term.kind - 1]
            field = np.where(mine, turned, 0.0)
            slanted = supports.slanted
            if slanted is not None and (slanted.supports == term.support).any():
                raise NotCondensableError(
                    f"support {term.support + 1} turns points that another holds along a slanted "
                    "normal; separate the supports"
                )
        fields.append(field)
    return np.array(fields).reshape(len(fields), -1).T.copy()


def _chosen(given: ArrayLike | None, default: Indices, num_points: int, what: str) -> Indices:
    if given is None:
        return default.astype(np.int32)
    checked = checked_indices(given, 1, num_points, f"{what} points")
    return np.unique(checked).astype(np.int32)


def _anchor_pulls(problem: Problem, springs: PatchSprings) -> Iterator[Points]:
    """Force on the body by 1 m of each anchor along x, y, z [N]; the body is at rest."""
    at_rest = np.zeros_like(problem.mesh.points)
    for number in range(len(springs)):
        for axis in range(3):
            anchors = np.zeros((len(springs), 3))
            anchors[number, axis] = 1.0
            yield springs.force(at_rest, anchors, np.ones(len(springs)))


class NotCondensableError(InputError):
    """A problem that the condensed linear model cannot pose; the message says what to do."""


class CondensedTooLargeError(InputError):
    """More memory than is allowed, before any is allocated; `.needed_bytes`, `.allowed_bytes`."""

    def __init__(self, needed_bytes: int, allowed_bytes: int, about: str) -> None:
        self.needed_bytes = needed_bytes
        self.allowed_bytes = allowed_bytes
        super().__init__(
            f"condensing needs {needed_bytes / 1e6:.0f} MB ({about}), more than the "
            f"{allowed_bytes / 1e6:.0f} MB allowed; name fewer touched points (the `region` of a "
            "case's tool), or allow more (most_bytes)"
        )


class UnsettledContactError(FastsimError):
    """A step in which contact did not settle; the model is as it was before the step.

    `.iterations` of Newton's method, `.error` by which the last gap or displacement was wrong [m].
    """

    def __init__(self, iterations: int, error: float) -> None:
        self.iterations = iterations
        self.error = error
        super().__init__(
            f"contact did not settle in {iterations} iterations (wrong by {error:.2g} m); move the "
            "tools less far in a step"
        )
