"""A condensed body in the hands of a controller or a viewer: `LiveBody` without inertia.

body = CondensedBody(condense(problem))
while ...:  # 1 000 times a second
    body.tools[0].move_to(place)
    body.step()
    force = body.tools[0].force
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.condensed.setup import NotCondensableError
from palpate.fastsim.condensed.model import CondensedModel
from palpate.fastsim.condensed.steps import CondensedSteps
from palpate.fastsim.contact.contact_law import read_numbers, read_pose
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.rigid_tool import RigidTool, rotation_matrix
from palpate.meshes.spring import Spring


class CondensedTool:
    """A rigid tool of a `CondensedBody`."""

    def __init__(self, body: CondensedBody, number: int, tool: RigidTool) -> None:
        self._body, self._number = body, number
        self.description = tool

    def move_to(self, position: ArrayLike, rotation: ArrayLike | None = None) -> None:
        """Be there in the next call of `CondensedBody.step`, and stay.

        Args:
            position: Of the tool's origin [m], shape (3,).
            rotation: Unit quaternion (w, x, y, z), shape (4,); None keeps the present one.

        Raises:
            InputError: This is no pose.
        """
        place, turn = read_pose(self._number, position, rotation)
        row = self._body._goals[self._number]
        if turn is not None:
            row[3:] = rotation_matrix(np.array(turn)).ravel()
        row[:3] = place

    @property
    def position(self) -> Floats:
        """Of its origin in the last step [m], shape (3,)."""
        return self._body._poses[self._number, :3].copy()

    @property
    def rotation(self) -> Floats:
        """Rotation matrix from its frame in the last step, shape (3, 3)."""
        return self._body._poses[self._number, 3:].reshape(3, 3).copy()

    @property
    def force(self) -> Floats:
        """On the tool, that of the body [N], shape (3,), in the last step."""
        force: Floats = self._body._forces[self._number]
        return force

    @property
    def moment(self) -> Floats:
        """On the tool about its origin [N m], shape (3,), in the last step."""
        moment: Floats = self._body._moments[self._number]
        return moment


class CondensedSpring:
    """A spring over a patch of a `CondensedBody`, its anchor in somebody's hand."""

    def __init__(self, body: CondensedBody, number: int, spring: Spring) -> None:
        self._body, self._number = body, number
        self.description = spring

    def move_to(self, place: ArrayLike) -> None:
        """Have the anchor in a place from the next call of `CondensedBody.step` on.

        Args:
            place: To where the middle of the patch is pulled [m], shape (3,).

        Raises:
            InputError: This is no place.
        """
        goal = np.array(read_numbers(place, 3, "place of an anchor"))
        self._body._anchors[self._number] = goal - np.array(self.description.center)
        self._body._is_pulled = True

    @property
    def force(self) -> Floats:
        """On the hand [N], shape (3,), in the last step.

        Raises:
            NotCondensableError: The model does not see all points of the patch.
        """
        return self._body._pulls(self._number)


class CondensedBody:
    """A condensed body that is stepped: each step is an equilibrium with the tools where they are.

    A viewer draws `facets` at `positions`; a controller or a haptic device reads the tools'
    `force`. There is no time, no inertia and no limit on speed; where contact does not settle in a
    step, everything stays as it was and the tools may be sent elsewhere.

    Args:
        model: Of `condense`. Its problem's tools begin where their paths do, its springs' anchors
            at rest, whatever their paths say.

    Attributes:
        model: As given.
        tools: In the problem's order.
        springs: Likewise.
        points: Numbers of the seen points in the mesh, shape (num_seen,).
        touching: Vertices that tools push.
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
        self.tools = tuple(CondensedTool(self, k, tool) for k, tool in enumerate(problem.tools))
        self.springs = tuple(CondensedSpring(self, k, s) for k, s in enumerate(problem.springs))
        place = np.full(problem.mesh.num_points, -1, dtype=np.int32)
        place[model.seen] = np.arange(len(model.seen))
        facets = place[problem.mesh.boundary_facets]
        self.facets: Indices = facets[(facets >= 0).all(axis=1)]
        self._patches = PatchSprings(problem.mesh.points, problem.springs)
        self._sees = [bool((place[s.facets] >= 0).all()) for s in problem.springs]
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
        """Of the tools on the model's touched points in the last step [N], (num_touched, 3)."""
        return self._steps.contact_forces

    @property
    def displacement(self) -> Points:
        """Of `points` now [m], shape (num_seen, 3): read-only, always the same array."""
        return self._moved

    @property
    def positions(self) -> Points:
        """Of `points` now [m], shape (num_seen, 3): read-only, always the same array."""
        return self._shown

    def _pulls(self, number: int) -> Floats:
        if not self._sees[number]:
            raise NotCondensableError(
                f"the model does not see all points of spring {number + 1}; name them among `seen`"
            )
        moved = np.zeros_like(self.model.problem.mesh.points)
        moved[self.points] = self._displacement
        full = np.ones(len(self.springs))
        pull: Floats = self._patches.resultants(moved, self._anchors, full)[number]
        return -pull
