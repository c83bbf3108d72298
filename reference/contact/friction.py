"""Coulomb friction of the nodes on a tool, by the augmented Lagrangian: stick and slip.

With the way s of a node along the tool since the last equilibrium, seen from the tool, the normal
n, and a multiplier q per rest area:

    trial = q - k s,   t = trial where |trial| <= mu p, else mu p trial / |trial|

so that a node slips, against its drag, where it would take more than mu p to hold it. In motion the
way is that of one step: its drag is that at the step's end (backward Euler). The bound is of the
multiplier p, not of the pressure of the iterate, and both are taken over after each
equilibrium: the tangent stays symmetric (T. A. Laursen, J. C. Simo, Algorithmic symmetrization of
Coulomb frictional problems using augmented Lagrangians, Comput. Methods Appl. Mech. Engrg. 108
(1993) 133-146), and what it settles to is Coulomb's law with the pressure itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Points


@dataclass(frozen=True, eq=False)
class Drag:
    """What friction does to n nodes.

    Attributes:
        traction: On the body by rest area [Pa], shape (n, 3).
        stiffness: Minus its derivative by the node's place, at this normal and bound [Pa/m], shape
            (n, 3, 3), symmetric.
        sticks: Whether a pressed node is held by less than the bound, shape (n,).
    """

    traction: Points
    stiffness: Floats
    sticks: NDArray[np.bool_]


class Friction:
    """Multipliers of friction, and where on the tool each node is held.

    Args:
        coefficient: Coulomb's mu [-], >= 0.
        count: Number of nodes.
    """

    def __init__(self, coefficient: float, count: int) -> None:
        self.coefficient = coefficient
        # In the tool's frame, with which they turn.
        self._multiplier: Points = np.zeros((count, 3))
        self._kept: Points = self._multiplier
        self._held_at: Points = np.zeros((count, 3))

    def keep(self, local: Points) -> None:
        """Go on from an equilibrium with the nodes at these places in the tool's frame [m]."""
        self._kept, self._held_at = self._multiplier, local

    def go_back(self) -> None:
        """Begin anew from the last equilibrium that was kept."""
        self._multiplier = self._kept

    def let_go(self, which: NDArray[np.bool_]) -> None:
        """Forget the drag on some nodes, shape (n,)."""
        self._multiplier = np.where(which[:, None], 0.0, self._multiplier)

    def carried(self, rotation: Floats) -> Points:
        """What the multipliers stand for in space [Pa], shape (n, 3)."""
        carried: Points = self._multiplier @ rotation.T
        return carried

    def take_over(self, traction: Points, rotation: Floats) -> None:
        """Take tractions in space as the new multipliers [Pa], shape (n, 3)."""
        self._multiplier = traction @ rotation

    def drag(
        self, local: Points, rotation: Floats, normal: Points, pressure: Floats, penalty: float
    ) -> Drag:
        """Friction at places in the tool's frame.

        Args:
            local: [m], shape (n, 3).
            rotation: From the tool's frame to space, shape (3, 3).
            normal: Of the tool in space [-], shape (n, 3).
            pressure: Multipliers of contact, which bound it [Pa], shape (n,).
            penalty: k [Pa/m].
        """
        count = len(local)
        if self.coefficient == 0.0:
            return Drag(np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count, np.bool_))
        trial = (self._multiplier - penalty * (local - self._held_at)) @ rotation.T
        trial -= np.sum(trial * normal, axis=1)[:, None] * normal
        size, bound = np.linalg.norm(trial, axis=1), self.coefficient * pressure
        slips = size > bound
        along = trial / np.where(size > 0.0, size, 1.0)[:, None]
        part = np.where(slips, bound / np.where(slips, size, 1.0), 1.0)
        plane = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        plane -= np.where(slips[:, None, None], along[:, :, None] * along[:, None, :], 0.0)
        stiffness = (penalty * part)[:, None, None] * plane
        return Drag(part[:, None] * trial, stiffness, ~slips & (bound > 0.0))
