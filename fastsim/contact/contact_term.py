"""Rigid tools as a term of the residual: penalty, or the constraint by augmented Lagrangians.

Each vertex carries p = max(0, multiplier - k A g) along the tool's normal (Alart and Curnier 1991,
"A mixed formulation for frictional contact problems prone to Newton like solution methods",
eq. 14 ff.): with multipliers at zero that is the penalty; with multiplier := p after each
equilibrium it converges to g >= 0, p >= 0, p g = 0, by the ratio of the body's stiffness to the
penalty's. The tangent of -p n is k A n n^T - p d2g/dx2 where p > 0, a semismooth Newton method.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.body import Body
from palpate.fastsim.contact.tool_contact import Gaps, ToolContact
from palpate.meshes.arrays import Points


class ContactTerm:
    """What tools push a body with, each at a given pose.

    Args:
        contacts: The tools.
        stiffnesses: Penalty k of each [Pa/m].

    Attributes:
        poses: Of each tool, of `POSE`; to be set before anything is asked.
        multipliers: Of the vertices of each tool [N].
        settled: What pushed them at the last equilibrium [N].
    """

    def __init__(self, contacts: list[ToolContact], stiffnesses: list[float]) -> None:
        self.contacts = contacts
        self.poses: list[NDArray[np.void]] = []
        self.multipliers = [np.zeros(len(contact.vertices)) for contact in contacts]
        self.settled = [np.zeros(len(contact.vertices)) for contact in contacts]
        self._weights = [
            k * contact.areas for k, contact in zip(stiffnesses, contacts, strict=True)
        ]
        self._active: list[NDArray[np.bool_]] = []
        self._next_poses: list[NDArray[np.void]] = []

    def pressed(self, displacement: Points) -> list[tuple[Gaps, Points]]:
        """Gaps of each tool's vertices, and what pushes them p [N], shape (n,)."""
        out: list[tuple[Gaps, Points]] = []
        for contact, pose, multiplier, weight in zip(
            self.contacts, self.poses, self.multipliers, self._weights, strict=True
        ):
            gaps = contact.gaps(displacement, pose)
            if self._next_poses:
                gaps = _ahead(gaps, contact.places(displacement), pose, self._next_poses[len(out)])
            out.append((gaps, np.maximum(0.0, multiplier - weight * gaps.distances)))
        return out

    def force(self, displacement: Points) -> Points:
        """Of all tools on the body [N], shape (num_points, 3)."""
        force = np.zeros_like(displacement)
        for contact, (gaps, push) in zip(self.contacts, self.pressed(displacement), strict=True):
            force[contact.vertices] += push[:, None] * gaps.normals
        return force

    def add_tangent(self, body: Body, displacement: Points) -> bool:
        """Add minus the force's derivative to the matrix; say whether other vertices touch."""
        active = []
        for contact, weight, settled, (gaps, push) in zip(
            self.contacts, self._weights, self.settled, self.pressed(displacement), strict=True
        ):
            touching = push > 0.0
            active.append(touching)
            n, axis = gaps.normals[touching], gaps.axes[touching]
            normal, along = n[:, :, None] * n[:, None, :], axis[:, :, None] * axis[:, None, :]
            # On the way p may be far too large; bent with the last settled one the tangent stays
            # definite, and with p there once it is settled.
            bend = (np.minimum(push, settled) * gaps.curvatures)[touching, None, None]
            blocks = weight[touching, None, None] * normal - bend * (np.eye(3) - normal - along)
            body.core.add_diagonal_blocks(
                contact.vertices[touching], np.ascontiguousarray(blocks.reshape(-1, 9))
            )
        changed = len(self._active) != len(active) or any(
            np.any(old != new) for old, new in zip(self._active, active, strict=True)
        )
        self._active = active
        return changed

    def settle(self, displacement: Points) -> None:
        """Remember what pushes at an equilibrium, or near one."""
        self.settled = [push for _, push in self.pressed(displacement)]

    def rounding_error(self, body: Body) -> float:
        """Norm of what rounding of places in space leaves of k A g [N]."""
        touching = [w[a] for w, a in zip(self._weights, self._active, strict=True)]
        size = float(np.linalg.norm(np.concatenate([*touching, np.zeros(0)])))
        return 8.0 * float(np.finfo(float).eps) * float(np.abs(body.mesh.points).max()) * size

    def update_multipliers(self, displacement: Points) -> float:
        """Multiplier := p; return the norm of the change over the norm of the multipliers."""
        change, size = 0.0, float(np.finfo(float).tiny)
        for number, (_, push) in enumerate(self.pressed(displacement)):
            change += float(np.sum((push - self.multipliers[number]) ** 2))
            size += float(np.sum(push**2))
            self.multipliers[number] = push
        return float(np.sqrt(change / size))

    @contextmanager
    def going_to(self, poses: list[NDArray[np.void]]) -> Iterator[None]:
        """Meanwhile, gaps are those where the tools will be; then the tools are there.

        Distances are those to where the tools were, less how far each comes along its normal: no
        vertex is ever deep inside, where the nearest side may be the wrong one.
        """
        self._next_poses = poses
        try:
            yield
        finally:
            self._next_poses, self.poses = [], poses


def _ahead(gaps: Gaps, places: Points, pose: NDArray[np.void], next_pose: NDArray[np.void]) -> Gaps:
    """Gaps when the tool has gone on to another pose, to first order in its way."""
    turn = next_pose["rotation"] @ pose["rotation"].T
    way = (places - pose["position"]) @ turn.T + next_pose["position"] - places
    return replace(gaps, distances=gaps.distances - np.sum(gaps.normals * way, axis=1))
