"""A mass that hangs on the surface without stiffness of its own, as plain data in SI units.

The mass m is spread over boundary facets by their rest area A: m / A per area [kg/m2], on every
mesh. It is inert, int_S m/A u'' . v dA, turning of what hangs there left out. A lumped mass matrix
has a third of each facet's part at each of its corners. Its weight is a load of its own, as the
weight of the body is: `PointMass.weight`.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import LARGEST_CONSTANT
from palpate.meshes.triangles import facet_areas


@dataclass(frozen=True, eq=False)
class PointMass:
    """A mass spread evenly over a part of the boundary; see the module.

    Args:
        facets: Boundary facets that bear it, shape (m, 3), m >= 1.
        mass: Whole mass [kg], >= 0.
        name: For people, and for experiments that change it.

    Raises:
        InputError: A mass that is negative, not finite or too large to compute with.

    >>> import numpy as np
    >>> import palpate
    >>> mass = palpate.PointMass([[0, 1, 2]], 0.1)
    >>> corners = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.01, 0.0]])
    >>> round(mass.density(corners), 6)  # kg/m2
    1000.0
    >>> [round(t) for t in mass.weight(corners, (0.0, 0.0, -9.81)).traction]  # Pa
    [0, 0, -9810]
    """

    facets: Indices
    mass: float
    name: str = ""

    def __post_init__(self) -> None:
        if not 0.0 <= self.mass <= LARGEST_CONSTANT:
            raise InputError(
                f"mass = {self.mass:g} kg{self._called}: needs a value >= 0, at most "
                f"{LARGEST_CONSTANT:g}"
            )

    @property
    def _called(self) -> str:
        return f" of {self.name!r}" if self.name else ""

    def density(self, points: Points) -> float:
        """Mass per rest area [kg/m2], of points at rest [m], shape (num_points, 3).

        Raises:
            InputError: The mass has no facets.
        """
        if not len(self.facets):
            raise InputError(
                f"a mass{self._called} has no facets, over which it is spread: name some"
            )
        return self.mass / float(facet_areas(points[self.facets]).sum())

    def weight(
        self,
        points: Points,
        acceleration: tuple[float, float, float],
        amplitude: TabularAmplitude | None = None,
    ) -> Traction:
        """The weight as a load: the dead traction m/A g.

        Args:
            points: Of the mesh at rest [m], shape (num_points, 3).
            acceleration: g [m/s2], shape (3,).
            amplitude: Factor over time [-].

        Raises:
            InputError: The mass has no facets.
        """
        density = self.density(points)
        x, y, z = (density * a for a in acceleration)
        return Traction(self.facets, (x, y, z), amplitude)
