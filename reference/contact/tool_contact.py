"""Contact with a rigid tool by the augmented Lagrangian, with Coulomb friction.

With the gap g_i of the deformed surface from the tool at every constraint i (`contact_points`), and
a multiplier p_i per rest area a_i:

    t_i = max(0, p_i - k g_i),   virtual work on the body = sum over constraints of a_i t_i dg_i

an Uzawa step sets p = t at equilibrium, until the forces no longer change; then g >= 0, t >= 0,
t g = 0 at the constraints. J. C. Simo, T. A. Laursen, "An augmented Lagrangian treatment of contact
problems involving friction", Computers & Structures 42 (1992); P. Wriggers, Computational Contact
Mechanics, 2nd ed. 2006, section 6.3.3. With p = 0 it is the penalty method.

With the normal n and the curvature H of the distance at points q, minus the derivative of the
nodal forces is sum_i a_i k dg_i dg_i over the active constraints less sum_q (sum_i a_i t_i c_qi) H.

Degrees 2 and 3 have contact at nodes whatever rule a tool has: they approximate the continuum, of
which the rule is no part, and their shape functions of vertices have no area.

Friction is in `friction`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import BoxShape, ContactRule, RigidTool, ToolError
from palpate.reference import fenicsx
from palpate.reference.contact.contact_points import ContactPoints, find_contact_points
from palpate.reference.contact.friction import Drag, Friction, no_drag
from palpate.reference.contact.tool_distance import ContactFaces, Distance, tool_distance
from palpate.reference.fenicsx import all_rows
from palpate.reference.mesh_transfer import TransferredSpace

# Penalty times the facet size over Young's modulus: an Uzawa step leaves about a hundredth of the
# penetration, and the condition number of the tangent grows by about a hundred at most.
_STIFFNESS_RATIO = 100.0
# Nodes of another simulator's solution are in contact nearer than this, in units of facet size.
_TOUCHES = 0.02
# Rounding error of a distance, in units of the coordinates' own.
_ROUNDINGS = 16.0
# Far from equilibrium, and over facets, pressures enter the curvature's part of the tangent up to
# this times Young's modulus, or their multiplier: k times the depth of a whole step would make it
# indefinite, and Newton's steps short. Below it the tangent is consistent.
_MOST_CURVED = 0.1
# Penalty of friction over that of contact in motion: the sticking part of the surface changes from
# step to step, and a larger penalty slows Newton's method at every node that begins to slip.
_SOFT_DRAG = 0.1


@dataclass(frozen=True, eq=False)
class ToolState:
    """The force and moment on a tool at an equilibrium.

    Attributes:
        force: On the tool [N], shape (3,).
        moment: On the tool about its origin [N m], shape (3,).
        active_area: Rest area of the constraints that press on it [m2].
        penetration: Largest depth of a contact point inside the tool [m], >= 0; over facets, whose
            gaps are averages, it is not near 0.
    """

    force: Floats
    moment: Floats
    active_area: float
    penetration: float


# Relative residual of the motion along a tool's normals, and iterations for it: one at nodes.
_MET, _MOST_ITERATIONS = 1e-14, 200


@dataclass(frozen=True, eq=False)
class TouchingSurface:
    """The surface that moves with a tool along its normal or, where it sticks, in all directions.

    Attributes:
        points: The contact points, p of them.
        is_active: Which constraints press, shape (n,).
        normals: Normals of the tool at the points [-], shape (p, 3).
        velocities: Velocities of the tool there, mean over the last step [m/s], shape (p, 3).
        sticks: Which of the active constraints stick, shape (n,).
    """

    points: ContactPoints
    is_active: NDArray[np.bool_]
    normals: Points
    velocities: Points
    sticks: NDArray[np.bool_]

    def change(self, field: Points, wanted: Points) -> Points:
        """Smallest change of a field by which the surface has the tool's values, averaged as gaps.

        Args:
            field: Velocity or acceleration, shape (num_blocks, 3).
            wanted: Velocity or acceleration of the tool at the points, shape (p, 3).
        """
        own = self.points.values(field.ravel())
        along = np.sum(wanted * self.normals, axis=1) - np.sum(own * self.normals, axis=1)
        return self._least(self._averaged(along, wanted - own), field.size).reshape(-1, 3)

    @cached_property
    def _across(self) -> Floats:
        """Two unit vectors across the normal of each constraint that sticks, shape (k, 2, 3).

        Not a projection, along whose normals conjugate gradients would divide rounding by rounding.
        """
        normals = self.points.normals(self.normals)[self.sticks]
        two: Floats = np.linalg.svd(normals[:, None, :])[2][:, 1:]
        return two

    def _averaged(self, along: Floats, vectors: Points) -> Floats:
        """Averages of values along the normals at the points, and of vectors across them.

        Returns:
            The first of the n constraints, 0 where not active, then the others of the k that
            stick, shape (n + 2 k,).
        """
        normal = np.where(self.is_active, self.points.gaps(along), 0.0)
        if not self.sticks.any():
            return normal
        across = np.einsum("kij,kj->ki", self._across, self.points.averages(vectors)[self.sticks])
        return np.concatenate([normal, across.ravel()])

    def _least(self, rest: Floats, size: int) -> Floats:
        """Smallest flat vector with such averages.

        By conjugate gradients for its multipliers, whose matrix is nearly the identity: each dual
        constraint has its own vertex.
        """
        found, way = np.zeros(size), rest
        enough = _MET**2 * float(rest @ rest)
        for _ in range(_MOST_ITERATIONS):
            before = float(rest @ rest)
            if before <= enough:
                break
            step = self._spread(way, size)
            values = self.points.values(step)
            image = self._averaged(np.sum(values * self.normals, axis=1), values)
            length = before / float(way @ image)
            found, rest = found + length * step, rest - length * image
            way = rest + float(rest @ rest) / before * way
        return found

    def _spread(self, multipliers: Floats, size: int) -> Floats:
        count = len(self.is_active)
        areas = np.where(self.is_active, self.points.areas, np.inf)
        loads = self.points.loads(multipliers[:count] / areas)[:, None] * self.normals
        if self.sticks.any():
            across = np.zeros((count, 3))
            along = multipliers[count:].reshape(-1, 2)
            across[self.sticks] = np.einsum("kij,ki->kj", self._across, along)
            loads = loads + self.points.spread(across / areas[:, None])
        return self.points.at_nodes(loads, size)


class ToolContact:
    """Contact of the body with one tool.

    Args:
        space: Displacement space.
        tool: Shape and path of the tool.
        fixed: Degrees of freedom of the displacement that are fixed, shape (n,).
        youngs_modulus: Largest Young's modulus of the body [Pa].
        numbers: Indices of displacements among all unknowns, see `find_contact_points`.
        num_dofs: Number of all unknowns that this rank owns.

    Attributes:
        is_averaged: Whether gaps are averages over facets.
        is_near: Whether the body is near an equilibrium.

    Raises:
        InputError: Contact facets are inside the body.
        ToolError: Contact over facets where it is not modelled, see `contact_rule`.
    """

    def __init__(
        self,
        space: TransferredSpace,
        tool: RigidTool,
        fixed: Indices,
        youngs_modulus: float,
        numbers: Indices | None,
        num_dofs: int,
    ) -> None:
        self.tool = tool
        self.source_points = space.transferred.source.points
        rule = contact_rule(tool, space.degree)
        self.points = find_contact_points(space, tool.contact_facets, fixed, numbers, rule)
        self.is_averaged = rule is ContactRule.FACETS
        self._most_curved = _MOST_CURVED * youngs_modulus
        self._num_dofs = num_dofs
        self._at_rest = _STIFFNESS_RATIO * youngs_modulus / self.points.facet_size
        # A tool that just touches the body must not press on it by rounding errors.
        size = np.abs(space.transferred.source.points).max() + np.abs(tool.path.positions).max()
        self._rounding = _ROUNDINGS * float(np.finfo(float).eps * size)
        shape = tool.shape
        self._faces = ContactFaces(shape.half_widths) if isinstance(shape, BoxShape) else None
        self._friction = Friction(tool.friction_coefficient, len(self.points.areas))
        self.is_near = True
        self._drag_part = 1.0
        self._way = np.zeros(3)
        self.begin()
        self.require_known_shape()

    def begin(self) -> None:
        """Move the tool to the beginning of its path, with multipliers of zero."""
        self.weigh(1.0)
        self.set_time(float(self.tool.path.times[0]))
        self.pressure = np.zeros(len(self.points.areas))
        self.keep(np.zeros(self._num_dofs))

    def require_known_shape(self) -> None:
        """Raise InputError where the distance to the tool cannot be measured."""
        self._distance(np.zeros(self._num_dofs))

    def touching(self, displacement: Floats, dt: float) -> TouchingSurface:
        """The surface that moves with the tool at the end of a step of dt [s]."""
        distance = self._distance(displacement)
        is_active = self.points.areas * self._tractions(distance) > 0.0
        sticks = is_active & self._dragged(displacement, distance).sticks
        positions = self.points.positions(displacement)
        before, turned = self.tool.path.pose_at(self.time - dt)
        local = (positions - self.position) @ self.rotation
        velocity = (positions - before - local @ turned.T) / dt
        return TouchingSurface(self.points, is_active, distance.normal, velocity, sticks)

    @property
    def forgets_its_way(self) -> bool:
        """Whether equilibrium with the tool is independent of its path.

        It is not with friction, nor for a box, whose faces depend on where nodes entered, nor for a
        tool driven by a force, whose position is unknown.
        """
        tool = self.tool
        is_bound = tool.friction_coefficient > 0.0 or tool.drive is not None
        return self._faces is None and not is_bound

    def set_time(self, time: float) -> None:
        """Move the tool to its pose at a time of its path [s]."""
        self.time = time
        position, self.rotation = self.tool.path.pose_at(time)
        self.position = position + self._way

    def move(self, way: float) -> None:
        """Move a tool that is driven by a force to a distance along its line [m]."""
        assert self.tool.drive is not None
        self._way = way * np.array(self.tool.drive.direction)
        self.set_time(self.time)

    def go_on_from(self, other: ToolContact) -> None:
        """Take the multipliers at the nearest points of the same tool's contact on another mesh."""
        known = np.flatnonzero(other.points.areas > 0.0)
        there = all_rows(other.points.rest[known])
        pressure = all_rows(other.pressure[known])
        if len(there) == 0:
            return
        arms = (there - rest for rest in self.points.rest)
        nearest = [int(np.argmin(np.einsum("ij,ij->i", arm, arm))) for arm in arms]
        self.pressure = pressure[nearest]

    def bear(self, displacement: Floats, forces: Floats) -> None:
        """Set the multipliers of nodes in contact to given nodal forces.

        Args:
            displacement: Displacement near an equilibrium, flat [m].
            forces: Forces of the tool on the nodes at equilibrium [N], flat.
        """
        distance = self._distance(displacement)
        # Where the normal is constant a dual constraint gives forces to its own node alone.
        normal = self.points.averages(distance.normal)
        pushed = np.sum(forces.reshape(-1, 3)[self.points.nodes] * normal, axis=1)
        touches = self.points.gaps(distance.gap) < _TOUCHES * self.points.facet_size
        with_area = np.where(self.points.areas > 0.0, self.points.areas, np.inf)
        self.pressure = np.where(touches, np.maximum(0.0, pushed) / with_area, 0.0)

    def weigh(self, factor: float) -> None:
        """Set the penalty to a multiple of that of statics."""
        self._penalty = factor * self._at_rest

    def least_gap(self, displacement: Floats) -> float:
        """Smallest distance of points and constraints from the tool [m], below 0 inside it."""
        gap = self._distance(displacement).gap
        least = min(float(gaps.min(initial=np.inf)) for gaps in (gap, self.points.gaps(gap)))
        return fenicsx.smallest(least)

    def clearance(self, displacement: Floats) -> float:
        """The same, 0 where one touches it."""
        return max(0.0, self.least_gap(displacement))

    def stiffen(self, inertia: float) -> None:
        """Raise the penalties to balance the inertia in a time step, which dominates short steps.

        Args:
            inertia: Density of the body over the square of the time step [kg/(m3 s2)].
        """
        self._penalty = self._at_rest + _STIFFNESS_RATIO * inertia * self.points.facet_size
        self._drag_part = _SOFT_DRAG

    def keep(self, displacement: Floats) -> None:
        """Accept an equilibrium: store its multipliers and the positions of the nodes."""
        self._kept = self.pressure
        self._friction.keep(self.points.averages(self._local(displacement)))
        if self._faces is not None:
            self._faces.keep(self._local(displacement))

    def go_back(self) -> None:
        """Begin anew from the last accepted equilibrium."""
        self.pressure = self._kept
        self._friction.go_back()
        if self._faces is not None:
            self._faces.go_back()

    def let_go(self, displacement: Floats) -> tuple[int, bool]:
        """Release nodes that an equilibrium presses on a face of a box from which they have slid.

        Returns:
            Their number, and whether one of them had already slid off another face.
        """
        if self._faces is None:
            return 0, False
        # A box has contact at nodes, each of which is a point and a constraint.
        pressed = self._tractions(self._distance(displacement)) > 0.0
        off, again = self._faces.let_go(self._local(displacement), pressed)
        self.pressure = np.where(off, 0.0, self.pressure)
        self._friction.let_go(off)
        return fenicsx.total(int(off.sum())), fenicsx.total(int(again)) > 0

    def _local(self, displacement: Floats) -> Points:
        local: Points = (self.points.positions(displacement) - self.position) @ self.rotation
        return local

    def _distance(self, displacement: Floats) -> Distance:
        positions, faces = self.points.positions(displacement), self._faces
        came_from = None if faces is None else faces.came_from
        found = tool_distance(self.tool.shape, self.position, self.rotation, positions, came_from)
        if faces is not None and came_from is not None:
            has_plane, gap, normal = faces.planes(self._local(displacement))
            found = Distance(
                np.where(has_plane, gap, found.gap),
                np.where(has_plane[:, None], normal @ self.rotation.T, found.normal),
                np.where(has_plane[:, None, None], 0.0, found.curvature),
            )
        return dataclasses.replace(found, gap=found.gap + self._rounding)

    def _tractions(self, distance: Distance) -> Floats:
        """Pressures at the constraints per rest area [Pa], shape (n,)."""
        gaps = self.points.gaps(distance.gap)
        tractions: Floats = np.maximum(0.0, self.pressure - self._penalty * gaps)
        return tractions

    def _dragged(self, displacement: Floats, distance: Distance) -> Drag:
        if self._friction.coefficient == 0.0:
            return no_drag(len(self.points.areas))
        local = self.points.averages(self._local(displacement))
        normal, penalty = self.points.normals(distance.normal), self._drag_part * self._penalty
        return self._friction.drag(local, self.rotation, normal, self.pressure, penalty)

    def _point_forces(self, pressures: Floats, normals: Points, drag: Points) -> Points:
        """Forces on the body at the points [N], shape (m q, 3).

        Args:
            pressures: At the constraints [Pa], shape (n,).
            normals: Of the tool at the points [-], shape (m q, 3).
            drag: Friction of the constraints per rest area [Pa], shape (n, 3).
        """
        along: Points = self.points.loads(pressures)[:, None] * normals
        return along + self.points.spread(drag) if drag.any() else along

    def _forces_at(self, displacement: Floats) -> Points:
        distance = self._distance(displacement)
        drag = self._dragged(displacement, distance).traction
        return self._point_forces(self._tractions(distance), distance.normal, drag)

    def force(self, displacement: Floats) -> Floats:
        """Nodal forces on the body [N], flat."""
        return self.points.at_nodes(self._forces_at(displacement), self._num_dofs)

    def add_tangent(self, matrix: Any, displacement: Floats) -> None:
        """Add -d(force)/du to a PETSc matrix with room for it (see `reached`)."""
        distance = self._distance(displacement)
        stiffness, dragged, is_active = self._stiffness(displacement, distance)
        dofs, gradients = self.points.gradients(distance.normal)
        for i in np.flatnonzero(is_active).tolist():
            row = gradients[i]
            block = self._penalty * self.points.areas[i] * np.outer(row, row)
            matrix.setValuesLocal(dofs[i], dofs[i], block, addv=True)
        blocks = self.points.blocks(stiffness)
        for m in np.flatnonzero(blocks.any(axis=(1, 2))).tolist():
            own = self.points.dofs[m].ravel()
            matrix.setValuesLocal(own, own, blocks[m], addv=True)
        for i in np.flatnonzero(dragged.any(axis=(1, 2))).tolist():
            own = self.points.own_dofs[i]
            matrix.setValuesLocal(own, own, dragged[i], addv=True)
        matrix.assemble()

    @property
    def reached(self) -> list[Indices]:
        """Groups of unknowns between which `add_tangent` has entries; those of a cell are left out.

        A constraint over facets couples vertices that have no cell in common.
        """
        return self.points.reached() if self.is_averaged else []

    def derivative_of_force(self, displacement: Floats, direction: Floats) -> Floats:
        """Derivative of the force on the tool along a unit vector, by displacement, flat [N/m]."""
        distance = self._distance(displacement)
        stiffness, dragged, is_active = self._stiffness(displacement, distance)
        # The tangent is symmetric: the change of the nodal forces as all points move along it.
        rates = np.where(is_active, self.points.gaps(distance.normal @ direction), 0.0)
        changes = self.points.loads(self._penalty * rates)[:, None] * distance.normal
        change = self.points.at_nodes(changes + stiffness @ direction, self._num_dofs)
        change[self.points.own_dofs] += dragged @ direction
        return change

    def pressed_dofs(self, displacement: Floats) -> Indices:
        """Displacements of the nodes whose constraints press on the tool, shape (n, 3)."""
        pressed = self.points.areas * self._tractions(self._distance(displacement)) > 0.0
        return self.points.dofs[np.isin(self.points.constraints, np.flatnonzero(pressed))]

    def _stiffness(
        self, displacement: Floats, distance: Distance
    ) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Minus the derivative of the forces, less the part of the gaps' penalty.

        Returns:
            The curvature's part at the points [N/m], that of friction at the constraints' nodes
            [N/m], and which constraints are active.
        """
        tractions, areas = self._tractions(distance), self.points.areas
        curved = tractions
        if self.is_averaged or not self.is_near:
            curved = np.minimum(tractions, np.maximum(self.pressure, self._most_curved))
        stiffness = -self.points.loads(curved)[:, None, None] * distance.curvature
        # What has just lost contact has friction until its multiplier is updated.
        is_dragged = tractions + self._friction.coefficient * self.pressure > 0.0
        dragged = np.where(is_dragged, areas, 0.0)[:, None, None]
        dragged = dragged * self._dragged(displacement, distance).stiffness
        return stiffness, dragged, areas * tractions > 0.0

    def rounding_error(self, displacement: Floats) -> float:
        """Largest norm of the nodal forces due to rounding of the gaps [N].

        A large round tool that barely touches has gaps far below the rounding of its coordinates.
        """
        touching = self._tractions(self._distance(displacement)) > 0.0
        return self._rounding * self._penalty * fenicsx.norm(self.points.areas[touching])

    def augment(self, displacement: Floats, *, enough: float = 0.0) -> tuple[float, float]:
        """Set the multipliers to the tractions at an equilibrium.

        Args:
            displacement: Displacement at equilibrium, flat [m].
            enough: Fraction of the forces below which a change is not made [-].

        Returns:
            The norm of the change of the nodal forces of the multipliers alone, and the norm of
            these forces [N]: without a change the penalty has no effect any more.
        """
        distance = self._distance(displacement)
        tractions = self._tractions(distance)
        drag = self._dragged(displacement, distance).traction
        carried = self._friction.carried(self.rotation)
        before, after = (
            self.points.at_nodes(self._point_forces(p, distance.normal, q), self._num_dofs)
            for p, q in ((self.pressure, carried), (tractions, drag))
        )
        change, size = fenicsx.norm(after - before), fenicsx.norm(after)
        if change > enough * size:
            self.pressure = tractions
            self._friction.take_over(drag, self.rotation)
        return change, size

    def state(self, displacement: Floats) -> ToolState:
        """Force and moment on the tool."""
        distance = self._distance(displacement)
        tractions = self._tractions(distance)
        forces = -self._forces_at(displacement)
        arms = self.points.positions(displacement) - self.position
        return ToolState(
            force=fenicsx.total(forces.sum(axis=0)),
            moment=fenicsx.total(np.cross(arms, forces).sum(axis=0)),
            active_area=fenicsx.total(float(self.points.areas[tractions > 0.0].sum())),
            penetration=max(0.0, fenicsx.largest(float(-distance.gap.min(initial=0.0)))),
        )


def contact_rule(tool: RigidTool, degree: int) -> ContactRule:
    """Where a displacement of a degree is kept out of a tool; VERTICES stands for nodes.

    Raises:
        ToolError: Contact over facets with a box, or on several ranks.
    """
    if degree > 1 or tool.contact is ContactRule.VERTICES:
        return ContactRule.VERTICES
    refused = ""
    if isinstance(tool.shape, BoxShape):
        # Averages across its edges store twice the energy that is put in, and push sideways.
        refused = "and is a box, whose edges averages blur: take another shape"
    elif fenicsx.COMM.size > 1:
        refused = f"and the mesh is spread over {fenicsx.COMM.size} ranks: take one rank"
    if refused:
        raise ToolError(f'a tool has contact = "facets" {refused}, or contact = "vertices"')
    return ContactRule.FACETS


def require_outside(gaps: Sequence[float], are_averaged: Sequence[bool]) -> None:
    """Raise InputError where a tool is in the body at the start; the least gap of each [m].

    Averages over facets are below 0 before a round tool is in.
    """
    for number, (gap, is_averaged) in enumerate(zip(gaps, are_averaged, strict=True), start=1):
        if gap < 0.0:
            deep = f"tool {number} is {-gap:g} m deep in the body at the start"
            over = ", by the average over a facet" if is_averaged else ""
            raise InputError(f"{deep}{over}; begin its path outside")


def create_contacts(
    problem: Problem,
    space: TransferredSpace,
    fixed: Indices,
    numbers: Indices | None = None,
    num_dofs: int | None = None,
) -> tuple[ToolContact, ...]:
    """Contacts of the body with every tool of a problem; for arguments see `ToolContact`."""
    stiffest = max(
        m.youngs_modulus for m in (problem.material, *(i.material for i in problem.inclusions))
    )
    num_dofs = 3 * space.num_blocks if num_dofs is None else num_dofs
    return tuple(
        ToolContact(space, tool, fixed, stiffest, numbers, num_dofs) for tool in problem.tools
    )
