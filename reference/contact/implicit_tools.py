"""Rigid tools in implicit steps: no node inside a tool at the end of a step.

The force that keeps it out is one over the whole step, as a multiplier of the constraint

    g(u(t + dt), t + dt) >= 0,   t >= 0,   t g = 0

at the nodes (`tool_contact`), beside forces and inertia balanced within the step; and so does what
drags a node along the tool, at most mu t, against its slip over the step. A multiplier may swing
from step to step; what is reported of a tool is its impulse over the time from output to output.
Forces are balanced at a time within the step, not in its middle; a step's impulse is taken between
its own force and the one before, or it would be of another time by a part of the step.

Of a tool that a force drives, how far it is along its line is one more unknown:

    m s'' = F(t) + d . R,    the tool at its first pose, s d further on

with R what the body puts on it, by the formulas of the body (`dynamics`) and together with it: with
K its tangent, of which K_c is the tools', a Newton step solves

    | K        -K_c d           | |du|   |what the body is out of balance|
    | -d K_c   m f + d . K_c d  | |ds| = |what the tool is               |

where f is the factor of the mass in K.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.reference import fenicsx
from palpate.reference.contact.tool_contact import HeldNodes, ToolContact, create_contacts
from palpate.reference.mesh_transfer import TransferredSpace
from palpate.reference.schemes import AlphaMethod, State, stencil_of

# Of the force along a step, what may be left at its end.
_NEARLY = 0.5
_MOST_TRIALS = 6


def step_length(along: Callable[[float], float | None], first: float) -> float:
    """The part of a step after which the balance of forces along it is nearly met, at most 1.

    Args:
        along: What is out of balance along the step after a part of it [J]; None where a cell
            would be inverted.
        first: The same at its start.
    """
    low, high, length = 0.0, 1.0, 1.0
    for _ in range(_MOST_TRIALS):
        left = along(length)
        if left is None:
            high = length
        elif abs(left) <= _NEARLY * abs(first) or (length == 1.0 and left > 0.0):
            return length
        else:
            low, high = (length, high) if left > 0.0 else (low, length)
        length = 0.5 * (low + high)
    return length


class DrivenTool:
    """One tool in motion along its line, from rest.

    Args:
        contact: Of a tool that is driven by a force.

    Attributes:
        contact: Where the tool is.
        direction: Of its line [-], shape (3,).
        mass: [kg].
        way: At the end of the step in hand [m].
    """

    def __init__(self, contact: ToolContact) -> None:
        drive = contact.tool.drive
        assert drive is not None
        self.contact, self.direction, self.mass = contact, np.array(drive.direction), drive.mass
        self._drive = drive
        self.way = 0.0
        pushed = np.array([self._push(0.0)])
        self._state = State(np.zeros(1), np.zeros(1), pushed / self.mass)
        self._pushed = 0.0

    def _push(self, time: float) -> float:
        return self._drive.force * self._drive.amplitude(time)

    def begin_step(self, time: float, dt: float, method: AlphaMethod) -> None:
        """Go on from the end of the last step, by a guess; arguments as of `Motion.step`."""
        state = self._state
        self._stencil = stencil_of(method, state, dt)
        self._pushed = self._push(time + (1.0 - method.alpha_f) * dt)
        self.go_to(float((state.u + dt * state.v + 0.5 * dt**2 * state.a)[0]))

    def go_to(self, way: float) -> None:
        """Put the tool so far along its line [m]."""
        self.way = way
        self.contact.move(way)

    def lacking(self, displacement: Floats) -> tuple[float, float]:
        """The force that is out of balance, and the largest of those in it [N]."""
        felt = float(self.contact.state(displacement).force @ self.direction)
        inertia = self.mass * float(self._stencil.acceleration(np.array([self.way]))[0])
        return self._pushed + felt - inertia, max(abs(self._pushed), abs(felt), abs(inertia))

    def stiffness(self, displacement: Floats) -> tuple[Floats, float]:
        """K_c d of the body's unknowns, flat, and m f + d . K_c d [N/m]."""
        coupling = self.contact.derivative_of_force(displacement, self.direction)
        own = float(fenicsx.total(float(coupling.reshape(-1, 3).sum(axis=0) @ self.direction)))
        return coupling, self.mass * self._stencil.A + own

    def end_step(
        self, held: HeldNodes, v: Points, a: Points, inertia: Callable[[Points], Floats]
    ) -> tuple[Points, Points]:
        """Go on from a step that is done, the nodes that the tool holds as fast as it.

        Args:
            held: Those nodes.
            v: Velocity of all nodes [m/s], shape (num_blocks, 3).
            a: Acceleration [m/s2], likewise.
            inertia: What a field like these makes of the mass matrix, summed, shape (3,).

        Returns:
            Changes of the two that leave the momentum of tool and body what it was.
        """
        still = np.zeros_like(held.normals)
        carried = held.change(np.zeros_like(v), still + self.direction)
        whole = self.mass + float(inertia(carried) @ self.direction)
        changes, ends = [], []
        here = np.array([self.way])
        own = self._stencil.after(here)
        for of_nodes, of_tool in ((v, own.v), (a, own.a)):
            stopped = held.change(of_nodes, still)
            end = (self.mass * of_tool - float(inertia(stopped) @ self.direction)) / whole
            changes.append(stopped + end * carried)
            ends.append(end)
        self._state = State(here, ends[0], ends[1])
        return changes[0], changes[1]


