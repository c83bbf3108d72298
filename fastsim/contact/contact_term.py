"""Rigid tools as a term of the residual: penalty, or the constraint by augmented Lagrangians.

Each vertex carries p = max(0, multiplier - k A g) along the gradient of its gap g (Alart and
Curnier 1991, "A mixed formulation for frictional contact problems prone to Newton like solution
methods", eq. 14 ff.): with multipliers at zero that is the penalty; with multiplier := p after each
equilibrium it converges to g >= 0, p >= 0, p g = 0, by the ratio of the body's stiffness to the
penalty's. The tangent of -p grad g is k A grad g grad g^T - p d2g/du2 where p > 0, a semismooth
Newton method. Over facets g is an average (contact_sampling.py), and the forces act at its points.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import half_thickness, mean_edge
from palpate.fastsim.contact.tool_contact import Gaps, ToolContact, gaps_at
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import BoxShape, ContactRule

# Steps up to this fraction of an edge show by which face of a box a vertex came in at its edge.
_SHORT_OVER_EDGES = 0.05
# A normal may turn by more than 60 degrees only in steps up to this fraction of the way to the
# tool's middle.
_TURNED = 0.5
_SHORT_THROUGH = 0.25
# A vertex is in contact up to this fraction of its area's square root.
_TOUCHES = 1e-3


@dataclass(frozen=True, eq=False)
class Pressed:
    """How a tool presses.

    Attributes:
        gaps: Of the points at which they are taken.
        averages: Gaps of the constraints [m], shape (n,).
        push: Normal forces p of the constraints [N], shape (n,).
    """

    gaps: Gaps
    averages: Floats
    push: Floats


class ContactTerm:
    """Forces of tools on a body, each at a given pose.

    Args:
        contacts: The tools.
        stiffnesses: Penalty k of each [Pa/m].

    Attributes:
        poses: Poses of each tool, of `POSE`; to be set before any other use.
        multipliers: Multipliers of the constraints of each tool [N].
        settled: Normal forces on them at the last equilibrium [N].
    """

    def __init__(self, contacts: list[ToolContact], stiffnesses: list[float]) -> None:
        self.contacts = contacts
        self.poses: list[NDArray[np.void]] = []
        self.multipliers = [np.zeros(len(contact.sampling.areas)) for contact in contacts]
        self.settled = [np.zeros(len(contact.sampling.areas)) for contact in contacts]
        self._weights = self._given = [
            k * contact.sampling.areas for k, contact in zip(stiffnesses, contacts, strict=True)
        ]
        self._drags = [
            Drag(contact.tool.friction_coefficient, weight)
            for contact, weight in zip(contacts, self._weights, strict=True)
        ]
        shapes = [contact.tool.shape for contact in contacts]
        self._faces = [BoxFaces(s.half_widths) if isinstance(s, BoxShape) else None for s in shapes]
        # Normals in the tools' frames at the last accepted equilibrium.
        self._seen: list[Points] = []
        self._active: list[NDArray[np.bool_]] = []
        self._extended: Body | None = None  # whose matrix has the pattern of the contacts
        self._next_poses: list[NDArray[np.void]] = []

    def stiffen(self, factor: float) -> None:
        """Take so many times the given penalties: multipliers converge by that much faster."""
        self._weights = [factor * weight for weight in self._given]
        for drag, weight in zip(self._drags, self._weights, strict=True):
            drag.weights = weight

    def pressed(self, displacement: Points) -> list[Pressed]:
        """Gaps and normal forces of each tool."""
        out: list[Pressed] = []
        for contact, pose, multiplier, weight in zip(
            self.contacts, self.poses, self.multipliers, self._weights, strict=True
        ):
            positions = contact.sampling.positions(displacement)
            gaps = gaps_at(contact.shape, positions, pose)
            faces = self._faces[len(out)]
            if faces is not None:
                gaps = faces.from_faces(gaps, positions, pose)
            if self._next_poses:
                gaps = _ahead(gaps, positions, pose, self._next_poses[len(out)])
            averages = contact.sampling.averaged(gaps.distances)
            out.append(Pressed(gaps, averages, np.maximum(0.0, multiplier - weight * averages)))
        return out

    def force(self, displacement: Points) -> Points:
        """Force of all tools on the body [N], shape (num_points, 3)."""
        force = np.zeros_like(displacement)
        for contact, vectors in zip(self.contacts, self.vectors(displacement), strict=True):
            contact.sampling.add_to(force, vectors)
        return force

    def vectors(self, displacement: Points) -> list[Points]:
        """Forces of each tool on the points at which its gaps are taken [N], shape (m, 3)."""
        out = []
        for number, pressed in enumerate(self.pressed(displacement)):
            spread = self.contacts[number].sampling.spread
            dragged = spread(self._dragged(number, displacement, pressed.gaps)[0])
            out.append(spread(pressed.push)[:, None] * pressed.gaps.normals + dragged)
        return out

    def _dragged(self, number: int, displacement: Points, gaps: Gaps) -> tuple[Points, Floats]:
        contact, drag = self.contacts[number], self._drags[number]
        if drag.coefficient == 0.0:
            count = len(contact.sampling.areas)
            return np.zeros((count, 3)), np.zeros((count, 3, 3))
        positions = contact.vertex_positions(displacement)
        normals = contact.sampling.averaged(gaps.normals)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)[:, None]
        # Where a tool will be, the vertices that stick to it are to come along.
        pose = (self._next_poses or self.poses)[number]
        return drag.forces(positions, pose, normals, self.multipliers[number])

    def add_tangent(self, body: Body, displacement: Points) -> bool:
        """Add minus the force's derivative to the matrix; return whether other vertices touch."""
        if self._extended is not body:
            for contact in self.contacts:
                contact.sampling.extend_pattern(body)
            self._extended = body
        active = []
        for number, (contact, weight, settled, pressed) in enumerate(
            zip(self.contacts, self._weights, self.settled, self.pressed(displacement), strict=True)
        ):
            gaps, touching = pressed.gaps, pressed.push > 0.0
            active.append(touching)
            normals, axes = gaps.normals, gaps.axes
            across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
            # On the way p may be far too large; bent with the last settled one the tangent stays
            # definite, and with p there once it is settled.
            bend = contact.sampling.spread(np.minimum(pressed.push, settled)) * gaps.curvatures
            bends = -bend[:, None, None] * (across - axes[:, :, None] * axes[:, None, :])
            own = self._dragged(number, displacement, gaps)[1]
            stiff = np.where(touching, weight, 0.0)
            contact.sampling.add_tangent(body, stiff, normals, bends, own)
        changed = len(self._active) != len(active) or any(
            np.any(old != new) for old, new in zip(self._active, active, strict=True)
        )
        self._active = active
        return changed

    def settle(self, displacement: Points) -> None:
        """Store the normal forces at an equilibrium, or near one."""
        self.settled = [pressed.push for pressed in self.pressed(displacement)]

    def bear(self, displacement: Points, forces: Points) -> None:
        """Take the multipliers of vertices in contact from the forces that balance the body.

        Args:
            displacement: Displacement near an equilibrium [m], shape (num_points, 3).
            forces: Forces of the tools there [N], shape (num_points, 3).
        """
        for number, (contact, pressed) in enumerate(
            zip(self.contacts, self.pressed(displacement), strict=True)
        ):
            if contact.tool.contact is ContactRule.VERTICES:
                push = np.sum(forces[contact.vertices] * pressed.gaps.normals, axis=1)
                touches = pressed.gaps.distances < _TOUCHES * np.sqrt(contact.areas)
                self.multipliers[number] = np.where(touches, np.maximum(0.0, push), 0.0)
        self.settle(displacement)

    def keep(self, displacement: Points, poses: list[NDArray[np.void]]) -> None:
        """Accept an equilibrium: store the positions of the surface relative to the tools."""
        self._seen = [
            _in_tool(contact.gaps(displacement, pose), pose)
            for contact, pose in zip(self.contacts, poses, strict=True)
        ]
        for contact, pose, faces, drag in zip(
            self.contacts, poses, self._faces, self._drags, strict=True
        ):
            drag.keep(contact.vertex_positions(displacement), pose)
            if faces is not None:
                faces.keep(contact.sampling.positions(displacement), pose)

    def go_back(self) -> None:
        """Restore friction and the faces of boxes to the last accepted equilibrium."""
        for drag in self._drags:
            drag.go_back()
        for faces in self._faces:
            if faces is not None:
                faces.go_back()

    def why_too_far(
        self, problem: Problem, displacement: Points, before: list[NDArray[np.void]]
    ) -> str:
        """State why the tools moved too far to know on which side vertices came in; else empty."""
        for contact, pose, old, faces, seen, pressed in zip(
            self.contacts, self.poses, before, self._faces, self._seen,
            self.pressed(displacement), strict=True,
        ):  # fmt: skip
            way = float(np.linalg.norm(pose["position"] - old["position"]))
            is_pressed = contact.sampling.spread(pressed.push) > 0.0
            if faces is not None:
                is_long = way > _SHORT_OVER_EDGES * mean_edge(problem, contact.facets)
                if is_long and faces.came_over_edge(is_pressed):
                    return "a vertex came into a box over an edge in a long step"
                continue
            cosines = np.sum(_in_tool(pressed.gaps, pose) * seen, axis=1)
            has_turned = bool((is_pressed & (cosines < _TURNED)).any())
            if has_turned and way > _SHORT_THROUGH * half_thickness(contact.tool.shape):
                return "a vertex went through the tool, or far round it, in a long step"
        return ""

    def move_round_edges(self, displacement: Points) -> tuple[int, bool]:
        """Pass vertices that are pressed beyond the edge of a box's face to the next face.

        Returns:
            How many, and whether one of them went round another edge before.
        """
        count, is_again = 0, False
        pressed = self.pressed(displacement)
        for number, (contact, pose, faces) in enumerate(
            zip(self.contacts, self.poses, self._faces, strict=True)
        ):
            if faces is not None:
                positions = contact.sampling.positions(displacement)
                moves, again = faces.move_round(positions, pose, pressed[number].push > 0.0)
                self.multipliers[number] = np.where(moves, 0.0, self.multipliers[number])
                count, is_again = count + int(moves.sum()), is_again or again
        return count, is_again

    def rounding_error(self, body: Body) -> float:
        """Norm of the error of k A g by rounding of positions in space [N]."""
        touching = [w[a] for w, a in zip(self._weights, self._active, strict=True)]
        size = float(np.linalg.norm(np.concatenate([*touching, np.zeros(0)])))
        return 8.0 * float(np.finfo(float).eps) * float(np.abs(body.mesh.points).max()) * size

    def update_multipliers(self, displacement: Points) -> tuple[float, float]:
        """Multiplier := p; return the norms of the change and of the multipliers [N]."""
        change, size = 0.0, 0.0
        for number, pressed in enumerate(self.pressed(displacement)):
            push = pressed.push
            dragged = self._dragged(number, displacement, pressed.gaps)[0]
            drag_change, drag_size = self._drags[number].update(dragged, self.poses[number])
            change += float(np.sum((push - self.multipliers[number]) ** 2)) + drag_change
            size += float(np.sum(push**2)) + drag_size
            self.multipliers[number] = push
        return float(np.sqrt(change)), float(np.sqrt(size))

    @contextmanager
    def going_to(self, poses: list[NDArray[np.void]]) -> Iterator[None]:
        """Compute gaps at the tools' next poses; at the end the tools are at these.

        Distances are those to where the tools were, less how far each comes along its normal: no
        vertex is ever deep inside, where the nearest side may be the wrong one.
        """
        self._next_poses = poses
        try:
            yield
        finally:
            self._next_poses, self.poses = [], poses


