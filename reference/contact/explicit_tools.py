"""Rigid tools in explicit steps: contact forces that leave nodes on the tool after the step.

A node that would be inside a tool after a step gets the force that leaves it on the surface
instead. With lumped mass the multipliers are independent, and each has a closed form:

    p = -g / (n . W b),   correction W b p,   W = dt^2 / (m (1 + lambda dt / 2))

with the gap g and the normal n at the position without contact, W = 0 along fixed components, and
the normal b of a round tool where the node is as the step begins (else b = n): along n the force
would lean with the node's slip v, by v dt / r, and push it on, a damping of -p dt / r. N. J.
Carpenter, R. L. Taylor, M. G. Katona, Lagrange constraints for transient finite element surface
contact, Int. J. Numer. Meth. Engng 32 (1991) 103-128.

Over facets (`ContactRule`) the constraints of neighbours share nodes, and their multipliers hang
together: p >= 0, g + G W G^T p >= 0, and one of them 0 for each constraint, with the average gaps g
and their gradients G at the positions without contact. As G W G^T = L L^T, p is the least squares
solution of L^T p = -L^-1 g with p >= 0. The correction is W G^T p, to first order in G.

Friction is the force -W^-1 s that cancels the sliding s of the node along the tool in the step, or
mu |p n| in that direction where it is less. Over facets s is the average of the sliding of the
points, across the average of their normals where the gaps were taken, and the force is spread over
the points with the parts of the gap: by that to the constraint's own node alone, so that W is its
own (see `friction`).
"""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import BoxShape, CapsuleShape, ContactRule, RigidTool, SphereShape
from palpate.reference import fenicsx
from palpate.reference.contact.contact_points import find_contact_points
from palpate.reference.contact.tool_contact import contact_rule, require_outside
from palpate.reference.contact.tool_distance import seen_at, tool_distance
from palpate.reference.mesh_transfer import TransferredSpace

# A node with fixed components leaves the tool along another line than its normal: iterations.
_MOST_CORRECTIONS = 6
# Least cosine between the normals of a step's two ends: beyond it the node turned a corner.
_NEARLY_ONE_NORMAL = 0.5


class SteppedTools:
    """The tools of one explicit run.

    Args:
        problem: The problem with its tools.
        space: Displacement space of degree 1.
        fixed: Degrees of freedom that are fixed, shape (n,).
        mobility: W above, for every degree of freedom [m/N], flat.

    Raises:
        InputError: A tool is driven by a force, or inside the body at the start.
        ToolError: Contact over facets with a box.
    """

    def __init__(
        self, problem: Problem, space: TransferredSpace, fixed: Indices, mobility: Floats
    ) -> None:
        loose = mobility.copy()
        loose[fixed] = 0.0
        # Those at vertices first: the others see what they have pushed.
        self._tools = [_SteppedTool(tool, space, fixed, loose) for tool in problem.tools]
        self._order = sorted(self._tools, key=lambda tool: tool.is_averaged)
        self._steps = 0

    def require_outside(self, displacement: Floats) -> None:
        """Raise InputError where a tool is in the body at the start."""
        gaps = [tool.gaps(displacement, 0.0).min(initial=0.0) for tool in self._tools]
        least = [fenicsx.smallest(float(gap)) for gap in gaps]
        require_outside(least, [tool.is_averaged for tool in self._tools])
        for tool in self._tools:
            tool.see(displacement, 0.0)

    def keep_out(self, now: Floats, ahead: Floats, time: float, dt: float) -> Floats:
        """Move the nodes out of the tools at the end of a step, one tool after the other.

        Args:
            now: Displacement at the start of the step, flat [m].
            ahead: Displacement at its end, without the tools [m].
            time: Time at its end [s].
            dt: Length of the step [s].
        """
        self._steps += 1
        for tool in self._order:
            ahead = tool.keep_out(now, ahead, time, dt)
        for tool in self._tools:
            tool.see(ahead, time)
        return ahead

    def mean_forces(self) -> Points:
        """Mean force on each tool since the last call [N], shape (num_tools, 3)."""
        sums = np.array([tool.sum_of_forces for tool in self._tools]).reshape(-1, 3)
        means: Points = fenicsx.total(sums) / max(self._steps, 1)
        self._steps = 0
        for tool in self._tools:
            tool.sum_of_forces = np.zeros(3)
        return means


