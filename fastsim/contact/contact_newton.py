"""Newton-Raphson with rigid tools: penalty, or the constraint by augmented Lagrangians.

Each vertex carries p = max(0, multiplier - k A g) along the tool's normal (Alart and Curnier 1991,
"A mixed formulation for frictional contact problems prone to Newton like solution methods",
eq. 14 ff.): with multipliers at zero that is the penalty; with multiplier := p after each
equilibrium it converges to g >= 0, p >= 0, p g = 0, by the ratio of the body's stiffness to the
penalty's. The tangent of -p n is k A n n^T - p d2g/dx2 where p > 0, a semismooth Newton method.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.contact.tool_contact import Gaps, ToolContact
from palpate.fastsim.newton import Newton
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain

# Out-of-balance force over the contact forces, below which what pushes is nearly settled.
_CLOSE = 1e-2

# Slope of the potential at a step's end over that at its start, and how often it is cut.
_STEEP = 0.8
_MOST_CUTS = 8
# Relative residual of the prediction.
_ROUGH = 1e-3


class ContactNewton(Newton):
    """Newton on a problem with tools, each at a given pose.

    Args:
        problem: Mesh, material, supports, loads.
        strain: Strain measure.
        relative_tolerance: Where to stop.
        max_iterations: Where to give up, in one call of `solve`.
        contacts: The tools.
        stiffnesses: Penalty k of each [Pa/m].

    Attributes:
        poses: Of each tool, shape (12,); to be set before `solve`.
        multipliers: Of the vertices of each tool [N].
        settled: What pushed them at the last equilibrium [N].
    """

    def __init__(
        self,
        problem: Problem,
        strain: Strain,
        relative_tolerance: float,
        max_iterations: int,
        contacts: list[ToolContact],
        stiffnesses: list[float],
    ) -> None:
        super().__init__(problem, strain, relative_tolerance, max_iterations)
        self.contacts = contacts
        self.poses: list[NDArray[np.void]] = []
        self.multipliers = [np.zeros(len(contact.vertices)) for contact in contacts]
        self.settled = [np.zeros(len(contact.vertices)) for contact in contacts]
        self._weights = [
            k * contact.areas for k, contact in zip(stiffnesses, contacts, strict=True)
        ]
        self._active: list[np.ndarray[tuple[int, ...], np.dtype[np.bool_]]] = []
        self._contact_norm = 0.0
        self._is_close = False
        self._next_poses: list[NDArray[np.void]] = []
        self._places_size = float(np.abs(problem.mesh.points).max())

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

    def contact_force(self, displacement: Points) -> Points:
        """Of all tools on the body [N], shape (num_points, 3)."""
        force = np.zeros_like(displacement)
        for contact, (gaps, push) in zip(self.contacts, self.pressed(displacement), strict=True):
            force[contact.vertices] += push[:, None] * gaps.normals
        return force

    def predict(self, displacement: Points, poses: list[NDArray[np.void]], factor: float) -> Points:
        """About where the body is once the tools are at other poses; then they are there.

        Distances are those to where the tools were, less how far each comes along its normal: no
        vertex is ever deep inside, where the nearest side may be the wrong one.
        """
        tolerance, self.tolerance = self.tolerance, _ROUGH
        self._next_poses = poses
        try:
            outcome = self.solve(displacement, factor)
        finally:
            self._next_poses, self.tolerance, self.poses = [], tolerance, poses
        return displacement if outcome.displacement is None else outcome.displacement

    def settle(self, displacement: Points) -> None:
        """Remember what pushes at an equilibrium."""
        self.settled = [push for _, push in self.pressed(displacement)]

    def update_multipliers(self, displacement: Points) -> float:
        """Multiplier := p; return the norm of the change over the norm of the multipliers."""
        change, size = 0.0, float(np.finfo(float).tiny)
        for number, (_, push) in enumerate(self.pressed(displacement)):
            change += float(np.sum((push - self.multipliers[number]) ** 2))
            size += float(np.sum(push**2))
            self.multipliers[number] = push
        return float(np.sqrt(change / size))

    def _residual(self, displacement: Points, factor: float) -> tuple[Points, Points]:
        residual, internal = super()._residual(displacement, factor)
        force = self.contact_force(displacement)
        self._contact_norm = float(np.linalg.norm(force))
        total = residual + force
        left = float(np.linalg.norm(total[self._is_free != 0]))
        self._is_close = left < _CLOSE * self._contact_norm
        return total, internal

    def _assemble_tangent(self, displacement: Points, factor: float) -> None:
        super()._assemble_tangent(displacement, factor)
        if self._is_close:
            self.settle(displacement)
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
            self.body.core.add_diagonal_blocks(
                contact.vertices[touching], np.ascontiguousarray(blocks.reshape(-1, 9))
            )
        # A multigrid of another contact patch is of little use.
        changed = len(self._active) != len(active) or any(
            np.any(old != new) for old, new in zip(self._active, active, strict=True)
        )
        self._is_stale = self._is_stale or changed
        self._active = active

    def _line_search(
        self, displacement: Points, step: Points, factor: float, residual: Points, moves_held: bool
    ) -> tuple[Points, Points, Points] | None:
        """As without tools; then shorter while the potential rises steeply again along the step.

        Vertices that come and go would otherwise do so for ever.
        """
        accepted = super()._line_search(displacement, step, factor, residual, moves_held)
        if accepted is None or moves_held:
            return accepted
        free = self._is_free != 0
        fall = float(np.sum((residual * step)[free]))
        low, high = 0.0, 1.0
        for _ in range(_MOST_CUTS):
            trial, trial_residual, _ = accepted
            rise = -float(np.sum((trial_residual * step)[free]))
            if not (fall > 0.0 and abs(rise) > _STEEP * fall):
                return accepted
            reached = float(np.sum((trial - displacement) * step) / np.sum(step * step))
            if rise > 0.0:
                high = reached
            elif reached >= high:
                return accepted
            else:
                low = reached
            middle = displacement + 0.5 * (low + high) * step
            accepted = (middle, *self._residual(middle, factor))
        return accepted

    def _scale(self, internal: Points, factor: float) -> float:
        return max(super()._scale(internal, factor), self._contact_norm)

    def _is_at_rounding(self, displacement: Points, norm: float, history: list[float]) -> bool:
        """As without tools, or what rounding of places in space leaves of k A g."""
        if super()._is_at_rounding(displacement, norm, history):
            return True
        if len(history) < 2 or history[-1] <= 0.5 * history[-2]:
            return False
        eps = float(np.finfo(float).eps)
        weights = np.concatenate(
            [w[a] for w, a in zip(self._weights, self._active, strict=True)] or [np.zeros(0)]
        )
        return norm <= 8.0 * eps * self._places_size * float(np.linalg.norm(weights))


def _ahead(gaps: Gaps, places: Points, pose: NDArray[np.void], next_pose: NDArray[np.void]) -> Gaps:
    """Gaps when the tool has gone on to another pose, to first order in its way."""
    turn = next_pose["rotation"] @ pose["rotation"].T
    way = (places - pose["position"]) @ turn.T + next_pose["position"] - places
    return replace(gaps, distances=gaps.distances - np.sum(gaps.normals * way, axis=1))
