"""Supports as fixed degrees of freedom with their prescribed values.

A node on slanted planes has axes of its own, the first of which span the planes' normals: its
degrees of freedom are the components along these axes. A fixed component is then a degree of
freedom like any other, and no penalty is needed.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc
from palpate.reference.mesh_transfer import TransferredSpace

# Singular values of unit normals below which two planes are one.
_ONE_PLANE = 1e-8


@dataclass(frozen=True, eq=False)
class NodeFrames:
    """Nodes with axes of their own: degrees of freedom (n, 3), unit vectors as rows (n, 3, 3)."""

    dofs: Indices
    axes: Floats

    def to_local(self, flat: Floats) -> Floats:
        """Turn a flat vector along x, y, z to components along the nodes' own axes; a copy."""
        return self._turned(flat, self.axes)

    def to_global(self, flat: Floats) -> Floats:
        """Turn a flat vector along the nodes' own axes to components along x, y, z; a copy."""
        return self._turned(flat, self.axes.transpose(0, 2, 1))

    def turned(self, matrix: Any) -> Any:
        """Q A Q^T, a new matrix, for vectors along the nodes' own axes."""
        first, last = matrix.getOwnershipRange()
        # Q^T by rows: a single entry 1, except for these nodes, which have three entries.
        counts = np.ones(last - first, dtype=PETSc.IntType)
        counts[self.dofs] = 3
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
        columns = np.repeat(np.arange(first, last, dtype=PETSc.IntType), counts)
        entries = np.ones(starts[-1])
        positions = starts[self.dofs][:, :, None] + np.arange(3)
        columns[positions] = self.dofs[:, None, :] + first
        entries[positions] = self.axes.transpose(0, 2, 1)
        back = PETSc.Mat().createAIJ(
            matrix.getSizes(),
            bsize=matrix.getBlockSizes(),
            csr=(starts, columns, entries),
            comm=fenicsx.COMM,
        )
        turned = matrix.ptap(back)
        back.destroy()
        turned.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        return turned

    def _turned(self, flat: Floats, by: Floats) -> Floats:
        turned = flat.copy()
        turned[self.dofs] = np.einsum("nij,nj->ni", by, flat[self.dofs])
        return turned


class FixedDofs:
    """The fixed degrees of freedom and their prescribed values.

    Attributes:
        dofs: Sorted degrees of freedom (three per node), shape (n,); for nodes with axes of their
            own these are components along them.
        values: Displacement of each under the full load [m], shape (n,).
        frames: Nodes with axes of their own; None where there are none.
    """

    # Of `with_zeros`: how many more are fixed, and where the entries are among all, sorted.
    _zeros = 0
    _order: NDArray[np.intp] | None = None

    def __init__(
        self, coordinates: Points, supports: Sequence[Support], blocks: Sequence[Indices]
    ) -> None:
        self._coordinates, self._supports, self._blocks = coordinates, supports, blocks
        self._owner = np.full((len(coordinates), 3), -1)
        for number, (support, nodes) in enumerate(zip(supports, blocks, strict=True)):
            if support.normal is None:
                for axis in np.flatnonzero(support.components):
                    self._owner[nodes, axis] = number
        self._slanted = self._find_slanted()
        is_fixed = self._owner >= 0
        self.frames: NodeFrames | None = None
        # All ranks have frames, or none has.
        if any(support.normal is not None for support in supports):
            nodes = np.array([node.block for node in self._slanted], dtype=np.int32)
            for node in self._slanted:
                self._owner[node.block] = -1
                is_fixed[node.block] = np.arange(3) < len(node.values)
            axes = np.array([node.axes for node in self._slanted]).reshape(-1, 3, 3)
            self.frames = NodeFrames(3 * nodes[:, None] + np.arange(3, dtype=np.int32), axes)
        self._entries: Indices = np.flatnonzero(is_fixed).astype(np.int32)
        self.dofs: Indices = self._entries

    @cached_property
    def values(self) -> Floats:  # noqa: D102  (an attribute above)
        return self.at(1.0)

    def at(self, factors: float | Sequence[float]) -> Floats:
        """Displacement of each for a factor on all supports, or for one factor for each [m]."""
        given = self._everywhere(factors)[self._entries]
        return (
            given if self._order is None else np.append(given, np.zeros(self._zeros))[self._order]
        )

    def renumbered(self, new: Indices) -> FixedDofs:
        """A copy with degrees of freedom renumbered; `new` is the number of each old one."""
        other = copy.copy(self)
        other.__dict__.pop("values", None)
        order = np.argsort(new[self._entries])
        other._entries = self._entries[order]
        other.dofs = new[other._entries]
        if self.frames is not None:
            other.frames = NodeFrames(new[self.frames.dofs], self.frames.axes)
        return other

    def with_zeros(self, dofs: Indices) -> FixedDofs:
        """A copy that fixes more degrees of freedom, none of a displacement, at 0."""
        other = copy.copy(self)
        other.__dict__.pop("values", None)
        order = np.argsort(np.concatenate([self.dofs, dofs]))
        other.dofs = np.concatenate([self.dofs, dofs])[order].astype(np.int32)
        other._zeros, other._order = len(dofs), order
        return other

    def resultants(self, reactions: Points) -> Points:
        """Resultant of nodal reactions at each support [N], shape (num_supports, 3).

        A component along x, y, z that several supports fix counts for the first; on slanted planes
        each support has a force along its normal.
        """
        left = reactions.copy()
        forces = np.zeros((len(self._supports), 3))
        for node in self._slanted:
            # r = sum of pushes times directions, by least squares where a plane is given twice.
            pushes = np.linalg.pinv(node.directions.T, rcond=_ONE_PLANE) @ left[node.block]
            np.add.at(forces, node.supports, pushes[:, None] * node.directions)
            left[node.block] = 0.0
        for number, (support, nodes) in enumerate(zip(self._supports, self._blocks, strict=True)):
            if support.normal is None:
                fixed = left[nodes] * np.array(support.components)
                forces[number] += fixed.sum(axis=0)
                left[nodes] -= fixed
        return forces

    def _everywhere(self, factors: float | Sequence[float]) -> Floats:
        """Flat, 0 where free."""
        each = np.broadcast_to(np.asarray(factors, dtype=np.float64), len(self._supports))
        fixed = np.zeros_like(self._coordinates)
        for number, support in enumerate(self._supports):
            mine = self._owner == number
            nodes = np.flatnonzero(mine.any(axis=1))
            moved = _displaced(support, self._coordinates[nodes], float(each[number]))
            fixed[mine] = moved[mine[nodes]]
        for node in self._slanted:
            fixed[node.block, : len(node.values)] = node.values @ self._asked(node, each)
        return fixed.ravel()

    def _asked(self, node: _SlantedNode, factors: Floats) -> Floats:
        """Prescribed displacements of the supports along their directions [m]."""
        position = self._coordinates[node.block][None]
        return np.array(
            [
                float(direction @ _displaced(self._supports[s], position, float(factors[s]))[0])
                for s, direction in zip(node.supports, node.directions, strict=True)
            ]
        )

    def _find_slanted(self) -> list[_SlantedNode]:
        slanting: dict[int, list[tuple[int, Floats]]] = {}
        for number, (support, nodes) in enumerate(zip(self._supports, self._blocks, strict=True)):
            if support.normal is not None:
                for node in nodes.tolist():
                    slanting.setdefault(node, []).append((number, support.directions[0]))
        found = []
        for block, slanted in sorted(slanting.items()):
            by_axis = [
                (int(self._owner[block, axis]), np.eye(3)[axis])
                for axis in range(3)
                if self._owner[block, axis] >= 0
            ]
            together = by_axis + slanted
            supports = np.array([number for number, _ in together])
            # The planes' normals span the first right singular vectors.
            rows = np.array([direction for _, direction in together])
            left, sizes, axes = np.linalg.svd(rows)
            rank = int(np.sum(sizes > _ONE_PLANE))
            values = left[:, :rank].T / sizes[:rank, None]
            found.append(_SlantedNode(block, supports, rows, axes, values))
        return found


