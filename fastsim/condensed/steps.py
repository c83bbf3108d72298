"""The condensed model with rigid tools: steps from poses to forces, and a body to be driven."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.condensed.model import CondensedModel
from palpate.fastsim.condensed.setup import NotCondensableError, UnsettledContactError
from palpate.fastsim.contact.contact_law import (
    ContactForm,
    ContactLaw,
    layer_stiffness,
    mean_edge,
    read_pose,
)
from palpate.fastsim.contact.static_contact import layers_of_penalty
from palpate.fastsim.contact.tool_contact import ToolContact
from palpate.fastsim.live_body import BodySpring, BodyTool
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import BoxShape, RigidTool, rotation_matrix

# What is nearer than this fraction of an edge is checked from the start of a step.
_REACH = 0.1


class StepState(NamedTuple):
    """An equilibrium with tools.

    Attributes:
        displacement: Displacement of the model's seen points [m], shape (num_seen, 3).
        forces: On each tool [N], shape (num_tools, 3).
        moments: On each tool about its origin [N m], shape (num_tools, 3).
        touching: Vertices that tools push; of a penalty over facets, points.
        iterations: Newton iterations.
    """

    displacement: Points
    forces: Floats
    moments: Floats
    touching: int
    iterations: int


def require_known_tool(tool: RigidTool, number: int) -> None:
    """Refuse a tool that the condensed model cannot pose, with the reason.

    Raises:
        NotCondensableError: A box, friction, or a tool driven by a force.
    """
    reason = ""
    if isinstance(tool.shape, BoxShape):
        # Statics keep each vertex on one face, and let it pass an edge by steps of their own.
        reason = "is a box, over whose sharp edges vertices jump; give a capsule or a surface"
    elif tool.friction_coefficient > 0.0:
        reason = "has friction, which the condensed model does not know; solve by statics"
    elif tool.drive is not None:
        reason = "is driven by a force; give it a path, or solve by statics"
    if reason:
        raise NotCondensableError(f"tool {number} {reason}")


class CondensedSteps:
    """A condensed body under rigid tools at any given poses, without inertia.

    Columns of the compliance at 64 points, or as many as are touched at a time, are cached beside
    the model: each 72 bytes for a seen point, 36 in single precision (9 MB for 2 000 of them).

    Args:
        model: The body.
        tools: Their shapes, and the facets that they may touch; their paths are not read. None is
            the problem's tools.
        law: How contact is enforced: None is the constraint, as in statics; with a penalty its
            stiffness, or the same default.
        relative_tolerance: Of gaps and displacements at vertices beside tools, over the largest
            displacement there.
        max_iterations: Newton iterations of a step.

    Attributes:
        base: Displacement of the seen points without contact [m], shape (num_seen, 3).

    Raises:
        NotCondensableError: A box, a tool with friction or driven by a force, or one that may
            touch points that are not `touched` ones of the model.

    >>> import numpy as np
    >>> import palpate
    >>> from palpate.fastsim.condensed import CondensedSteps, condense
    >>> problem = palpate.load_case("press").problem
    >>> steps = CondensedSteps(condense(problem))
    >>> position, rotation = problem.tools[0].path.pose_at(1.0)
    >>> state = steps.step([(position, rotation)])
    >>> bool(state.forces[0, 2] > 0.0), state.displacement.shape == (len(steps.model.seen), 3)
    (True, True)
    """

    def __init__(
        self,
        model: CondensedModel,
        tools: Sequence[RigidTool] | None = None,
        *,
        law: ContactLaw | None = None,
        relative_tolerance: float = 1e-10,
        max_iterations: int = 50,
    ) -> None:
        self.model = model
        self.tools = tuple(model.problem.tools if tools is None else tools)
        self._law = law or ContactLaw()
        self._tolerance, self._most = relative_tolerance, max_iterations
        self._core, self.stiffnesses = self._build()
        self._poses = np.zeros((len(self.tools), 12))
        self.base = model.displacement()

    def set_base(
        self,
        forces: ArrayLike | None = None,
        *,
        load_factor: float = 1.0,
        support_factors: float | Sequence[float] = 1.0,
        anchors: ArrayLike | None = None,
    ) -> None:
        """Set what acts besides the tools, from the next step on.

        Args:
            forces: On the touched points [N], shape (num_touched, 3); None is none.
            load_factor: Factor of the problem's loads.
            support_factors: Factor of the full size of all supports, or one for each.
            anchors: Displacements of the springs' anchors [m], shape (num_springs, 3); None is
                the end of their paths.

        Raises:
            InputError: Another shape, or a number that is not finite.
        """
        self.base = self.model.displacement(
            forces, load_factor=load_factor, support_factors=support_factors, anchors=anchors
        )

    def step(self, poses: Sequence[tuple[ArrayLike, ArrayLike]] | Floats) -> StepState:
        """Equilibrium with the tools at these poses, from that of the last step.

        Args:
            poses: For each tool position [m], shape (3,), and rotation matrix, shape (3, 3); or
                both in a row, shape (num_tools, 12).

        Raises:
            UnsettledContactError: Contact did not settle; the body stays as it was.
            InputError: Another number of poses, or one that is not finite.
        """
        rows = self._rows(poses)
        outcome = self._core.step(rows, self.base, self._tolerance, self._most)
        if not outcome.is_settled:
            raise UnsettledContactError(outcome.iterations, outcome.error)
        loads = self._core.loads()
        displacement = self._core.response()
        displacement += self.base
        return StepState(
            displacement, loads[:, :3], loads[:, 3:], outcome.touching, outcome.iterations
        )

    def clear(self) -> None:
        """Forget all contact, as if the tools were away."""
        self._core.clear()

    @property
    def contact_forces(self) -> Points:
        """Forces of tools on the touched points in the last step [N], shape (num_touched, 3)."""
        return self._core.forces()

    def _rows(self, poses: Sequence[tuple[ArrayLike, ArrayLike]] | Floats) -> Floats:
        rows = self._poses
        if isinstance(poses, np.ndarray) and poses.shape == rows.shape:
            rows[...] = poses
        elif len(poses) == len(self.tools):
            for row, (position, rotation) in zip(rows, poses, strict=True):
                row[:3], row[3:] = position, np.ravel(np.asarray(rotation, dtype=np.float64))
        else:
            raise InputError(f"{len(poses)} poses for {len(self.tools)} tools: give one for each")
        if not np.isfinite(rows).all():
            raise InputError("a pose of a tool is NaN or infinite")
        return rows

    def _build(self) -> tuple[_core.CondensedContact, tuple[float, ...]]:
        model, problem = self.model, self.model.problem
        row_of = np.full(problem.mesh.num_points, -1, dtype=np.int32)
        row_of[model.touched] = np.arange(len(model.touched))
        is_penalty = self._law.form is ContactForm.PENALTY
        shapes, stiffnesses, reach = [], [], 0.0
        for number, tool in enumerate(self.tools, start=1):
            require_known_tool(tool, number)
            contact = ToolContact(problem, tool, is_penalty=is_penalty)
            unknown = contact.vertices[row_of[contact.vertices] < 0]
            if len(unknown):
                raise NotCondensableError(
                    f"tool {number} may touch point {unknown[0]}, of which the model knows no "
                    "compliance; name it among `touched`, or give the tool contact_facets"
                )
            _require_resting_corners(problem, contact, number)
            layers = layers_of_penalty(tool) * layer_stiffness(problem, contact.facets)
            stiffness = self._law.stiffness or layers
            reach = max(reach, _REACH * mean_edge(problem, contact.facets))
            stiffnesses.append(stiffness)
            shapes.append(_core_tool(contact, stiffness, row_of))
        rest = np.array(problem.mesh.points[model.touched])
        core = _core.CondensedContact(model.compliance, rest, shapes, is_penalty, reach)
        return core, tuple(stiffnesses)


def _require_resting_corners(problem: Problem, contact: ToolContact, number: int) -> None:
    """Refuse facets of which a corner, that is no touched point, is moved by a support."""
    corners = np.unique(contact.sampling.patches)
    fixed = corners[~np.isin(corners, contact.vertices)]
    moved = FixedPoints(problem).at(1.0)[fixed]
    if moved.any():
        raise NotCondensableError(
            f"tool {number} may touch facets with point {fixed[moved.any(axis=1)][0]}, which a "
            "support moves; give the tool contact_facets without it, or solve by statics"
        )


def _core_tool(
    contact: ToolContact, stiffness: float, row_of: NDArray[np.int32]
) -> _core.CondensedTool:
    sampling = contact.sampling
    rest = np.ascontiguousarray(sampling.rest_corners)
    edges = rest - np.roll(rest, 1, axis=1)
    # A facet under a tool is stretched, by far less than to twice its size.
    spread = 2.0 * float(np.linalg.norm(edges, axis=2).max(initial=0.0))
    corners = row_of[sampling.patches]
    constraints = sampling.constraints
    centres = np.zeros(len(sampling.areas), dtype=np.int32)
    if constraints.shape == corners.shape:
        centres[constraints[constraints >= 0]] = corners[constraints >= 0]
    else:
        centres[constraints] = corners.max(axis=1)[:, None]
    return _core.CondensedTool(
        contact.shape,
        stiffness,
        areas=np.ascontiguousarray(sampling.areas),
        centres=centres,
        spread=spread,
        num_corners=corners.shape[1],
        corners=np.ascontiguousarray(corners.reshape(-1)),
        rest=rest.reshape(-1, 3),
        constraints=np.ascontiguousarray(constraints.reshape(-1)),
        shares=np.ascontiguousarray(sampling.shares.reshape(-1)),
        shape_functions=np.ascontiguousarray(sampling.shape_functions.reshape(-1)),
    )


class CondensedBodyTool(BodyTool):
    """A rigid tool of a `CondensedBody`, which reports its moment as well."""

    _body: CondensedBody

    @property
    def moment(self) -> Floats:
        """Moment of the body on the tool about its origin in the last step [N m], shape (3,)."""
        moment: Floats = self._body._moments[self._number]
        return moment


class CondensedBody:
    """A condensed body that is stepped: each step is an equilibrium with the tools where they are.

    A viewer draws `facets` at `positions`; a controller or a haptic device reads the tools'
    `force`. There is no time, no inertia and no limit on speed; where contact does not settle in a
    step, everything stays as it was and the tools may be sent elsewhere.

    Args:
        model: Made by `condense`. Its problem's tools begin where their paths do, the anchors of
            its springs at rest, whatever their paths are.

    Attributes:
        model: The condensed model.
        tools: In the problem's order.
        springs: In the problem's order.
        points: Numbers of the seen points in the mesh, shape (num_seen,).
        touching: Vertices that tools push; of a penalty over facets, points.
        facets: Boundary facets all of whose points are seen, counted among `points`, shape (m, 3).

    Raises:
        NotCondensableError: A tool that `CondensedSteps` refuses.

    >>> import palpate
    >>> from palpate.fastsim.condensed import CondensedBody, condense
    >>> body = CondensedBody(condense(palpate.load_case("press").problem))
    >>> (ball,) = body.tools
    >>> ball.move_to(ball.position - [0.0, 0.0, 1e-3])
    >>> body.step()
    >>> bool(ball.force[2] > 0.0), body.positions.shape == (len(body.points), 3)
    (True, True)
    """

    def __init__(self, model: CondensedModel) -> None:
        problem = model.problem
        self.model, self.points = model, model.seen
        self._steps = CondensedSteps(model)
        self.tools = tuple(CondensedBodyTool(self, k, tool) for k, tool in enumerate(problem.tools))
        self.springs = tuple(BodySpring(self, spring) for spring in problem.springs)
        row_of = np.full(problem.mesh.num_points, -1, dtype=np.int32)
        row_of[model.seen] = np.arange(len(model.seen))
        facets = row_of[problem.mesh.boundary_facets]
        self.facets: Indices = facets[(facets >= 0).all(axis=1)]
        self._patches = PatchSprings(problem.mesh.points, problem.springs)
        self._sees = [bool((row_of[s.facets] >= 0).all()) for s in problem.springs]
        self._rest = np.array(problem.mesh.points[model.seen])
        self._positions, self._displacement = self._rest.copy(), np.zeros_like(self._rest)
        self._shown = self._positions.view()
        self._moved = self._displacement.view()
        self._shown.flags.writeable = self._moved.flags.writeable = False
        self._poses = np.zeros((len(self.tools), 12))
        self._goals, self._anchors = self._poses.copy(), np.zeros((len(self.springs), 3))
        self._is_pulled = True
        self.reset()

    def step(self) -> None:
        """Equilibrium with tools and anchors where they were sent.

        Raises:
            UnsettledContactError: Contact did not settle; the body stays as it was.
        """
        if self._is_pulled:
            self._steps.set_base(anchors=self._anchors)
            self._is_pulled = False
        state = self._steps.step(self._goals)
        self._poses[...] = self._goals
        self._forces, self._moments = state.forces, state.moments
        self._displacement[...] = state.displacement
        np.add(self._rest, self._displacement, out=self._positions)
        self.touching = state.touching

    def reset(self) -> None:
        """Begin anew: tools at the beginning of their paths, anchors at rest, then a step."""
        for row, tool in zip(self._goals, self.tools, strict=True):
            path = tool.description.path
            position, rotation = path.pose_at(float(path.times[0]))
            row[:3], row[3:] = position, rotation.ravel()
        self._anchors[...] = 0.0
        self._is_pulled = True
        self._steps.clear()
        self.step()

    @property
    def contact_forces(self) -> Points:
        """Forces of tools on the touched points in the last step [N], shape (num_touched, 3)."""
        return self._steps.contact_forces

    @property
    def displacement(self) -> Points:
        """Displacement of `points` [m], shape (num_seen, 3): read-only, always the same array."""
        return self._moved

    @property
    def positions(self) -> Points:
        """Positions of `points` [m], shape (num_seen, 3): read-only, always the same array."""
        return self._shown

    def _send_tool(self, number: int, position: ArrayLike, rotation: ArrayLike | None) -> None:
        origin, turn = read_pose(number, position, rotation)
        row = self._goals[number]
        if turn is not None:
            row[3:] = rotation_matrix(np.array(turn)).ravel()
        row[:3] = origin

    def _tool_pose(self, number: int) -> tuple[Floats, Floats]:
        return self._poses[number, :3], self._poses[number, 3:]

    def _tool_force(self, number: int) -> Floats:
        force: Floats = self._forces[number]
        return force

    def _send_anchor(self, spring: BodySpring, position: Floats) -> None:
        self._anchors[self.springs.index(spring)] = position
        self._is_pulled = True

    def _spring_force(self, spring: BodySpring) -> Floats:
        number = self.springs.index(spring)
        if not self._sees[number]:
            raise NotCondensableError(
                f"the model does not see all points of spring {number + 1}; name them among `seen`"
            )
        moved = np.zeros_like(self.model.problem.mesh.points)
        moved[self.points] = self._displacement
        full = np.ones(len(self.springs))
        pull: Floats = self._patches.resultants(moved, self._anchors, full)[number]
        return -pull