class _SteppedTool:
    def __init__(
        self, tool: RigidTool, space: TransferredSpace, fixed: Indices, mobility: Floats
    ) -> None:
        if tool.drive is not None:
            raise InputError(
                "explicit steps take a tool along its path: of one that a force drives the "
                'multipliers hang together; ask checks against = "truth", solve by degree 2, or '
                "give the path"
            )
        rule = contact_rule(tool, space.degree)
        self.is_averaged = rule is ContactRule.FACETS
        self._is_rough = tool.friction_coefficient > 0.0
        self._tool = tool
        self._points = find_contact_points(space, tool.contact_facets, fixed, rule=rule)
        self._loose = mobility
        self._mobility = mobility.reshape(-1, 3)[self._points.nodes]
        self._is_free = np.ptp(self._mobility, axis=1) <= 1e-12 * self._mobility.max(axis=1)
        self._came_from: Points | None = None
        self.sum_of_forces = np.zeros(3)

    def see(self, displacement: Floats, time: float) -> None:
        """Store the positions of nodes near a box, from which the next step may enter it."""
        if isinstance(self._tool.shape, BoxShape):
            position, rotation = self._tool.path.pose_at(time)
            local = (self._points.positions(displacement) - position) @ rotation
            half_widths = np.asarray(self._tool.shape.half_widths)
            self._came_from = seen_at(local, half_widths, self._came_from)

    def gaps(self, displacement: Floats, time: float) -> Floats:
        position, rotation = self._tool.path.pose_at(time)
        positions = self._points.positions(displacement)
        return self._points.gaps(tool_distance(self._tool.shape, position, rotation, positions).gap)

    def _normals_at(self, displacement: Floats, time: float) -> Points | None:
        """Normals of a round tool at the nodes, shape (n, 3); None of another."""
        if not isinstance(self._tool.shape, SphereShape | CapsuleShape):
            return None
        position, rotation = self._tool.path.pose_at(time)
        positions = self._points.positions(displacement)
        return tool_distance(self._tool.shape, position, rotation, positions).normal

    def keep_out(self, now: Floats, ahead: Floats, time: float, dt: float) -> Floats:
        if self.is_averaged:
            return self._keep_averages_out(now, ahead, time, dt)
        position, rotation = self._tool.path.pose_at(time)
        positions = self._points.positions(ahead)
        forces, normals = np.zeros_like(positions), np.zeros_like(positions)
        rows = np.arange(len(positions))
        begun = self._normals_at(now, time - dt)
        for _ in range(_MOST_CORRECTIONS):
            before = None if self._came_from is None else self._came_from[rows]
            at = tool_distance(self._tool.shape, position, rotation, positions[rows], before)
            lines = at.normal
            if begun is not None:
                is_one = np.sum(begun[rows] * lines, axis=1) > _NEARLY_ONE_NORMAL
                lines = np.where(is_one[:, None], begun[rows], lines)
            give = np.einsum("ni,ni,ni->n", self._mobility[rows], at.normal, lines)
            is_pushed = (at.gap < 0.0) & (give > 0.0)
            rows, give = rows[is_pushed], give[is_pushed]
            if not len(rows):
                break
            normal = at.normal[is_pushed]
            is_first = ~normals[rows].any(axis=1)
            normals[rows[is_first]] = normal[is_first]
            push = (-at.gap[is_pushed] / give)[:, None] * lines[is_pushed]
            forces[rows] += push
            positions[rows] += self._mobility[rows] * push
            rows = rows[~self._is_free[rows]]
        if self._is_rough:
            pressed = np.linalg.norm(forces, axis=1)
            drag = self._drag(self._points.positions(now), positions, pressed, normals, time, dt)
            forces += drag
            positions += self._mobility * drag
        self.sum_of_forces -= forces.sum(axis=0)
        out = ahead.reshape(-1, 3).copy()
        out[self._points.nodes] = positions - self._points.rest
        flat: Floats = out.ravel()
        return flat

    def _keep_averages_out(self, now: Floats, ahead: Floats, time: float, dt: float) -> Floats:
        position, rotation = self._tool.path.pose_at(time)
        positions = self._points.positions(ahead)
        at = tool_distance(self._tool.shape, position, rotation, positions)
        gaps = self._points.gaps(at.gap)
        if not (gaps < 0.0).any():
            return ahead
        dofs, slopes = self._points.gradients(at.normal)
        push = np.zeros_like(ahead)
        active = gaps < 0.0
        while True:
            rows = np.flatnonzero(active)
            push[:], pressed = 0.0, np.zeros_like(gaps)
            pressed[rows] = self._multipliers(rows, gaps, dofs, slopes)
            for row in rows:
                np.add.at(push, dofs[row], pressed[row] * slopes[row])
            moved = self._loose * push
            after = [gaps[k] + slopes[k] @ moved[dofs[k]] for k in range(len(gaps))]
            inside = ~active & (np.array(after) < 0.0)
            if not inside.any():
                break
            active |= inside
        if self._is_rough:
            begun, ended = (
                self._points.averages(self._points.positions(u)) for u in (now, ahead + moved)
            )
            drag = self._drag(begun, ended, pressed, self._points.normals(at.normal), time, dt)
            per_area = drag / self._points.areas[:, None]
            push += self._points.at_nodes(self._points.spread(per_area), push.size)
            moved = self._loose * push
        self.sum_of_forces -= push.reshape(-1, 3).sum(axis=0)
        out: Floats = ahead + moved
        return out

    def _multipliers(
        self, rows: Indices, gaps: Floats, dofs: list[Indices], slopes: list[Floats]
    ) -> Floats:
        """Multipliers [N] of some constraints, the others 0, shape (len(rows),)."""
        from scipy.linalg import solve_triangular
        from scipy.optimize import nnls

        reached, column = np.unique(np.concatenate([dofs[k] for k in rows]), return_inverse=True)
        gradient = np.zeros((len(rows), len(reached)))
        number = np.repeat(np.arange(len(rows)), [len(dofs[k]) for k in rows])
        np.add.at(gradient, (number, column), np.concatenate([slopes[k] for k in rows]))
        multipliers = np.zeros(len(rows))
        give = gradient**2 @ self._loose[reached]
        some = np.flatnonzero(give > 0.0)
        gradient = gradient[some]
        factor = np.linalg.cholesky((gradient * self._loose[reached]) @ gradient.T)
        right = solve_triangular(factor, -gaps[rows[some]], lower=True)
        multipliers[some], _ = nnls(factor.T, right)
        return multipliers

    def _drag(
        self,
        before: Points,
        positions: Points,
        pressed: Floats,
        normals: Points,
        time: float,
        dt: float,
    ) -> Points:
        """Friction on nodes, or averages, that move to another position in a step [N], (n, 3).

        Args:
            before: Positions at the start of the step [m], shape (n, 3).
            positions: Positions after the contact forces [m], shape (n, 3).
            pressed: Contact forces by the tool [N]; without one there is no friction.
            normals: Unit normals of the tool in contact [-], shape (n, 3).
            time: Time at the end of the step [s].
            dt: Length of the step [s].
        """
        old, turned = self._tool.path.pose_at(time - dt)
        position, rotation = self._tool.path.pose_at(time)
        touched = old + (positions - position) @ rotation @ turned.T
        slip = touched - before
        slip -= np.sum(slip * normals, axis=1)[:, None] * normals
        moves = self._mobility > 0.0
        needed = np.where(moves, -slip / np.where(moves, self._mobility, 1.0), 0.0)
        size = np.linalg.norm(needed, axis=1)
        bound = self._tool.friction_coefficient * pressed
        drag: Points = (np.minimum(bound, size) / np.where(size > 0.0, size, 1.0))[:, None] * needed
        return drag
