"""Rigid tools in an explicit run: settings, poses at every step, and what the tools feel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.contact.contact_law import (
    ContactForm,
    ContactLaw,
    critical_with_contact,
    explicit_stiffness,
    half_thickness,
    largest_speed,
)
from palpate.fastsim.contact.tool_checks import (
    require_larger_than_gaps,
    require_outside,
    require_slow,
)
from palpate.fastsim.contact.tool_contact import POSE, ToolContact, poses_at
from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem

# Numbers of a tool in a row of reactions: force, moment, impulse, offset, smallest gap.
REACTION = 11
# A vertex deeper than this part of the tool's half thickness may come out on the other side.
_DEEPEST = 0.5


@dataclass(frozen=True, eq=False)
class ToolTrack:
    """What a tool did and felt, at the output times.

    Attributes:
        positions: Of its origin [m], shape (n, 3).
        forces: On the tool [N], shape (n, 3): minus the sum of those on the body. With the
            constraint those of one step, which chatter; see `mean_forces`.
        moments: About its origin [N m], shape (n, 3).
        mean_forces: Over the time since the output before [N], shape (n, 3); the first is zero.
        smallest_gaps: Of all vertices near the tool [m], shape (n,); infinite if none is near.
        stiffness: Penalty stiffness [Pa/m]; None with the constraint.
        largest_speed: Up to which nothing passes through [m/s].
    """

    positions: Points
    forces: Points
    moments: Points
    mean_forces: Points
    smallest_gaps: Points
    stiffness: float | None
    largest_speed: float


class ExplicitTools:
    """The tools of one run.

    Args:
        problem: With tools.
        law: How contact is enforced; None is the constraint, or for a tool that is driven by a
            force the penalty.
        mass: Lumped [kg], shape (num_points,).
        critical_time_step: Of the body alone [s].
        time_step: Chosen step [s], or None.
        clock: Time on the tools' paths for times of the run; None is the same time.

    Attributes:
        critical_time_step: With the penalty's stiffness [s].

    Raises:
        InputError: A tool that is driven by a force, with the constraint.
    """

    def __init__(
        self,
        problem: Problem,
        law: ContactLaw | None,
        mass: Points,
        *,
        critical_time_step: float,
        time_step: float | None,
        clock: Callable[[Points], Points] | None = None,
    ) -> None:
        self._problem = problem
        self._mass = mass
        self._clock = clock
        self.contacts = [ToolContact(problem, tool) for tool in problem.tools]
        self.stiffnesses: list[float | None] = []
        for contact in self.contacts:
            driven = contact.tool.drive is not None
            chosen = law or ContactLaw(ContactForm.PENALTY if driven else ContactForm.CONSTRAINT)
            if chosen.form is ContactForm.CONSTRAINT:
                if driven:
                    raise InputError(
                        "a tool that is driven by a force needs the penalty form of contact"
                    )
                self.stiffnesses.append(None)
                continue
            self.stiffnesses.append(
                explicit_stiffness(problem, contact, chosen, mass, critical_time_step, time_step)
            )
        self.critical_time_step = critical_with_contact(critical_time_step, self.penalties, mass)
        self._speeds: list[float] = []
        self._rows: list[Points] = []
        self._impulses = np.zeros((len(self.contacts), 3))

    @property
    def penalties(self) -> list[tuple[ToolContact, float]]:
        """The contacts with a penalty, and its stiffness [Pa/m]."""
        pairs = zip(self.contacts, self.stiffnesses, strict=True)
        return [(contact, k) for contact, k in pairs if k is not None]

    def attach(
        self, run: _core.ExplicitRun32 | _core.ExplicitRun64, time_step: float, *, is_timed: bool
    ) -> None:
        """Give the tools to a run; where times are real, refuse those that are too fast."""
        rest = np.ascontiguousarray(self._problem.mesh.points)
        for number, (contact, k) in enumerate(zip(self.contacts, self.stiffnesses, strict=True)):
            tool = contact.tool
            require_larger_than_gaps(self._problem, contact, number)
            allowed = largest_speed(self._problem, contact, self._mass, time_step, k)
            self._speeds.append(allowed)
            if is_timed:
                require_slow(tool, number, allowed)
            deepest = _DEEPEST * half_thickness(tool.shape)
            reach = deepest if np.isfinite(deepest) else 0.0
            drive = tool.drive
            run.add_tool(
                contact.shape,
                k is None,
                tool.friction_coefficient,
                reach,
                deepest,
                (0.0, 0.0, 0.0) if drive is None else drive.direction,
                0.0 if drive is None else drive.mass,
                rest,
                contact.vertices,
                contact.areas * (0.0 if k is None else k),
            )

    def start(self, displacement: Points) -> None:
        """Check where the tools begin, and forget what they felt."""
        for number, contact in enumerate(self.contacts):
            require_outside(self._problem, contact, number, displacement)
        self._rows = []
        self._impulses[:] = 0.0

    def rows(self, times: Points) -> Points:
        """Poses and drives at times of the run, shape (n, 13 num_tools)."""
        on_path = times if self._clock is None else self._clock(times)
        out = np.zeros((len(times), len(self.contacts), POSE + 1))
        for k, contact in enumerate(self.contacts):
            out[:, k, :POSE] = poses_at(contact.tool.path, on_path)
            drive = contact.tool.drive
            if drive is not None:
                out[:, k, POSE] = [drive.force * drive.amplitude(float(t)) for t in on_path]
        return out.reshape(len(times), -1)

    def begin_reactions(self, num_records: int) -> Points:
        """An array for the records of one call."""
        return np.zeros((num_records + 1, REACTION * len(self.contacts)))

    def collect(self, reactions: Points, *, is_output: bool) -> None:
        """Keep the records of a call; where it ended between outputs, only their impulses."""
        table = reactions.reshape(len(reactions), len(self.contacts), REACTION)
        if not self._rows:
            self._rows.append(table[0].copy())
        for row in table[1:]:
            self._impulses += row[:, 6:9]
            if is_output:
                kept = row.copy()
                kept[:, 6:9] = self._impulses
                self._impulses[:] = 0.0
                self._rows.append(kept)

    def last_forces(self) -> Points:
        """Force on each tool at the last record [N], shape (num_tools, 3)."""
        return self._rows[-1][:, :3].copy()

    def tracks(self, times: Points) -> tuple[ToolTrack, ...]:
        """What each tool did, at the output times [s]."""
        table = np.array(self._rows)
        poses = self.rows(times).reshape(len(times), len(self.contacts), POSE + 1)
        spans = np.concatenate([[np.inf], np.diff(times)])[:, None]
        out = []
        for k, contact in enumerate(self.contacts):
            drive = contact.tool.drive
            along = np.zeros(3) if drive is None else np.array(drive.direction)
            rows = table[:, k]
            out.append(
                ToolTrack(
                    positions=poses[:, k, :3] + rows[:, 9:10] * along,
                    forces=rows[:, :3].copy(),
                    moments=rows[:, 3:6].copy(),
                    mean_forces=rows[:, 6:9] / spans,
                    smallest_gaps=rows[:, 10].copy(),
                    stiffness=self.stiffnesses[k],
                    largest_speed=self._speeds[k],
                )
            )
        return tuple(out)
