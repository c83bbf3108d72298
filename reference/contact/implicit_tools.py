"""Rigid tools in implicit steps: no gap below 0 at the end of a step.

The contact force is constant over the step, as a multiplier of the constraint

    g(u(t + dt), t + dt) >= 0,   t >= 0,   t g = 0

at the constraints (`tool_contact`), while forces and inertia are balanced within the step; so is
friction of at most mu t, against the sliding of a node along the tool over the step. A multiplier
may oscillate from step to step; the reported force on a tool is its impulse over the time between
two outputs. Forces are balanced at a time within the step, not at its middle; the impulse of a step
is therefore interpolated between its own force and the one before.

For a tool driven by a force, its position along its line is one more unknown:

    m s'' = F(t) + d . R,    the tool at its first pose, s d further on

with R the force of the body on it, integrated like the body (`dynamics`) and together with it: with
K the body's tangent, of which K_c is the part of the tools, a Newton step solves

    | K        -K_c d           | |du|   |residual of the body|
    | -d K_c   m f + d . K_c d  | |ds| = |residual of the tool|

where f is the factor of the mass in K.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Problem
from palpate.reference import fenicsx
from palpate.reference.contact.tool_contact import (
    ToolContact,
    TouchingSurface,
    create_contacts,
    require_outside,
)
from palpate.reference.mesh_transfer import TransferredSpace
from palpate.reference.schemes import AlphaMethod, State, stencil_of

# The force along a step at its end may be this fraction of that at its start.
_NEARLY = 0.5
_MOST_TRIALS = 6


def step_length(along: Callable[[float], float | None], first: float) -> float:
    """Fraction of a step, at most 1, at which the forces along it are nearly in balance.

    Args:
        along: Returns the residual force along the step at a fraction of it [J]; None where a cell
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
        contact: Contact of a tool that is driven by a force.

    Attributes:
        contact: Contact of the tool at its present position.
        direction: Direction of its line [-], shape (3,).
        mass: Mass of the tool [kg].
        way: Distance along its line at the end of the current step [m].
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
        """Predict the position at the end of the next step; for arguments see `Motion.step`."""
        state = self._state
        self._stencil = stencil_of(method, state, dt)
        self._pushed = self._push(time + (1.0 - method.alpha_f) * dt)
        self.go_to(float((state.u + dt * state.v + 0.5 * dt**2 * state.a)[0]))

    def go_to(self, way: float) -> None:
        """Move the tool to a distance along its line [m]."""
        self.way = way
        self.contact.move(way)

    def lacking(self, displacement: Floats) -> tuple[float, float]:
        """The residual force, and the largest of its terms [N]."""
        felt = float(self.contact.state(displacement).force @ self.direction)
        inertia = self.mass * float(self._stencil.acceleration(np.array([self.way]))[0])
        return self._pushed + felt - inertia, max(abs(self._pushed), abs(felt), abs(inertia))

    def stiffness(self, displacement: Floats) -> tuple[Floats, float]:
        """K_c d for the body's unknowns, flat, and m f + d . K_c d [N/m]."""
        coupling = self.contact.derivative_of_force(displacement, self.direction)
        own = float(fenicsx.total(float(coupling.reshape(-1, 3).sum(axis=0) @ self.direction)))
        return coupling, self.mass * self._stencil.A + own

    def end_step(
        self, surface: TouchingSurface, v: Points, a: Points, inertia: Callable[[Points], Floats]
    ) -> tuple[Points, Points]:
        """Finish a step; the surface in contact takes the velocity of the tool.

        Args:
            surface: The surface in contact.
            v: Velocity of all nodes [m/s], shape (num_blocks, 3).
            a: Acceleration of all nodes [m/s2], shape (num_blocks, 3).
            inertia: Returns the sum of the mass matrix times such a field, shape (3,).

        Returns:
            Changes of the two that conserve the momentum of tool and body.
        """
        still = np.zeros_like(surface.normals)
        carried = surface.change(np.zeros_like(v), still + self.direction)
        whole = self.mass + float(inertia(carried) @ self.direction)
        changes, ends = [], []
        here = np.array([self.way])
        own = self._stencil.after(here)
        for of_nodes, of_tool in ((v, own.v), (a, own.a)):
            stopped = surface.change(of_nodes, still)
            end = (self.mass * of_tool - float(inertia(stopped) @ self.direction)) / whole
            changes.append(stopped + end * carried)
            ends.append(end)
        self._state = State(here, ends[0], ends[1])
        return changes[0], changes[1]


