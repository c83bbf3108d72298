"""Tools driven by a force in implicit steps: how far along its line is one more unknown of each.

    m s'' = F(t) + d . R,    the tool at its first pose, s d further on

with R what the body puts on it, by the formulas of the body (`dynamics`) and together with it: with
K its tangent, of which K_c is the tools', a Newton step solves

    | K        -K_c d           | |du|   |what the body is out of balance|
    | -d K_c   m f + d . K_c d  | |ds| = |what the tool is               |

where f is the factor of the mass in K.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.reference import fenicsx
from palpate.reference.contact.tool_contact import HeldNodes, ToolContact

if TYPE_CHECKING:
    from palpate.reference.generalised_alpha import AlphaMethod


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
        self.way, self._speed = 0.0, 0.0
        self._acceleration = self._push(0.0) / self.mass
        self._kept = self.way
        self._pushed = 0.0

    def _push(self, time: float) -> float:
        return self._drive.force * self._drive.amplitude(time)

    def begin_step(self, time: float, dt: float, method: AlphaMethod) -> None:
        """Go on from the last step that was kept, by a guess; arguments as of `Motion.step`."""
        self._dt, self._method = dt, method
        self._pushed = self._push(time + (1.0 - method.alpha_f) * dt)
        self.go_to(self._kept + dt * self._speed + 0.5 * dt**2 * self._acceleration)

    def go_to(self, way: float) -> None:
        """Put the tool so far along its line [m]."""
        self.way = way
        self.contact.move(way)

    def lacking(self, displacement: Floats) -> tuple[float, float]:
        """The force that is out of balance, and the largest of those in it [N]."""
        felt = float(self.contact.state(displacement).force @ self.direction)
        m = self._method
        ahead = (1.0 - m.alpha_m) * self._ends_at()[1] + m.alpha_m * self._acceleration
        inertia = self.mass * ahead
        return self._pushed + felt - inertia, max(abs(self._pushed), abs(felt), abs(inertia))

    def _ends_at(self) -> tuple[float, float]:
        """Speed [m/s] and acceleration [m/s2] at the end of the step, by Newmark's formulas."""
        m, dt, a = self._method, self._dt, self._acceleration
        gone = self.way - self._kept - dt * self._speed
        new = gone / (m.beta * dt**2) - (0.5 / m.beta - 1.0) * a
        return self._speed + dt * ((1.0 - m.gamma) * a + m.gamma * new), new

    def stiffness(self, displacement: Floats) -> tuple[Floats, float]:
        """K_c d of the body's unknowns, flat, and m f + d . K_c d [N/m]."""
        m = self._method
        coupling = self.contact.derivative_of_force(displacement, self.direction)
        own = float(fenicsx.total(float(coupling.reshape(-1, 3).sum(axis=0) @ self.direction)))
        return coupling, self.mass * (1.0 - m.alpha_m) / (m.beta * self._dt**2) + own

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
        changes = []
        ends = []
        for of_nodes, of_tool in zip((v, a), self._ends_at(), strict=True):
            stopped = held.change(of_nodes, still)
            end = (self.mass * of_tool - float(inertia(stopped) @ self.direction)) / whole
            changes.append(stopped + end * carried)
            ends.append(end)
        self._speed, self._acceleration = ends
        self._kept = self.way
        return changes[0], changes[1]
