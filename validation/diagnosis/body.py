"""A problem's forces by the judge itself, each part on its own, so that one can be altered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.diagnosis.laws import Array, Law, law_of
from palpate.validation.exchange.nodal_loads import cell_materials, held_components
from palpate.validation.metrics.elasticity import load_force, shape_gradients, sum_at_points

PRESSURE_STAYS = "pressure does not follow the surface (dead load)"
PRESSURE_FOLLOWS = "pressure follows the surface, which linear theory has at rest"
Mask = NDArray[np.bool_]
_KINDS = {
    Traction: "traction",
    Pressure: "pressure",
    PointForce: "point forces",
    BodyForce: "body force",
}


def load_name(index: int, load: Load) -> str:
    """A load for people: its place in the case, from 1, and its kind."""
    return f"load {index + 1} ({_KINDS[type(load)]})"


class Body:
    """Internal force, loads and supports of a problem.

    Attributes:
        free: Components where the sum of forces must vanish, (num_points, 3). Points that a tool
            may touch are left out: what it pushes there is not known.
        held: Components that are held.
        prescribed: Where they are held [m], at full amplitude.
        touchable: Points that a tool may touch, (num_points,).
    """

    def __init__(self, problem: Problem, strain: Strain) -> None:
        self.problem, self.strain, self.mesh = problem, strain, problem.mesh
        self._gradients = shape_gradients(problem.mesh)
        volumes = signed_volumes(problem.mesh.points, problem.mesh.cells)
        self._by_volume = volumes[:, None, None] * self._gradients
        E, nu = cell_materials(problem)[:, :2].T
        self.lmbda: Array = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        self.mu: Array = E / (2.0 * (1.0 + nu))
        fixed, self.prescribed = held_components(problem)
        self.held: Mask = fixed.astype(bool)
        self.touchable: Mask = np.zeros(problem.mesh.num_points, dtype=bool)
        for tool in problem.tools:
            # None named: all of the boundary may touch.
            facets = tool.contact_facets if len(tool.contact_facets) else self.mesh.boundary_facets
            self.touchable[np.unique(facets)] = True
        self.free: Mask = ~self.held & ~self.touchable[:, None]
        self._at_rest = [
            load_force(problem.mesh, load, np.zeros_like(problem.mesh.points), strain)
            for load in problem.loads
        ]

    def gradient(self, displacement: Points) -> Array:
        """Of the displacement, by cell [-], (num_cells, 3, 3)."""
        corners = displacement[self.mesh.cells].transpose(0, 2, 1)
        gradients: Array = corners @ self._gradients
        return gradients

    def force_of(self, stress: Array) -> Points:
        """Nodal force of a first Piola-Kirchhoff stress [N]."""
        by_corner = self._by_volume @ stress.transpose(0, 2, 1)
        return sum_at_points(self.mesh.cells, by_corner, self.mesh.num_points)

    def internal(
        self,
        displacement: Points,
        law: Law | None = None,
        lame: tuple[Array, Array] | None = None,
    ) -> Points:
        """Internal force [N] by the law and the material asked for, or by others.

        NaN where a law has no stress for so large a strain.
        """
        lmbda, mu = lame or (self.lmbda, self.mu)
        try:
            stress = (law or law_of(self.strain))(self.gradient(displacement), lmbda, mu)
        except np.linalg.LinAlgError:
            # A cell that is squeezed flat has no stress by a law that divides by its volume.
            return np.full_like(self.mesh.points, np.nan)
        return self.force_of(stress)

    def load(self, index: int, displacement: Points, *, is_other: bool = False) -> Points:
        """Nodal force of a load at full size [N].

        A pressure follows the surface with Green strain and stays where it was with linear
        strain; `is_other` makes it the other way round.
        """
        load = self.problem.loads[index]
        if isinstance(load, Pressure) and self.follows is not is_other:
            return load_force(self.mesh, load, displacement, Strain.GREEN)
        return self._at_rest[index]

    @property
    def follows(self) -> bool:
        """Whether pressures follow the surface."""
        return self.strain is Strain.GREEN

    def loads(self, displacement: Points, *, is_other: bool = False) -> list[Points]:
        """Each of them, as `load` gives it."""
        numbers = range(len(self._at_rest))
        return [self.load(index, displacement, is_other=is_other) for index in numbers]

    def total(self, forces: list[Points]) -> Points:
        """Their sum; zero for none."""
        return sum(forces, np.zeros_like(self.mesh.points))

    def miss(self, displacement: Points) -> float:
        """How far held components are from where they are held, over the largest displacement."""
        apart = np.abs(displacement - self.prescribed)[self.held].max(initial=0.0)
        return ratio(float(apart), float(np.abs(displacement).max()))

    def residual(self, displacement: Points, internal: Points, external: Points) -> float:
        """What is left of the equations: of forces where free, of places where held."""
        return max(imbalance(internal, external, self.free), self.miss(displacement))


def imbalance(internal: Points, external: Points, rows: Mask) -> float:
    """Largest sum of forces at these components, over the largest nodal force."""
    scale = max(float(np.abs(internal).max()), float(np.abs(external).max()))
    return ratio(float(np.abs(internal - external)[rows].max(initial=0.0)), scale)


def ratio(value: float, scale: float) -> float:
    """Zero over zero is zero: nothing is nothing's part."""
    if not np.isfinite(value) or not np.isfinite(scale):
        return float("inf")
    return value / scale if scale > 0.0 else (0.0 if value == 0.0 else float("inf"))