# The multipliers carry all but this many times the tolerance of the forces on tools.
_OVER_TOLERANCE = 100.0
# Multipliers are taken over where the rest of the step is balanced to this part.
_ROUGH = 1e-2
# With friction: before that what sticks and what slips is not known.
_BALANCED = 1e-5
# With friction the multipliers carry all but this at best: which way a node that hardly slips is
# dragged settles ever more slowly, and by so little work.
_OF_DRAG = 1e-6


class ImplicitTools:
    """The tools of one implicit run.

    Args:
        problem: With its tools.
        space: Displacement space.
        held: Degrees of freedom that are fixed, shape (n,).
        tolerance: Relative residual of a step [-].

    Attributes:
        driven: Those that a force drives.
    """

    def __init__(
        self, problem: Problem, space: TransferredSpace, held: Indices, tolerance: float
    ) -> None:
        self._is_rough = any(tool.friction_coefficient > 0.0 for tool in problem.tools)
        carried = _OVER_TOLERANCE * tolerance
        self._carried = max(carried, _OF_DRAG) if self._is_rough else carried
        self._contacts: Sequence[ToolContact] = create_contacts(problem, space, held)
        self.driven = tuple(DrivenTool(c) for c in self._contacts if c.tool.drive is not None)
        self._held = held
        materials = (problem.material, *(i.material for i in problem.inclusions))
        self._density = max(material.density for material in materials)
        self._impulses = np.zeros((len(self._contacts), 3))
        self._last_forces = np.zeros((len(self._contacts), 3))

    def __bool__(self) -> bool:
        return bool(self._contacts)

    def require_outside(self, displacement: Floats) -> None:
        """Raise InputError where a tool is in the body at the start."""
        for number, contact in enumerate(self._contacts, start=1):
            contact.set_time(0.0)
            depth = contact.state(displacement).penetration
            if depth > 0.0:
                raise InputError(
                    f"tool {number} is {depth:g} m deep in the body at the start; begin its path "
                    "outside"
                )
            contact.keep(displacement)

    def begin_step(self, time: float, dt: float, method: AlphaMethod, mass_factor: float) -> None:
        """Put the tools where they are at the end of a step, with what pressed in the last.

        Args:
            time: At its start [s].
            dt: Its length [s].
            method: Of the step.
            mass_factor: Of the mass in the step's tangent [1/s2].
        """
        for contact in self._contacts:
            contact.stiffen(mass_factor * self._density)
            contact.set_time(time + dt)
            contact.go_back()
        for tool in self.driven:
            tool.begin_step(time, dt, method)

    @property
    def ways(self) -> Floats:
        """How far the driven tools are along their lines [m], shape (num_driven,)."""
        return np.array([tool.way for tool in self.driven])

    def go_to(self, ways: Floats) -> None:
        """Put the driven tools so far along their lines [m]."""
        for tool, way in zip(self.driven, ways, strict=True):
            tool.go_to(float(way))

    def lacking(self, displacement: Floats) -> tuple[Floats, Floats]:
        """What the driven tools are out of balance by, and the forces it is part of [N]."""
        both = np.array([tool.lacking(displacement) for tool in self.driven]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def are_balanced(self, displacement: Floats, tolerance: float, rounding: float) -> bool:
        """Whether the driven tools are, but for a part of their forces, or for so many newtons."""
        lacking, forces = self.lacking(displacement)
        return bool((np.abs(lacking) <= tolerance * forces + rounding).all())

    def solve_with_driven(
        self,
        solve: Callable[..., Floats],
        displacement: Floats,
        residual: Floats,
        *,
        is_fresh: bool,
    ) -> tuple[Floats, Floats]:
        """A Newton step of body and driven tools (`driven_motion`).

        Args:
            solve: By the body's tangent, flat, which may be asked for as it is now.
            displacement: Where the step begins, flat [m].
            residual: Of the body there, flat [N].
            is_fresh: Whether the tangent is to be as it is now.

        Returns:
            The step of the body, flat, and of the ways [m], shape (num_driven,).
        """
        du = solve(residual, is_fresh=is_fresh)
        if not self.driven:
            return du, np.zeros(0)
        rows = [tool.stiffness(displacement) for tool in self.driven]
        couplings = np.array([coupling for coupling, _ in rows])
        answers = np.array(
            [solve(c, is_fresh=False) if fenicsx.norm(c) > 0.0 else 0.0 * c for c in couplings]
        )
        matrix = np.diag([own for _, own in rows]) - fenicsx.total(couplings @ answers.T)
        lacking = self.lacking(displacement)[0] + fenicsx.total(couplings @ du)
        ways: Floats = np.linalg.solve(matrix, lacking)
        return du + ways @ answers, ways

    def end_step(
        self,
        displacement: Floats,
        velocity: Floats,
        acceleration: Floats,
        dt: float,
        late: float,
        momentum: Callable[[Floats, Floats], Floats],
    ) -> tuple[Floats, Floats]:
        """Go on from a step that is done.

        Args:
            displacement: At its end [m], flat.
            velocity: By Newmark's formulas [m/s], flat.
            acceleration: Likewise [m/s2].
            dt: Its length [s].
            late: How far beyond its middle forces are balanced, in its length [-].
            momentum: What the body's momentum gains by changes of velocity and acceleration
                [N s], flat.

        Returns:
            Velocity and acceleration, with those of the nodes that a tool holds: along its normal,
            and altogether where they stick. Newmark's would have a node that was caught swing about
            the tool's velocity, and leave it again. What the body gains by that the tool gave.
        """
        v, a = velocity.reshape(-1, 3).copy(), acceleration.reshape(-1, 3).copy()

        def inertia(field: Points) -> Floats:
            flat = momentum(self._free(field.copy()).ravel(), np.zeros_like(velocity))
            whole: Floats = fenicsx.total(flat.reshape(-1, 3).sum(axis=0))
            return whole

        rows = zip(self._impulses, self._last_forces, self._contacts, strict=True)
        for row, last, contact in rows:
            held = contact.held_nodes(displacement, dt)
            driven = next((tool for tool in self.driven if tool.contact is contact), None)
            if driven is None:
                dv = held.change(v, held.velocities)
                da = held.change(a, np.zeros_like(held.velocities))
            else:
                dv, da = driven.end_step(held, v, a, inertia)
            dv, da = self._free(dv), self._free(da)
            given = momentum(dv.ravel(), da.ravel()).reshape(-1, 3).sum(axis=0)
            force = contact.state(displacement).force
            row += dt * (force + late * (last - force)) - fenicsx.total(given)
            last[:] = force
            v, a = v + dv, a + da
            contact.keep(displacement)
        return v.ravel(), a.ravel()

    def _free(self, change: Points) -> Points:
        """Without what supports hold, shape (num_blocks, 3)."""
        change.reshape(-1)[self._held] = 0.0
        return change

    def force(self, displacement: Floats) -> Floats:
        """Nodal forces on the body at the end of the step [N], flat."""
        force = np.zeros_like(displacement)
        for contact in self._contacts:
            force += contact.force(displacement)
        return force

    def add_tangent(self, matrix: Any, displacement: Floats) -> None:
        """Add minus the derivative of the forces to a PETSc matrix."""
        for contact in self._contacts:
            contact.add_tangent(matrix, displacement)

    def settle(self, displacement: Floats, relative_residual: float) -> bool:
        """Take the forces over as multipliers where the step is nearly in balance.

        Returns:
            Whether they carry the forces, so that the step may end once it is balanced.
        """
        if not self._contacts:
            return True
        lacking, forces = self.lacking(displacement)
        of_tools = np.abs(lacking) / np.where(forces > 0.0, forces, 1.0)
        relative_residual = max(relative_residual, float(of_tools.max(initial=0.0)))
        if relative_residual > (_BALANCED if self._is_rough else _ROUGH):
            return False
        slid = [contact.let_go(displacement)[0] for contact in self._contacts]
        enough = self._carried if self._is_rough else 0.0
        changes = [contact.augment(displacement, enough=enough) for contact in self._contacts]
        return not any(slid) and all(change <= self._carried * whole for change, whole in changes)

    def mean_forces(self, duration: float) -> Points:
        """On each tool since this was last asked [N], shape (num_tools, 3).

        Args:
            duration: Time since then [s]; at the start 0, when nothing was felt.
        """
        means: Points = self._impulses / duration if duration else self._impulses
        self._impulses = np.zeros_like(means)
        return means
