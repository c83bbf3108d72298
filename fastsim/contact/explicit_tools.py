"""Rigid tools in an explicit run: settings, poses at every step, and loads on the tools."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.contact.contact_law import (
    ContactForm,
    ContactLaw,
    critical_with_penalty,
    explicit_stiffness,
    farthest,
    half_thickness,
    largest_speed,
    layer_stiffness,
    read_pose,
    require_larger_than_gaps,
    require_outside,
)
from palpate.fastsim.contact.errors import FacetContactError, ToolInsideError, ToolTooFastError
from palpate.fastsim.contact.tool_contact import POSE, ToolContact, core_path, poses_at
from palpate.fastsim.explicit_run import ExplicitRun
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import BoxShape, ContactRule, RigidTool

# As in core/explicit/contact.hpp: the prescribed pose of a tool at a time, and the loads on it.
TOOL_STEP = np.dtype([("pose", POSE), ("drive", np.float64)])
_STEP_LENGTH = TOOL_STEP.itemsize // 8
TOOL_RECORD = np.dtype(
    [
        ("force", np.float64, 3),
        ("moment", np.float64, 3),
        ("impulse", np.float64, 3),
        ("offset", np.float64),
        ("gap", np.float64),
    ]
)
# A vertex deeper than this fraction of the tool's half thickness may leave on the other side.
_DEEPEST = 0.5


def _is_over_facets(tool: RigidTool) -> bool:
    return tool.contact is ContactRule.FACETS


def _forms(problem: Problem, law: ContactLaw | None) -> list[ContactForm]:
    """The form of contact of each tool; what is known at vertices only is refused."""
    forms = []
    for number, tool in enumerate(problem.tools):
        is_box = _is_over_facets(tool) and isinstance(tool.shape, BoxShape)
        is_soft = is_box or tool.drive is not None
        form = law.form if law else ContactForm.PENALTY if is_soft else ContactForm.CONSTRAINT
        forms.append(form)
        if form is ContactForm.CONSTRAINT and is_box:
            raise FacetContactError(
                number, "the constraint beside a box is known at vertices only, the penalty at both"
            )
        is_rough = _is_over_facets(tool) and tool.friction_coefficient > 0.0
        if form is ContactForm.PENALTY and is_rough:
            raise FacetContactError(
                number, "a penalty, as for a box or a tool driven by a force, has no friction there"
            )
    return forms


def _averages_at_start(contact: ToolContact, displacement: Points) -> Floats:
    """Average gaps over facets at the start of the tool's path [m], one for each constraint."""
    pose = poses_at(contact.tool.path, contact.tool.path.times[:1])[0]
    averages: Floats = contact.sampling.averaged(
        contact.gaps(displacement, pose).distances[:, None]
    )[:, 0]
    return averages


def depth_at_start(problem: Problem) -> float:
    """How deep a body at rest is in its tools by averages over facets [m]; at most 0 outside.

    Averages are negative before a tool touches that is small beside the facets. Explicit steps
    refuse such a start.
    """
    contacts = [ToolContact(problem, tool) for tool in problem.tools if _is_over_facets(tool)]
    at_rest = np.zeros_like(problem.mesh.points)
    smallest = [_averages_at_start(c, at_rest).min(initial=math.inf) for c in contacts]
    return -float(min(smallest, default=math.inf))


def _require_averages_outside(contact: ToolContact, number: int, displacement: Points) -> None:
    """Refuse averages over facets that the first step would push out at once."""
    averages = _averages_at_start(contact, displacement)
    if averages.size and averages.min() < 0.0:
        worst = int(np.argmin(averages))
        x, y, z = contact.vertex_positions(displacement)[worst].tolist()
        raise ToolInsideError(number, -float(averages[worst]), 0.0, (x, y, z))


@dataclass(frozen=True, eq=False)
class ToolTrack:
    """Position of a tool and the loads on it, at the output times.

    Attributes:
        positions: Positions of its origin [m], shape (n, 3).
        forces: On the tool [N], shape (n, 3): minus the sum of those on the body. With the
            constraint those of one step, which chatter; see `mean_forces`.
        moments: About its origin [N m], shape (n, 3).
        mean_forces: Over the time since the output before [N], shape (n, 3); the first is zero.
        smallest_gaps: Smallest gap of vertices near it [m], shape (n,); infinite if none is near.
        stiffness: Penalty stiffness [Pa/m]; None with the constraint.
        largest_speed: Speed up to which no vertex passes through [m/s].
    """

    positions: Floats
    forces: Floats
    moments: Floats
    mean_forces: Floats
    smallest_gaps: Floats
    stiffness: float | None
    largest_speed: float


