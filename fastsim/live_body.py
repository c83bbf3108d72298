"""A body driven by a controller: its tools and springs are moved from step to step.

body = LiveBody(problem)
while ...:
    body.tools[0].move_to(position)
    body.step(steps)
    force = body.tools[0].force
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.contact.contact_law import read_numbers
from palpate.fastsim.contact.explicit_tools import TOOL_RECORD
from palpate.fastsim.errors import SpringTooStiffError
from palpate.fastsim.explicit_body import SAFETY, ExplicitBody, Precision
from palpate.fastsim.explicit_loads import ExplicitSprings
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, ToolPath
from palpate.meshes.spring import AnchorPath, Spring

# Number of significant bits of a time step, so that its multiples are exact.
_BITS = 20


class SteppedBody(Protocol):
    """A body as its tools and springs use it: a `LiveBody`, or a `CondensedBody`."""

    def _send_tool(self, number: int, position: ArrayLike, rotation: ArrayLike | None) -> None: ...
    def _tool_pose(self, number: int) -> tuple[Floats, Floats]: ...
    def _tool_force(self, number: int) -> Floats: ...
    def _send_anchor(self, spring: BodySpring, position: Floats) -> None: ...
    def _spring_force(self, spring: BodySpring) -> Floats: ...


class BodyTool:
    """A rigid tool of a body that is stepped."""

    def __init__(self, body: SteppedBody, number: int, tool: RigidTool) -> None:
        self._body, self._number = body, number
        self.description = tool

    def move_to(self, position: ArrayLike, rotation: ArrayLike | None = None) -> None:
        """Go to a pose in the next call of the body's `step`, and stay there.

        The tool of a `LiveBody` goes straight and at one speed; that of a `CondensedBody`, which
        has no time, is there at once.

        Args:
            position: Position of the tool's origin [m], shape (3,).
            rotation: Unit quaternion (w, x, y, z), shape (4,); None keeps the present one.

        Raises:
            InputError: This is no pose, or the tool is driven by a force. Whether it would go too
                fast is seen by `step` of a `LiveBody`, which raises ToolTooFastError.
        """
        self._body._send_tool(self._number, position, rotation)

    @property
    def position(self) -> Floats:
        """Position of its origin after the last step [m], shape (3,)."""
        return self._body._tool_pose(self._number)[0].copy()

    @property
    def rotation(self) -> Floats:
        """Rotation matrix from its frame after the last step, shape (3, 3)."""
        return self._body._tool_pose(self._number)[1].reshape(3, 3).copy()

    @property
    def force(self) -> Floats:
        """Force of the body on the tool [N], shape (3,).

        In a `LiveBody` its mean over the last call of `step`, since the constraint pushes in
        single steps; zero before the first step. In a `CondensedBody` that of the last step.
        """
        return self._body._tool_force(self._number)


class BodySpring:
    """A spring over a patch of a body that is stepped; its anchor is moved from outside."""

    def __init__(self, body: SteppedBody, spring: Spring) -> None:
        self._body, self.description = body, spring

    def move_to(self, position: ArrayLike) -> None:
        """Have the anchor go to a position in the next call of the body's `step`, and stay there.

        Args:
            position: To which the middle of the patch is pulled [m], shape (3,).

        Raises:
            InputError: The spring was let go, or this is no position.
        """
        goal = np.array(read_numbers(position, 3, "position of an anchor"))
        self._body._send_anchor(self, goal - np.array(self.description.center))

    @property
    def force(self) -> Floats:
        """Force on the anchor [N], shape (3,): stiffness times the way from anchor to patch.

        Raises:
            InputError: The spring was let go.
            NotCondensableError: A condensed model does not see all points of the patch.
        """
        return self._body._spring_force(self)


class LiveSpring(BodySpring):
    """A spring of a `LiveBody`, which can be let go."""

    _body: LiveBody

    @property
    def is_attached(self) -> bool:
        """Whether it pulls: not once it was let go, nor after a reset if it was added later."""
        return any(spring is self.description for spring in self._body._pull.springs)

    @property
    def anchor(self) -> Floats:
        """Position to which the middle of the patch is pulled now [m], shape (3,)."""
        body = self._body
        moved = body._pull.at(body.time)[0][body._number_of(self)]
        position: Floats = moved + np.array(self.description.center)
        return position

    def let_go(self) -> None:
        """Pull no more."""
        body = self._body
        body._engine.change_springs(body._pull.without_spring(body._number_of(self)))
        body._goals.pop(self.description, None)
        body._log.let_go(self.description, body._engine.steps)


class LiveBody:
    """A body that is stepped by a controller, a viewer or a robot.

    Args:
        problem: Mesh, material, supports, loads, springs and tools. Of its time span the damping
            and the step are used; end and outputs are not read.
        strain: Engineering or finite strain.
        element: Linear tetrahedra, plain or smoothed.
        time_step: [s]; None takes the time span's, or 0.8 of the critical one, cut to 20
            significant bits so that its multiples are exact.
        precision: Precision of the step.
        num_threads: At least 1.

    Attributes:
        tools: In the problem's order.
        springs: Springs of the problem, in its order.
        time_step: [s].

    Raises:
        InputError, UnstableStepError, ToolError: For the same reasons as `ExplicitBody`.

    Example:
        >>> import numpy as np
        >>> import palpate
        >>> from palpate.fastsim.live_body import LiveBody
        >>> from palpate.meshes.shapes import shape_box
        >>> mesh = palpate.mesh(shape_box((0.04, 0.04, 0.02), edge_length=0.01))
        >>> low = palpate.Support(np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32))
        >>> body = LiveBody(palpate.Problem(mesh, palpate.Material(1e4, 0.3), (low,), ()))
        >>> hand = body.hold((0.02, 0.02, 0.02), radius=0.012, stiffness=20.0)
        >>> hand.move_to((0.02, 0.02, 0.024))
        >>> body.step(200)
        >>> bool(hand.force[2] < 0.0)  # the body pulls back
        True
    """

    def __init__(
        self,
        problem: Problem,
        *,
        strain: Strain = Strain.GREEN,
        element: Element = Element.LINEAR,
        time_step: float | None = None,
        precision: Precision = Precision.DOUBLE,
        num_threads: int = 1,
    ) -> None:
        given = problem.time.time_step if problem.time is not None else None
        step = given if time_step is None else time_step
        if step is None:
            found = ExplicitBody(problem, strain=strain, element=element)
            step = _cut(SAFETY * found.critical_time_step)
        self._engine = ExplicitBody(
            problem,
            strain=strain,
            element=element,
            time_step=step,
            precision=precision,
            num_threads=num_threads,
        )
        self.problem, self.time_step = problem, self._engine.time_step
        self.tools = tuple(BodyTool(self, k, tool) for k, tool in enumerate(problem.tools))
        self.springs = tuple(LiveSpring(self, spring) for spring in problem.springs)
        self._positions = problem.mesh.points.copy()
        self._read_only = self._positions.view()
        self._read_only.flags.writeable = False
        self._first = self._pull
        self._begin()

    def _begin(self) -> None:
        self._goals: dict[Spring, Floats] = {}
        self._mean = np.zeros((len(self.tools), 3))
        self._is_read, self._span = True, 0.0
        self._log = DriveLog(self.problem)

    @property
    def _pull(self) -> ExplicitSprings:
        return self._engine.springs

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._engine.time

    @property
    def displacement(self) -> Points:
        """Displacement [m], shape (num_points, 3): read-only, always the same array, read anew."""
        return self._engine.displacement

    @property
    def positions(self) -> Points:
        """Present positions [m], shape (num_points, 3): read-only, always the same array."""
        np.add(self.problem.mesh.points, self._engine.displacement, out=self._positions)
        return self._read_only

    @property
    def velocity(self) -> Points:
        """Present velocity [m/s], shape (num_points, 3); costs as much as a step."""
        return self._engine.velocity()

    def strain_energy(self) -> float:
        """Strain energy of the body now [J]."""
        return self._engine.elastic.strain_energy(self._engine.displacement)

    def step(self, num_steps: int = 1) -> None:
        """Make steps, during which tools and anchors go where they were sent.

        Raises:
            InputError: Less than one step.
            BlowUpError: See `ExplicitBody.step`.
            ToolTooFastError: A tool cannot get where it was sent in these steps; no step is made.
        """
        if num_steps < 1:
            raise InputError(f"num_steps = {num_steps}: needs at least 1")
        engine = self._engine
        begin, goals = engine.steps, self._goals
        sent = dict(engine.tool_goals)
        engine.send_tools(num_steps)
        for spring, goal in goals.items():
            number = next(k for k, s in enumerate(self._pull.springs) if s is spring)
            end = (begin + num_steps) * self.time_step
            self._pull.send(number, goal, engine.time, end)
        self._goals = {}
        self._log.went(begin, begin + num_steps, sent, goals)
        if self.tools:
            engine.run.take_tool_records()  # impulses restart from zero
        engine.step(num_steps)
        self._is_read, self._span = not self.tools, num_steps * self.time_step

    def hold(
        self, center: tuple[float, float, float], *, radius: float, stiffness: float
    ) -> LiveSpring:
        """Attach a spring to a patch of the surface, from now on.

        Its anchor is at the present mean position of the patch, so that its resultant is zero.

        Args:
            center: Center of the patch, on the body at rest [m], shape (3,).
            radius: [m], > 0.
            stiffness: Stiffness of the whole patch [N/m], > 0.

        Raises:
            InputError: No patch there, or a value that makes no sense.
            SpringTooStiffError: The step is too long for it.
        """
        spring = Spring.on(
            self.problem.mesh, center, radius, stiffness, AnchorPath(np.zeros(1), np.zeros((1, 3)))
        )
        alone = PatchSprings(self.problem.mesh.points, (spring,))
        moved = alone.mean_displacements(self._engine.displacement)
        spring = dataclasses.replace(spring, path=AnchorPath(np.zeros(1), moved))
        self._require_stable(spring)
        self._engine.change_springs(self._pull.with_spring(spring))
        self._log.add_spring(spring, self._engine.steps)
        return LiveSpring(self, spring)

    def reset(self) -> None:
        """Return to time 0, with tools and springs as in the problem."""
        self._engine.change_springs(self._first.anew())
        self._engine.set_state(np.zeros_like(self._positions))
        self._begin()

    def recording(self) -> Problem:
        """The problem, with all motion since the start as paths of its tools and springs.

        `palpate.fastsim.dynamics.simulate` of it repeats the motion bit for bit, with the same
        strain, element, precision, threads and build.

        Raises:
            InputError: Nothing was stepped, a tool or spring was moved off a path of its own, or
                the given step has so many digits that all of them together are rounded.
        """
        return self._log.problem(self._engine.steps, self.time_step)

    def _require_stable(self, spring: Spring) -> None:
        """Bound the stiffness by Gershgorin: omega^2 <= that of the body + the largest K_a / m_a.

        The rows of a spring have no negative entry. Those of the problem are in the body's.
        """
        points = self.problem.mesh.points
        more = [s for s in self._pull.springs if s not in self.problem.springs]
        room = 4.0 / self.time_step**2 - 4.0 / self._engine.critical_time_step**2
        left = room * self._engine.mass - PatchSprings(points, more).row_sums()
        own = PatchSprings(points, [spring]).row_sums()
        touched = own > 0.0
        largest = spring.stiffness * float((left[touched] / own[touched]).min())
        if spring.stiffness > largest:
            raise SpringTooStiffError(spring.stiffness, max(largest, 0.0), self.time_step)

    def _send_tool(self, number: int, position: ArrayLike, rotation: ArrayLike | None) -> None:
        self._engine.move_tool(number, position, rotation)

    def _tool_pose(self, number: int) -> tuple[Floats, Floats]:
        assert self._engine.tools is not None
        pose = self._engine.tools.steps(np.array([self.time]))[0, number]["pose"]
        return np.asarray(pose["position"]), np.asarray(pose["rotation"])

    def _tool_force(self, number: int) -> Floats:
        if not self._is_read:
            records = self._engine.run.take_tool_records().view(TOOL_RECORD).reshape(-1)
            self._mean, self._is_read = records["impulse"] / self._span, True
        force: Floats = self._mean[number]
        return force

    def _send_anchor(self, spring: BodySpring, position: Floats) -> None:
        self._number_of(spring)
        self._goals[spring.description] = position

    def _spring_force(self, spring: BodySpring) -> Floats:
        number = self._number_of(spring)
        pulled: Floats = self._pull.resultants(self.displacement, self.time)[number]
        return -pulled

    def _number_of(self, spring: BodySpring) -> int:
        for number, pulling in enumerate(self._pull.springs):
            if pulling is spring.description:
                return number
        raise InputError("this spring was let go; hold the body anew")


def _cut(step: float) -> float:
    """The longest step [s], at most the given one, whose multiples are exact."""
    mantissa, exponent = math.frexp(step)
    return math.ldexp(math.floor(mantissa * 2**_BITS), exponent - _BITS)


ToolGoal = tuple[list[float], list[float] | None]


@dataclass
class _TrackedSpring:
    """A spring, its first and last step, and the positions of its anchor at some steps."""

    spring: Spring
    begin: int
    end: int | None = None
    knots: dict[int, Floats] = field(default_factory=dict)


class DriveLog:
    """Record of the motion of tools and springs of a run, from its start."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._tools: list[dict[int, ToolGoal]] = [{} for _ in problem.tools]
        self._springs = [_TrackedSpring(spring, 0) for spring in problem.springs]
        self._left_its_path = ""

    def add_spring(self, spring: Spring, step: int) -> None:
        """Note that a spring was attached at a step."""
        self._springs.append(_TrackedSpring(spring, step))

    def let_go(self, spring: Spring, step: int) -> None:
        """Note that a spring was let go at a step."""
        self._of(spring).end = step

    def went(
        self, begin: int, end: int, tools: dict[int, ToolGoal], anchors: dict[Spring, Floats]
    ) -> None:
        """Note that tools and anchors went from their positions to goals between two steps."""
        for number, goal in tools.items():
            knots, path = self._tools[number], self._problem.tools[number].path
            if not knots:
                if len(path.times) > 1:
                    self._left_its_path = f"tool {number + 1}"
                knots[0] = path.positions[0].tolist(), path.rotations[0].tolist()
            position, turn = knots[max(knots)]
            knots[begin] = position, turn
            knots[end] = goal[0], turn if goal[1] is None else goal[1]
        for spring, anchor in anchors.items():
            held = self._of(spring)
            if not held.knots:
                if len(spring.path.times) > 1:
                    self._left_its_path = "a spring"
                held.knots[begin] = spring.path.end
            held.knots[begin] = held.knots[max(held.knots)]
            held.knots[end] = anchor

    def problem(self, num_steps: int, time_step: float) -> Problem:
        """The problem whose paths repeat the motion; see `LiveBody.recording`."""
        end_time = num_steps * time_step
        if not num_steps:
            raise InputError("nothing was recorded: step the body first")
        if self._left_its_path:
            raise InputError(
                f"{self._left_its_path} had a path of its own and was moved off it: no path tells "
                "both; give it a single knot to start from"
            )
        if end_time / num_steps != time_step:
            raise InputError(
                f"{num_steps} steps of {time_step!r} s are rounded, and divided again are no such "
                "steps: leave time_step to the body, or give one of at most 20 significant bits"
            )
        span = self._problem.time or TimeSpan(end_time, time_step)
        span = dataclasses.replace(
            span, end_time=end_time, time_step=time_step, num_outputs=num_steps
        )
        return dataclasses.replace(
            self._problem,
            time=span,
            tools=tuple(
                self._tool(tool, knots, time_step)
                for tool, knots in zip(self._problem.tools, self._tools, strict=True)
            ),
            springs=tuple(self._spring(held, num_steps, time_step) for held in self._springs),
        )

    def _tool(self, tool: RigidTool, knots: dict[int, ToolGoal], dt: float) -> RigidTool:
        if not knots:
            return tool
        positions = [knots[step][0] for step in sorted(knots)]
        turns = [knots[step][1] for step in sorted(knots)]
        times = dt * np.array(sorted(knots))
        return dataclasses.replace(tool, path=ToolPath(times, np.array(positions), np.array(turns)))

    def _spring(self, held: _TrackedSpring, num_steps: int, dt: float) -> Spring:
        path = held.spring.path
        factors: dict[int, float] = {}
        if held.knots:
            steps = sorted(held.knots)
            path = AnchorPath(dt * np.array(steps), np.array([held.knots[k] for k in steps]))
        # Switched on and off within the step before, since forces act at whole steps.
        if held.begin > 0:
            factors |= {held.begin - 1: 0.0, held.begin: 1.0}
        if held.end is not None and held.end < num_steps:
            if held.end <= held.begin:
                factors = {0: 0.0}
            else:
                factors |= {held.end - 1: 1.0, held.end: 0.0}
        if not factors:
            return dataclasses.replace(held.spring, path=path)
        knots = sorted(factors)
        amplitude = TabularAmplitude(tuple(dt * k for k in knots), tuple(factors[k] for k in knots))
        return dataclasses.replace(held.spring, path=path, amplitude=amplitude)

    def _of(self, spring: Spring) -> _TrackedSpring:
        return next(held for held in self._springs if held.spring is spring)