def _in_tool(gaps: Gaps, pose: NDArray[np.void]) -> Points:
    normals: Points = gaps.normals @ pose["rotation"]
    return normals


def _ahead(
    gaps: Gaps, positions: Points, pose: NDArray[np.void], next_pose: NDArray[np.void]
) -> Gaps:
    """Gaps when the tool has gone on to another pose, to first order in its way."""
    turn = next_pose["rotation"] @ pose["rotation"].T
    way = (positions - pose["position"]) @ turn.T + next_pose["position"] - positions
    return replace(gaps, distances=gaps.distances - np.sum(gaps.normals * way, axis=1))


# Coulomb friction of vertices on a tool, in statics: they stick up to a bound, and slide at it.
#
# A vertex carries, along the tool's surface and beside its push p,
#
#     f = f1 where |f1| <= mu p, else mu p f1 / |f1|,      f1 = multiplier - k A slip,
#
# with its slip over the tool since the last equilibrium. Over facets p is of the average gap, and
# the slip is across the average of the normals; averages of positions are the vertex's own.
# Multiplier and p are those of the last update (Alart and Curnier 1991, the bound fixed as in a
# quasi-potential): each Newton solve is then of a potential, and its tangent is symmetric.


class Drag:
    """Friction between one tool and its vertices.

    Args:
        coefficient: Coulomb's [-], >= 0.
        weights: k A of each vertex [N/m], shape (n,).
    """

    def __init__(self, coefficient: float, weights: Floats) -> None:
        self.coefficient = coefficient
        self.weights = weights
        # Both seen from the tool.
        self._multipliers: Points = np.zeros((len(weights), 3))
        self._kept = self._multipliers, self._multipliers

    def keep(self, positions: Points, pose: NDArray[np.void]) -> None:
        """Accept an equilibrium with the vertices at these positions [m]."""
        self._kept = self._multipliers, _seen_from(positions, pose)

    def go_back(self) -> None:
        """Return to the last accepted equilibrium."""
        self._multipliers = self._kept[0]

    def forces(
        self, positions: Points, pose: NDArray[np.void], normals: Points, pushes: Floats
    ) -> tuple[Points, Floats]:
        """Friction on the vertices [N], shape (n, 3), and minus its derivative, (n, 3, 3) [N/m].

        Args:
            positions: Positions of the vertices [m], shape (n, 3).
            pose: Pose of the tool.
            normals: Out of the tool, shape (n, 3).
            pushes: Multipliers of contact, which bound it [N], shape (n,).
        """
        slip = _seen_from(positions, pose) - self._kept[1]
        wanted = (self._multipliers - self.weights[:, None] * slip) @ pose["rotation"].T
        across = np.eye(3) - np.einsum("ni,nj->nij", normals, normals)
        wanted = np.einsum("nij,nj->ni", across, wanted)
        sizes, most = np.linalg.norm(wanted, axis=1), self.coefficient * pushes
        sticks = sizes <= most
        share = np.where(sticks, 1.0, most / np.where(sticks, 1.0, sizes))
        along = np.where(sticks, 0.0, 1.0 / np.where(sticks, 1.0, sizes))[:, None] * wanted
        stiff = across - np.einsum("ni,nj->nij", along, along)
        return share[:, None] * wanted, (share * self.weights)[:, None, None] * stiff

    def update(self, forces: Points, pose: NDArray[np.void]) -> tuple[float, float]:
        """Multipliers := forces [N]; squares of the norms of their change and of them."""
        new = forces @ pose["rotation"]
        change = float(np.sum((new - self._multipliers) ** 2))
        self._multipliers = new
        return change, float(np.sum(new**2))