@dataclass(frozen=True, eq=False)
class _SlantedNode:
    block: int
    supports: NDArray[np.int64]  # that fix it, one for each direction
    directions: Floats  # unit vectors, (n, 3)
    axes: Floats  # its own axes, as rows
    values: Floats  # from displacements along the directions to fixed components, (rank, n)


def fixed_dofs(space: TransferredSpace, supports: Sequence[Support]) -> FixedDofs:
    """Turn supports into fixed degrees of freedom.

    A facet fixes all nodes on its closure: in a quadratic space those on its edges too.

    Raises:
        InputError: A prescribed displacement is not finite.
    """
    blocks = []
    for number, support in enumerate(supports, start=1):
        what = f"support {number}"
        displacement = np.asarray(support.displacement, dtype=np.float64)
        if displacement.shape != (3,) or not np.isfinite(displacement).all():
            raise InputError(f"{what}: displacement {support.displacement} needs 3 finite values")
        blocks.append(_blocks(space, support, what))
    return FixedDofs(space.coordinates, tuple(supports), blocks)


def _blocks(space: TransferredSpace, support: Support, what: str) -> Indices:
    entities = space.transferred.facet_entities(support.facets, what)
    on_facets = fenicsx.fem.locate_dofs_topological(space.space, 2, entities)
    owned = np.asarray(on_facets, dtype=np.int32)
    return np.union1d(space.owned_dofs(support.points), owned[owned < space.num_blocks])


def _displaced(support: Support, positions: Points, factor: float) -> Points:
    """Displacements that a support prescribes at rest positions, times a factor [m], (n, 3)."""
    displacement = np.asarray(support.displacement, dtype=np.float64)
    moved: Points = np.tile(factor * displacement, (len(positions), 1))
    if support.rotation is not None:
        # exp([theta]_x) by the half angle's quaternion (w, v): R r - r = 2 v x (v x r + w r).
        half = 0.5 * factor * support.rotation.angle
        axis = np.asarray(support.rotation.axis)
        v, w = np.sin(half) * axis / np.linalg.norm(axis), np.cos(half)
        r = positions - np.asarray(support.rotation.center)
        moved += 2.0 * np.cross(v, np.cross(v, r) + w * r)
    return moved
