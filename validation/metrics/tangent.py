"""What a small further displacement adds to the forces of a body, without a matrix."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.finite_laws import along
from palpate.validation.metrics.laws import strain_of, transposed
from palpate.validation.metrics.springs import stiffness_times


class Tangent:
    """Derivative of internal less external force by the displacement, held components left out.

    Args:
        body: Whose forces.
        displacement: Where [m], (num_points, 3).
    """

    def __init__(self, body: Body, displacement: Points) -> None:
        self.body, self._displacement = body, displacement
        self._H = body.gradient(displacement)
        if body.strain is Strain.GREEN and body.is_linear_in_strain:
            H = self._H
            self._F, self._S = np.eye(3) + H, body.stress(strain_of(H, Strain.GREEN))

    @property
    def is_symmetric(self) -> bool:
        """Whether it is: not where a load follows the surface."""
        return not self.body.has_followers

    def times(self, change: Points) -> Points:
        """The forces [N] of a change [m], both (num_points, 3) and 0 where held.

        d(F S) = F (C : sym(F^T dH)) + dH S; with linear strain F = 1 and S = 0; by another law dP.
        """
        body = self.body
        dH = body.gradient(change)
        if not body.is_linear_in_strain:
            stress = along(body.first_stress, self._H, dH)
        elif body.strain is Strain.GREEN:
            dE = transposed(self._F) @ dH
            stress = self._F @ body.stress(0.5 * (dE + transposed(dE))) + dH @ self._S
        else:
            stress = body.stress(strain_of(dH, Strain.LINEAR))
        force = body.force_of(stress)
        if body.has_followers:
            force -= self._load_change(change)
        if body.problem.springs:
            force = force + stiffness_times(body.mesh, body.problem.springs, change)
        return body.freed(force)

    def _load_change(self, change: Points) -> Points:
        """Of pressures, which are quadratic in the displacement: central differences are exact."""
        far = float(np.abs(change).max())
        if not far > 0.0:
            return np.zeros_like(change)
        length = float(np.ptp(self.body.mesh.points, axis=0).max()) / far
        body, ends = self.body, []
        for sign in (1.0, -1.0):
            ends.append(body.total(body.loads(self._displacement + sign * length * change)))
        found: Points = (ends[0] - ends[1]) / (2.0 * length)
        return found