class ExplicitTools:
    """The tools of one run.

    Args:
        problem: With tools.
        law: How contact is enforced; None is the constraint, or the penalty for a tool that is
            driven by a force, or for a box with contact over facets.
        mass: Lumped [kg], shape (num_points,).
        critical_time_step: Critical time step of the body alone [s].
        time_step: Chosen step [s], or None.
        clock: Time on the tools' paths for times of the run; None is the same time.

    Attributes:
        critical_time_step: With the penalty's stiffness [s].

    Raises:
        InputError: A tool that is driven by a force, with the constraint.
        FacetContactError: Contact over facets by a penalty with friction, or of a box with the
            constraint.
        ToolInsideError: On `start`, a tool that is in the body, or averages over facets that are.
    """

    def __init__(
        self,
        problem: Problem,
        law: ContactLaw | None,
        mass: Floats,
        *,
        critical_time_step: float,
        time_step: float | None,
        clock: Callable[[Points], Points] | None = None,
    ) -> None:
        self._problem = problem
        self._mass = mass
        self._clock = clock
        forms = _forms(problem, law)
        self.contacts = [ToolContact(problem, tool) for tool in problem.tools]
        self.stiffnesses: list[float | None] = []
        for contact, form in zip(self.contacts, forms, strict=True):
            if form is ContactForm.CONSTRAINT:
                if contact.tool.drive is not None:
                    raise InputError(
                        "a tool that is driven by a force needs the penalty form of contact"
                    )
                self.stiffnesses.append(None)
                continue
            self.stiffnesses.append(
                explicit_stiffness(
                    law or ContactLaw(form),
                    layer_stiffness(problem, contact.facets),
                    float((mass[contact.vertices] / contact.areas).min()),
                    critical_time_step,
                    time_step,
                )
            )
        added = np.zeros(len(mass))
        for contact, k in self.penalties:
            added[contact.vertices] += k * contact.areas / mass[contact.vertices]
        self.critical_time_step = critical_with_penalty(
            critical_time_step, float(added.max(initial=0.0))
        )
        self._speeds: list[float] = []
        self._paths = [core_path(contact.tool.path) for contact in self.contacts]
        self._reaches = [farthest(contact.tool.shape) for contact in self.contacts]

    @property
    def penalties(self) -> list[tuple[ToolContact, float]]:
        """The contacts with a penalty, and its stiffness [Pa/m]."""
        pairs = zip(self.contacts, self.stiffnesses, strict=True)
        return [(contact, k) for contact, k in pairs if k is not None]

    @property
    def largest_speeds(self) -> tuple[float, ...]:
        """Speed of each tool up to which no vertex passes through [m/s], once attached."""
        return tuple(self._speeds)

    def attach(self, run: ExplicitRun, time_step: float, *, is_timed: bool) -> None:
        """Set the tools of a run; if its times are real, refuse tools that are too fast."""
        rest = np.ascontiguousarray(self._problem.mesh.points)
        for number, (contact, k) in enumerate(zip(self.contacts, self.stiffnesses, strict=True)):
            tool = contact.tool
            require_larger_than_gaps(self._problem, contact, number)
            allowed = largest_speed(self._problem, contact, self._mass, time_step, k)
            self._speeds.append(allowed)
            if is_timed:
                self._require_slow(self._paths[number], number)
            deepest = _DEEPEST * half_thickness(tool.shape)
            drive = tool.drive
            direction = (0.0, 0.0, 0.0) if drive is None else drive.direction
            tool_mass = 0.0 if drive is None else drive.mass
            reach = deepest if np.isfinite(deepest) else 0.0
            if k is None and _is_over_facets(tool):
                sampling = contact.sampling
                run.add_constraint_over_facets(
                    contact.shape,
                    friction=tool.friction_coefficient,
                    reach=reach,
                    deepest=deepest,
                    points=rest,
                    facets=np.ascontiguousarray(sampling.patches),
                    facet_areas=sampling.patch_areas,
                    constraints=sampling.constraints,
                    areas=sampling.areas,
                )
                continue
            if k is not None and _is_over_facets(tool):
                run.add_tool_over_facets(
                    contact.shape,
                    reach=reach,
                    deepest=deepest,
                    direction=direction,
                    mass=tool_mass,
                    points=rest,
                    facets=np.ascontiguousarray(contact.sampling.patches),
                    stiffnesses=k * contact.sampling.patch_areas,
                )
                continue
            run.add_tool(
                contact.shape,
                is_constraint=k is None,
                friction=tool.friction_coefficient,
                reach=reach,
                deepest=deepest,
                direction=direction,
                mass=tool_mass,
                points=rest,
                vertices=contact.vertices,
                stiffnesses=contact.areas * (0.0 if k is None else k),
            )

    def start(self, displacement: Points) -> None:
        """Return to the tools' own paths; check that they begin outside of the body."""
        self._paths = [core_path(contact.tool.path) for contact in self.contacts]
        for number, contact in enumerate(self.contacts):
            require_outside(self._problem, contact, number, displacement)
            if self.stiffnesses[number] is None and _is_over_facets(contact.tool):
                _require_averages_outside(contact, number, displacement)

    def goal(
        self, number: int, position: ArrayLike, rotation: ArrayLike | None
    ) -> tuple[list[float], list[float] | None]:
        """Check a pose to which a tool is sent: position [m], unit quaternion or None.

        Raises:
            InputError: There is no such tool, it is driven by a force, or the numbers are no pose.
        """
        if not 0 <= number < len(self.contacts):
            raise InputError(f"tool number {number}: there are {len(self.contacts)}, from 0")
        if self.contacts[number].tool.drive is not None:
            raise InputError(f"tool {number + 1} is driven by a force and goes its own way")
        return read_pose(number, position, rotation)

    def send(
        self, goals: dict[int, tuple[list[float], list[float] | None]], begin: float, end: float
    ) -> None:
        """Move tools along straight lines from their poses at a time to goals at another.

        Raises:
            ToolTooFastError: Vertices could not follow; all of them stay on their ways then.
        """
        ways = {k: self._paths[k].way_to(*goal, begin, end) for k, goal in goals.items()}
        for number, way in ways.items():
            self._require_slow(way, number)
        for number, way in ways.items():
            self._paths[number] = way

    def _require_slow(self, path: _core.ToolPath, number: int) -> None:
        speed = path.fastest_point(self._reaches[number])
        if speed > self._speeds[number]:
            raise ToolTooFastError(number, speed, self._speeds[number])

    def rows(self, times: Floats) -> Floats:
        """Poses and drives at times of the run as the core reads them, a row for each time."""
        on_path = times if self._clock is None else self._clock(times)
        out = np.zeros((len(times), len(self.contacts), _STEP_LENGTH))
        for k, (contact, path) in enumerate(zip(self.contacts, self._paths, strict=True)):
            out[:, k, :-1] = path.poses_at(on_path)
            drive = contact.tool.drive
            if drive is not None:
                out[:, k, -1] = [drive.force * drive.amplitude(float(t)) for t in on_path]
        return out.reshape(len(times), -1)

    def steps(self, times: Floats) -> NDArray[np.void]:
        """Poses and drives at times of the run, shape (n, num_tools) of `TOOL_STEP`."""
        return self.rows(times).view(TOOL_STEP)

    def tracks(
        self, times: Floats, steps: NDArray[np.void], records: NDArray[np.void]
    ) -> tuple[ToolTrack, ...]:
        """The track of each tool between its first record and its last.

        Args:
            times: Times of the records [s], shape (n,).
            steps: Poses on the tools' paths, shape (n, num_tools) of `TOOL_STEP`.
            records: Loads on the tools, shape (n, num_tools) of `TOOL_RECORD`.
        """
        spans = np.concatenate([[np.inf], np.diff(times)])[:, None]
        out = []
        for k, contact in enumerate(self.contacts):
            drive = contact.tool.drive
            along = np.zeros(3) if drive is None else np.array(drive.direction)
            of = records[:, k]
            out.append(
                ToolTrack(
                    positions=steps["pose"]["position"][:, k] + of["offset"][:, None] * along,
                    forces=of["force"].copy(),
                    moments=of["moment"].copy(),
                    mean_forces=of["impulse"] / spans,
                    smallest_gaps=of["gap"].copy(),
                    stiffness=self.stiffnesses[k],
                    largest_speed=self._speeds[k],
                )
            )
        return tuple(out)