def _seen_from(positions: Points, pose: NDArray[np.void]) -> Points:
    seen: Points = (positions - pose["position"]) @ pose["rotation"]
    return seen


# Statics beside the edges of a box: each vertex stays on one face until it slides off.
#
# Inside a box the nearest face may be a side that a vertex under the bottom never came by. So a
# vertex that stands before one face is kept outside that face's plane, beyond its edges too, while
# an equilibrium is sought: the force has no jump at the edge, and in Newton's method no vertices
# come and go. A vertex that an equilibrium presses beyond an edge is passed to the face round that
# edge, and the equilibrium is sought again. One that came in over an edge belongs to the face whose
# plane it crossed last.


# Fraction of the smallest half width within which a vertex is at a face or an edge.
_AT = 1e-6


class BoxFaces:
    """The face of a box before which each vertex stands.

    Faces are outward normals in the box's frame; zero is none, over an edge or a corner.

    Args:
        half_widths: Half widths of the box [m].
    """

    def __init__(self, half_widths: tuple[float, float, float]) -> None:
        self._half_widths = np.array(half_widths)
        self._at = _AT * float(self._half_widths.min())
        self._begin = self._faces = self._kept = np.zeros((0, 3))
        self._has_moved = np.zeros(0, dtype=np.bool_)

    def keep(self, positions: Points, pose: NDArray[np.void]) -> None:
        """Accept an equilibrium with the vertices at these positions [m], shape (n, 3)."""
        own = _in_frame(positions, pose)
        heights = np.abs(own) - self._half_widths
        above = (heights > self._at).sum(axis=1)
        at_box = self._by_way(own) if len(self._faces) else self._nearest(own)
        faces = np.where((above == 1)[:, None], self._nearest(own), 0.0)
        self._faces = self._kept = np.where((above == 0)[:, None], at_box, faces)
        self._begin = own
        self._has_moved = np.zeros(len(own), dtype=np.bool_)

    def go_back(self) -> None:
        """To the faces of the last equilibrium."""
        self._faces = self._kept
        self._has_moved = np.zeros(len(self._kept), dtype=np.bool_)

    def from_faces(self, gaps: Gaps, positions: Points, pose: NDArray[np.void]) -> Gaps:
        """Gaps from each vertex's own face, where it has one or is inside the box."""
        if not len(self._faces):
            return gaps
        own = _in_frame(positions, pose)
        inside = (np.abs(own) <= self._half_widths + self._at).all(axis=1)
        faces = self._by_way(own)
        has_face = (self._faces != 0.0).any(axis=1) | inside
        distances = (faces * own).sum(axis=1) - np.abs(faces) @ self._half_widths
        normals = faces @ pose["rotation"].T
        return Gaps(
            np.where(has_face, distances, gaps.distances),
            np.where(has_face[:, None], normals, gaps.normals),
            np.where(has_face, 0.0, gaps.curvatures),
            np.where(has_face[:, None], 0.0, gaps.axes),
        )

    def move_round(
        self, positions: Points, pose: NDArray[np.void], is_pressed: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], bool]:
        """Pass vertices pressed beyond an edge of their face to the face round that edge.

        Returns:
            Which vertices, shape (n,), and whether one of them was passed on before.
        """
        own = _in_frame(positions, pose)
        beside = np.where(self._faces != 0.0, 0.0, np.abs(own) - self._half_widths)
        has_face = (self._faces != 0.0).any(axis=1)
        moves = has_face & is_pressed & (beside.max(axis=1) > self._at)
        round_it = _unit(np.argmax(beside, axis=1)) * np.where(own < 0.0, -1.0, 1.0)
        self._faces = np.where(moves[:, None], round_it, self._faces)
        is_again = bool((moves & self._has_moved).any())
        self._has_moved = self._has_moved | moves
        return moves, is_again

    def came_over_edge(self, is_pressed: NDArray[np.bool_]) -> bool:
        """Whether a pressed vertex stood before no face; only short steps show where it came in."""
        return bool((is_pressed & ~(self._kept != 0.0).any(axis=1)).any())

    def _by_way(self, own: Points) -> Points:
        """A vertex' own face; if it has none, the plane that it crossed last on its way."""
        signs = np.where(self._begin < 0.0, -1.0, 1.0)
        first, last = (signs * x - self._half_widths for x in (self._begin, own))
        crosses = (first > self._at) & (last <= self._at)
        fractions = np.where(crosses, first / np.where(crosses, first - last, 1.0), -1.0)
        entered = _unit(np.argmax(fractions, axis=1)) * signs
        entered = np.where(crosses.any(axis=1)[:, None], entered, self._nearest(own))
        known = (self._faces != 0.0).any(axis=1)
        found: Points = np.where(known[:, None], self._faces, entered)
        return found

    def _nearest(self, own: Points) -> Points:
        nearest = np.argmax(np.abs(own) - self._half_widths, axis=1)
        found: Points = _unit(nearest) * np.where(own < 0.0, -1.0, 1.0)
        return found


def _in_frame(positions: Points, pose: NDArray[np.void]) -> Points:
    own: Points = (positions - pose["position"]) @ pose["rotation"]
    return own


def _unit(axes: NDArray[np.intp]) -> Points:
    units: Points = np.eye(3)[axes]
    return units
