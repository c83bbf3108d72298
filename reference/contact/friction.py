"""Coulomb friction by multipliers, as of contact (`tool_contact`).

With the displacement s of a constraint along the tool since the last equilibrium, relative to the
tool, the normal n, and a multiplier q per rest area:

    trial = q - k s,   t = trial where |trial| <= mu p, else mu p trial / |trial|

so that it slips against friction where more than mu p would be needed for it to stick. A node has
its own displacement and normal. Over facets both are averages, with the parts of the gap: s_i is
the sum of c_qi s_q over the points, n_i that of c_qi n_q, of unit length; and t_i is spread like a
pressure, a_i c_qi t_i at each point. The averages of linear displacements are those of the nodes
(B. Wohlmuth, A mortar finite element method using dual spaces for the Lagrange multiplier, SIAM J.
Numer. Anal. 38 (2000) 989-1012), so that constraints slip independently of each other (M. Gitterle,
A. Popp, M. W. Gee, W. A. Wall, Finite deformation frictional mortar contact using a semi-smooth
Newton method with consistent linearization, Int. J. Numer. Meth. Engng 84 (2010) 543-571).

In motion s is that of one step: friction is that at the step's end (backward Euler). The bound uses
the multiplier p, not the pressure of the iterate, and both are updated after each equilibrium: the
tangent remains symmetric (T. A. Laursen, J. C. Simo, Algorithmic symmetrization of Coulomb
frictional problems using augmented Lagrangians, Comput. Methods Appl. Mech. Engrg. 108 (1993)
133-146), and the limit is Coulomb's law with the pressure itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Points


@dataclass(frozen=True, eq=False)
class Drag:
    """Friction of n constraints.

    Attributes:
        traction: Traction on the body per rest area [Pa], shape (n, 3).
        stiffness: Minus its derivative by the node's position, at this normal and bound [Pa/m],
            shape (n, 3, 3), symmetric.
        sticks: Whether a pressed constraint has friction below the bound, shape (n,).
    """

    traction: Points
    stiffness: Floats
    sticks: NDArray[np.bool_]


def no_drag(count: int) -> Drag:
    """That of so many constraints without friction."""
    return Drag(np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count, np.bool_))


class Friction:
    """Multipliers of friction, and the position on the tool at which each constraint sticks.

    Args:
        coefficient: Coulomb's mu [-], >= 0.
        count: Number of constraints.
    """

    def __init__(self, coefficient: float, count: int) -> None:
        self.coefficient = coefficient
        # Multipliers and positions are in the tool's frame, with which they rotate.
        self._multiplier: Points = np.zeros((count, 3))
        self._kept: Points = self._multiplier
        self._stuck_at: Points = np.zeros((count, 3))

    def keep(self, local: Points) -> None:
        """Accept an equilibrium with these (averages of) positions in the tool's frame [m]."""
        self._kept, self._stuck_at = self._multiplier, local

    def go_back(self) -> None:
        """Begin anew from the last accepted equilibrium."""
        self._multiplier = self._kept

    def let_go(self, which: NDArray[np.bool_]) -> None:
        """Remove the friction of some constraints, shape (n,)."""
        self._multiplier = np.where(which[:, None], 0.0, self._multiplier)

    def carried(self, rotation: Floats) -> Points:
        """The multipliers in the global frame [Pa], shape (n, 3)."""
        carried: Points = self._multiplier @ rotation.T
        return carried

    def take_over(self, traction: Points, rotation: Floats) -> None:
        """Set the multipliers to tractions in the global frame [Pa], shape (n, 3)."""
        self._multiplier = traction @ rotation

    def drag(
        self, local: Points, rotation: Floats, normal: Points, pressure: Floats, penalty: float
    ) -> Drag:
        """Friction at positions in the tool's frame.

        Args:
            local: Positions, or their averages [m], shape (n, 3).
            rotation: From the tool's frame to the global one, shape (3, 3).
            normal: Unit normals of the tool in the global frame [-], shape (n, 3).
            pressure: Multipliers of contact, which bound friction [Pa], shape (n,).
            penalty: k [Pa/m].
        """
        trial = (self._multiplier - penalty * (local - self._stuck_at)) @ rotation.T
        trial -= np.sum(trial * normal, axis=1)[:, None] * normal
        size, bound = np.linalg.norm(trial, axis=1), self.coefficient * pressure
        slips = size > bound
        along = trial / np.where(size > 0.0, size, 1.0)[:, None]
        part = np.where(slips, bound / np.where(slips, size, 1.0), 1.0)
        plane = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        plane -= np.where(slips[:, None, None], along[:, :, None] * along[:, None, :], 0.0)
        stiffness = (penalty * part)[:, None, None] * plane
        return Drag(part[:, None] * trial, stiffness, ~slips & (bound > 0.0))