# The multipliers contain the forces on tools except for this many times the tolerance.
_OVER_TOLERANCE = 100.0
# Multipliers are updated when the relative residual of the step is below this.
_ROUGH = 1e-2
# The same with friction: above this it is not known which nodes stick and which slip.
_BALANCED = 1e-5
# With friction the multipliers contain the forces except for this at best: the direction of
# friction on a node that hardly slips converges ever more slowly, with hardly any work.
_OF_DRAG = 1e-6


class ImplicitTools:
    """The tools of one implicit run.

    Args:
        problem: The problem with its tools.
        space: Displacement space.
        fixed: Degrees of freedom that are fixed, shape (n,).
        tolerance: Relative residual of a step [-].

    Attributes:
        driven: The tools that are driven by a force.
    """

    def __init__(
        self, problem: Problem, space: TransferredSpace, fixed: Indices, tolerance: float
    ) -> None:
        self._is_rough = any(tool.friction_coefficient > 0.0 for tool in problem.tools)
        carried = _OVER_TOLERANCE * tolerance
        self._carried = max(carried, _OF_DRAG) if self._is_rough else carried
        self._contacts: Sequence[ToolContact] = create_contacts(problem, space, fixed)
        self.driven = tuple(DrivenTool(c) for c in self._contacts if c.tool.drive is not None)
        self._fixed = fixed
        materials = (problem.material, *(i.material for i in problem.inclusions))
        self._density = max(material.density for material in materials)
        self._impulses = np.zeros((len(self._contacts), 3))
        self._last_forces = np.zeros((len(self._contacts), 3))

    def __bool__(self) -> bool:
        return bool(self._contacts)

    @property
    def reached(self) -> list[Indices]:
        """See `ToolContact.reached`."""
        return [group for contact in self._contacts for group in contact.reached]

    def require_outside(self, displacement: Floats) -> None:
        """Raise InputError where a tool is in the body at the start."""
        for contact in self._contacts:
            contact.set_time(0.0)
        gaps = [contact.least_gap(displacement) for contact in self._contacts]
        require_outside(gaps, [contact.is_averaged for contact in self._contacts])
        for contact in self._contacts:
            contact.keep(displacement)

    def begin_step(self, time: float, dt: float, method: AlphaMethod, mass_factor: float) -> None:
        """Move the tools to the end of a step, with the multipliers of the last step.

        Args:
            time: Time at its start [s].
            dt: Length of the step [s].
            method: Parameters of the time integration.
            mass_factor: Factor of the mass in the step's tangent [1/s2].
        """
        for contact in self._contacts:
            contact.stiffen(mass_factor * self._density)
            contact.set_time(time + dt)
            contact.go_back()
        for tool in self.driven:
            tool.begin_step(time, dt, method)

    @property
    def ways(self) -> Floats:
        """Distances of the driven tools along their lines [m], shape (num_driven,)."""
        return np.array([tool.way for tool in self.driven])

    def go_to(self, ways: Floats) -> None:
        """Move the driven tools to distances along their lines [m]."""
        for tool, way in zip(self.driven, ways, strict=True):
            tool.go_to(float(way))

    def lacking(self, displacement: Floats) -> tuple[Floats, Floats]:
        """Residual forces on the driven tools, and the largest of their terms [N]."""
        both = np.array([tool.lacking(displacement) for tool in self.driven]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def are_balanced(self, displacement: Floats, tolerance: float, rounding: float) -> bool:
        """Whether the driven tools are in balance, to a relative tolerance or a rounding [N]."""
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
        """A Newton step of body and driven tools, by the equations above.

        Args:
            solve: Solves with the body's tangent, flat, which may be updated first.
            displacement: Displacement at the start of the step, flat [m].
            residual: Residual of the body there, flat [N].
            is_fresh: Whether the tangent is to be updated.

        Returns:
            The step of the body, flat, and of the tools' distances [m], shape (num_driven,).
        """
        du = solve(residual, is_fresh=is_fresh)
        if not self.driven:
            return du, np.zeros(0)
        rows = [tool.stiffness(displacement) for tool in self.driven]
        couplings = np.array([coupling for coupling, _ in rows])
        responses = np.array(
            [solve(c, is_fresh=False) if fenicsx.norm(c) > 0.0 else 0.0 * c for c in couplings]
        )
        matrix = np.diag([own for _, own in rows]) - fenicsx.total(couplings @ responses.T)
        lacking = self.lacking(displacement)[0] + fenicsx.total(couplings @ du)
        ways: Floats = np.linalg.solve(matrix, lacking)
        return du + ways @ responses, ways

    def end_step(
        self,
        displacement: Floats,
        velocity: Floats,
        acceleration: Floats,
        dt: float,
        late: float,
        momentum: Callable[[Floats, Floats], Floats],
    ) -> tuple[Floats, Floats]:
        """Finish a step that has converged.

        Args:
            displacement: Displacement at its end [m], flat.
            velocity: Velocity by Newmark's formulas [m/s], flat.
            acceleration: Acceleration by Newmark's formulas [m/s2], flat.
            dt: Length of the step [s].
            late: Time from its middle to the balance of forces, over its length [-].
            momentum: Returns the change of the body's momentum by changes of velocity and
                acceleration [N s], flat.

        Returns:
            Velocity and acceleration, where nodes in contact have those of the tool along its
            normal, and in all directions where they stick. By Newmark's formulas the velocity of
            such a node would oscillate about the tool's, and the node would leave it again. The
            momentum that the body gains by this is added to the impulse of the tool.
        """
        v, a = velocity.reshape(-1, 3).copy(), acceleration.reshape(-1, 3).copy()

        def inertia(field: Points) -> Floats:
            flat = momentum(self._free(field.copy()).ravel(), np.zeros_like(velocity))
            whole: Floats = fenicsx.total(flat.reshape(-1, 3).sum(axis=0))
            return whole

        rows = zip(self._impulses, self._last_forces, self._contacts, strict=True)
        for row, last, contact in rows:
            touching = contact.touching(displacement, dt)
            driven = next((tool for tool in self.driven if tool.contact is contact), None)
            if driven is None:
                dv = touching.change(v, touching.velocities)
                da = touching.change(a, np.zeros_like(touching.velocities))
            else:
                dv, da = driven.end_step(touching, v, a, inertia)
            dv, da = self._free(dv), self._free(da)
            given = momentum(dv.ravel(), da.ravel()).reshape(-1, 3).sum(axis=0)
            force = contact.state(displacement).force
            row += dt * (force + late * (last - force)) - fenicsx.total(given)
            last[:] = force
            v, a = v + dv, a + da
            contact.keep(displacement)
        return v.ravel(), a.ravel()

    def _free(self, change: Points) -> Points:
        """A change of nodal values without fixed components, shape (num_blocks, 3)."""
        change.reshape(-1)[self._fixed] = 0.0
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
        """Update the multipliers by the contact forces where the step is nearly in balance.

        Returns:
            Whether they contain the forces, so that the step may end once it is balanced.
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
        """Mean force on each tool since the last call [N], shape (num_tools, 3).

        Args:
            duration: Time since the last call [s]; 0 at the start, where forces are zero.
        """
        means: Points = self._impulses / duration if duration else self._impulses
        self._impulses = np.zeros_like(means)
        return means
