"""Energy and nodal forces of a displacement, worked out by the judge itself for both sides.

Plain NumPy on linear tetrahedra, apart from fastsim and from the reference. Only what follows
from the displacement and the case's law can be measured so. Each part stands on its own, so that
one can be altered.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Load, Pressure
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import (
    FACET_POINTS,
    FACET_WEIGHTS,
    cell_materials,
    cell_values,
    facet_areas,
    fixed_components,
    nodal_force,
    pushes_of_supports,
    sliding_points,
    touchable_points,
)
from palpate.validation.metrics.laws import (
    MEASURES,
    LawOfCells,
    energy_density,
    finite_stress,
    hooke,
    push_forward,
    strain_of,
)
from palpate.validation.metrics.smoothing import Array, Smoothing

Mask = NDArray[np.bool_]


def shape_gradients(mesh: TetMesh) -> Array:
    """Rest gradients of the four linear shape functions of each cell [1/m], (num_cells, 4, 3)."""
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    return np.concatenate([-inverse.sum(axis=1)[:, None], inverse], axis=1)


def sum_at_points(points: Indices, forces: Array, num_points: int) -> Points:
    """Sum forces (n, k, 3) of the corners of cells or facets (n, k) at the points they name."""
    flat, rows = points.ravel(), forces.reshape(-1, 3)
    summed: Points = np.stack(
        [np.bincount(flat, rows[:, axis], num_points) for axis in range(3)], axis=1
    )
    return summed


def load_force(mesh: TetMesh, load: Load, displacement: Points, strain: Strain) -> Points:
    """Force of any load at full size on each point [N], (num_points, 3).

    A pressure follows: -p times a third of the deformed facet's area along its outward normal at
    each corner, exact on linear tetrahedra; with linear strain on the facet at rest.
    """
    if not isinstance(load, Pressure):
        return nodal_force(mesh, load)
    positions = mesh.points if strain is Strain.LINEAR else mesh.points + displacement
    a, b, c = (positions[load.facets[:, k]] for k in range(3))
    thirds = -load.pressure / 6.0 * np.cross(b - a, c - a)
    return sum_at_points(load.facets, np.repeat(thirds[:, None], 3, axis=1), mesh.num_points)


def spring_force(
    mesh: TetMesh, spring: Spring, displacement: Points, time: float | None = None
) -> Points:
    """Force of a spring on each point [N], (num_points, 3), at a time on its anchor's path [s].

    Without a time at the end of the path, at full stiffness.
    """
    anchor = spring.path.end if time is None else spring.path.at(time)
    kappa = spring.densities(mesh.points)
    if time is not None and spring.amplitude is not None:
        kappa = spring.amplitude(time) * kappa
    apart = anchor - displacement[spring.facets]
    return _integrated(mesh, spring, kappa, apart)


def spring_stiffness_times(mesh: TetMesh, springs: Sequence[Spring], change: Points) -> Points:
    """Forces with which springs at full stiffness resist a further motion [N], (num_points, 3)."""
    force = np.zeros_like(change)
    for spring in springs:
        kappa = spring.densities(mesh.points)
        force += _integrated(mesh, spring, kappa, change[spring.facets])
    return force


def _integrated(mesh: TetMesh, spring: Spring, kappa: Floats, field: Points) -> Points:
    """Integral of kappa f N_a over the patch; both by the corners of the facets."""
    force = np.zeros_like(mesh.points)
    areas = facet_areas(mesh.points, spring.facets)
    for point, weight in zip(FACET_POINTS, FACET_WEIGHTS, strict=True):
        pushed = (weight * areas * (kappa @ point))[:, None] * np.einsum("k,mkj->mj", point, field)
        for corner, fraction in enumerate(point):
            np.add.at(force, spring.facets[:, corner], fraction * pushed)
    return force


class Body:
    """Energy, internal force, loads and supports of a problem.

    Smoothed tetrahedra differ by their energy and internal force alone. `lmbda`, `mu` (Lamé's
    parameters) and `c01` (of Mooney and Rivlin's law) are by cell [Pa]; `fixed` are components that
    supports fix, (num_points, 3), `prescribed` their displacement at full amplitude [m]; `slopes`
    are points that slide along slanted planes, None where none does.
    """

    def __init__(self, problem: Problem, strain: Strain, element: Element = Element.LINEAR) -> None:
        self.problem, self.strain, self.mesh = problem, strain, problem.mesh
        self._gradients = shape_gradients(problem.mesh)
        self.volumes = signed_volumes(problem.mesh.points, problem.mesh.cells)
        self._by_volume = self.volumes[:, None, None] * self._gradients
        E, nu = cell_materials(problem)[:, :2].T
        self.lmbda: Array = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        self.mu: Array = E / (2.0 * (1.0 + nu))
        self.law, self._terms = problem.material.law, problem.material.ogden_terms
        self.c01: Array = cell_values(problem, lambda material: material.c01)
        self._smoothing: Smoothing | None = None
        if element is Element.SMOOTHED:
            c01 = None if self.is_linear_in_strain else self.c01
            self._smoothing = Smoothing(self.mesh, self.lmbda, self.mu, c01)
        fixed, self.prescribed = fixed_components(problem)
        self.fixed: Mask = fixed.astype(bool)
        self.slopes = sliding_points(problem)

    @cached_property
    def touchable(self) -> Mask:  # noqa: D102  (an attribute above)
        return touchable_points(self.problem)

    @cached_property
    def free(self) -> Mask:  # noqa: D102
        free: Mask = ~self.fixed & ~self.touchable[:, None]
        if self.slopes is not None:
            free[self.slopes.points] = False
        return free

    @property
    def follows(self) -> bool:
        """Whether pressures follow the surface."""
        return self.strain is Strain.GREEN

    @property
    def has_followers(self) -> bool:
        """Whether the loads depend on the displacement."""
        return self.follows and any(isinstance(load, Pressure) for load in self.problem.loads)

    def gradient(self, displacement: Points) -> Array:
        """Gradient of the displacement by cell [-], (num_cells, 3, 3)."""
        corners = displacement[self.mesh.cells].transpose(0, 2, 1)
        gradients: Array = corners @ self._gradients
        return gradients

    def energy(self, displacement: Points) -> float:
        """Integral of psi = lmbda/2 tr(E)^2 + mu tr(E^2), or of the law's W, over the rest [J]."""
        if not self.is_linear_in_strain:
            H = self.gradient(displacement)
            if self._smoothing is not None:
                return self._smoothing.law_energy(self.law, H, self._terms)
            moduli = (self.lmbda, self.mu, self.c01, self._terms)
            return float(self.volumes @ energy_density(self.law, H, *moduli))
        E = strain_of(self.gradient(displacement), self.strain)
        energy = 0.5 * float(self.volumes @ np.einsum("cij,cij->c", E, self.stress(E)))
        if self._smoothing is not None and self.strain is Strain.GREEN:
            energy += self._smoothing.blend_energy(E)
        return energy

    @property
    def is_smoothed(self) -> bool:
        """Whether a cell's forces depend on its neighbours."""
        return self._smoothing is not None

    @property
    def is_linear_in_strain(self) -> bool:
        """Whether S = lmbda tr(E) I + 2 mu E, with the strain asked for."""
        return self.strain is Strain.LINEAR or self.law.is_linear_in_strain

    def stress(self, strain: Array) -> Array:
        """The stress that belongs to a strain by cell [Pa], both (num_cells, 3, 3)."""
        if self._smoothing is not None:
            return self._smoothing.stress(strain)
        return hooke(strain, self.lmbda, self.mu)

    def force_of(self, stress: Array) -> Points:
        """Nodal force of a first Piola-Kirchhoff stress [N]; sums to zero."""
        by_corner = self._by_volume @ stress.transpose(0, 2, 1)
        return sum_at_points(self.mesh.cells, by_corner, self.mesh.num_points)

    def internal(
        self,
        displacement: Points,
        law: LawOfCells | None = None,
        lame: tuple[Array, Array] | None = None,
    ) -> Points:
        """Derivative of the energy by the points [N], by the law and material asked for, or others.

        NaN where a law has no stress for so large a strain.
        """
        H = self.gradient(displacement)
        try:
            if law is None:
                body = self if lame is None else self._of_other_material(*lame)
                stress = body.first_stress(H)
            elif self._smoothing is not None and law in MEASURES:
                smoothing = self._smoothing if lame is None else Smoothing(self.mesh, *lame)
                measure = MEASURES[law]
                of = smoothing.blended_stress if measure is Strain.GREEN else smoothing.stress
                stress = push_forward(H, of(strain_of(H, measure)), measure)
            else:
                stress = law(H, *(lame or (self.lmbda, self.mu)))
        except np.linalg.LinAlgError:
            # A cell that is squeezed flat has no stress by a law that divides by its volume.
            return np.full_like(self.mesh.points, np.nan)
        return self.force_of(stress)

    def _of_other_material(self, lmbda: Array, mu: Array) -> Body:
        """The same body with other parameters by cell; Mooney and Rivlin's in proportion to mu."""
        body = copy.copy(self)
        body.lmbda, body.mu, body.c01 = lmbda, mu, self.c01 * (mu / self.mu)
        if self._smoothing is not None:
            c01 = None if self.is_linear_in_strain else body.c01
            body._smoothing = Smoothing(self.mesh, lmbda, mu, c01)
        return body

    def viscous(self, displacement: Points, before: Points) -> Points:
        """Forces [N] of the stress at rest by what the strain has changed since `before` [m].

        Times stiffness damping over the step, those of stiffness damping.
        """
        H, H_before = self.gradient(displacement), self.gradient(before)
        change = strain_of(H, self.strain) - strain_of(H_before, self.strain)
        return self.force_of(push_forward(H, self.stress(change), self.strain))

    def stresses(self, displacement: Points) -> tuple[Array, Array]:
        """Cauchy's and the first Piola-Kirchhoff stress of each cell [Pa], (num_cells, 3, 3).

        P as the element takes it, sigma = P F^T / det F; with engineering strain both are S. Not
        finite where a cell is flat.
        """
        H = self.gradient(displacement)
        try:
            P = self.first_stress(H)
        except np.linalg.LinAlgError:
            P = np.full_like(H, np.nan)
        if self.strain is Strain.LINEAR:
            return P, P
        F = np.eye(3) + H
        with np.errstate(all="ignore"):
            sigma: Array = P @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]
        return sigma, P

    def first_stress(self, H: Array) -> Array:
        """P of displacement gradients as the element takes it; H may be complex."""
        if self.is_linear_in_strain:
            E = strain_of(H, self.strain)
            if self._smoothing is not None and self.strain is Strain.GREEN:
                return push_forward(H, self._smoothing.blended_stress(E), self.strain)
            return push_forward(H, self.stress(E), self.strain)
        if self._smoothing is not None:
            return self._smoothing.law_stress(self.law, H, self._terms)
        return finite_stress(self.law, H, self.lmbda, self.mu, self.c01, self._terms)

    def least_moduli(self, displacement: Points) -> Floats:
        """Least tangent modulus of Saint-Venant-Kirchhoff by cell, over that at rest [-], (n,).

        Where it is not above 0 no equilibrium is stable (J. E. Marsden, T. J. R. Hughes,
        Mathematical Foundations of Elasticity, 1983, section 3.4): S_i + (lmbda + 2 mu) l_i^2 along
        the principal stretches l, S_j + mu l_i^2 in the shears between them. 1 of other laws and of
        linear strain.
        """
        if self.strain is Strain.LINEAR or not self.law.is_linear_in_strain:
            return np.ones(self.mesh.num_cells)
        E = strain_of(self.gradient(displacement), Strain.GREEN)
        # E, S and C have the same axes.
        e = np.linalg.eigvalsh(E)
        l2, (lmbda, mu) = 1.0 + 2.0 * e, (of[:, None] for of in (self.lmbda, self.mu))
        S = lmbda * e.sum(axis=1, keepdims=True) + 2.0 * mu * e
        pairs = ~np.eye(3, dtype=bool)
        shears = (S[:, None, :] + mu[:, None] * l2[:, :, None])[:, pairs] / mu
        along = S / (lmbda + 2.0 * mu) + l2
        least: Floats = np.concatenate([along, shears], axis=1).min(axis=1)
        return least

    @cached_property
    def stiffness_diagonal(self) -> Points:
        """Diagonal of the stiffness at rest [N/m], (num_points, 3).

        Of corner a along i: V ((lmbda + mu) (grad_i N_a)^2 + mu |grad N_a|^2).
        """
        lmbda, mu, volumes = (a[:, None, None] for a in (self.lmbda, self.mu, self.volumes))
        squared = self._gradients**2
        by_corner = volumes * ((lmbda + mu) * squared + mu * squared.sum(axis=2, keepdims=True))
        return sum_at_points(self.mesh.cells, by_corner, self.mesh.num_points)

    def load(self, index: int, displacement: Points, *, is_other: bool = False) -> Points:
        """Nodal force of a load at full size [N].

        A pressure follows the surface with Green strain and stays where it was with linear
        strain; `is_other` makes it the other way round.
        """
        load = self.problem.loads[index]
        if isinstance(load, Pressure) and self.follows is not is_other:
            return load_force(self.mesh, load, displacement, Strain.GREEN)
        return self._loads_at_rest[index]

    @cached_property
    def _loads_at_rest(self) -> list[Points]:
        still = np.zeros_like(self.mesh.points)
        return [load_force(self.mesh, load, still, self.strain) for load in self.problem.loads]

    def loads(self, displacement: Points, *, is_other: bool = False) -> list[Points]:
        """Each of them, as `load` gives it."""
        numbers = range(len(self.problem.loads))
        return [self.load(index, displacement, is_other=is_other) for index in numbers]

    def total(self, forces: Sequence[Points]) -> Points:
        """Sum of forces; zero for none."""
        return sum(forces, np.zeros_like(self.mesh.points))

    def external(
        self,
        displacement: Points,
        time: float | None = None,
        *,
        factors: Sequence[float] | None = None,
        is_other: bool = False,
    ) -> Points:
        """Sum of all loads and springs [N], tools left out; pressures and springs follow the body.

        Amplitudes are taken at the time [s], none where it is None; `factors` are those of each
        load beside its amplitude; for `is_other` see `load`.
        """
        force = np.zeros_like(self.mesh.points)
        for index, load in enumerate(self.problem.loads):
            factor = 1.0 if factors is None else factors[index]
            if time is not None and load.amplitude is not None:
                factor *= load.amplitude(time)
            if factor:
                force += factor * self.load(index, displacement, is_other=is_other)
        return force + self.pull_of_springs(displacement, time)

    def pull_of_springs(self, displacement: Points, time: float | None = None) -> Points:
        """Sum of all springs [N], (num_points, 3), at a time [s]; where their paths end if None."""
        pulled = [spring_force(self.mesh, s, displacement, time) for s in self.problem.springs]
        return self.total(pulled)

    def out_of_balance(self, displacement: Points) -> tuple[Points, float]:
        """What is left of external and internal forces where nothing is fixed, tools left out.

        Returns:
            External less internal force [N], (num_points, 3), 0 in fixed components; and the
            largest force of a point [N] to hold it against, infinite where one is no number.
        """
        internal, external = self.internal(displacement), self.external(displacement)
        scale = np.linalg.norm(np.concatenate([internal, external]), axis=1).max()
        left = self.freed(external - internal)
        return left, float(scale) if np.isfinite(scale) else np.inf

    def support_reactions(self, displacement: Points) -> Points:
        """Total force that each support exerts in its fixed components [N], (num_supports, 3).

        The internal force less the dead loads and the springs at the fixed points: zero elsewhere
        in equilibrium. Follower pressure on fixed points is not subtracted.
        """
        span = self.problem.time
        force = self.internal(displacement) - dead_force(self.problem)
        force -= self.pull_of_springs(displacement, None if span is None else span.end_time)
        return pushes_of_supports(self.problem, force)

    def miss(self, displacement: Points) -> float:
        """How far fixed components are from their supports, over the largest displacement."""
        apart = np.abs(self.to_supports(displacement)).max(initial=0.0)
        return relative_to(float(apart), float(np.abs(displacement).max()))

    def freed(self, vectors: Points) -> Points:
        """Vectors without their fixed components, (num_points, 3)."""
        free = np.where(self.fixed, 0.0, vectors)
        return free if self.slopes is None else self.slopes.without(free)

    def to_supports(self, displacement: Points) -> Points:
        """How far fixed components are from where supports put them [m], 0 elsewhere."""
        gap = np.where(self.fixed, self.prescribed - displacement, 0.0)
        if self.slopes is not None:
            slid = self.slopes.displacements - self.slopes.fixed_part(displacement)
            gap[self.slopes.points] = slid
        return gap


# Several metrics and relations use these numbers of a problem: they are computed once.
body_of = lru_cache(maxsize=2)(Body)


def factor_at_end(problem: Problem, load: Load) -> float:
    """Factor of a load at the end of a motion; 1 in statics."""
    if problem.time is None or load.amplitude is None:
        return 1.0
    return load.amplitude(problem.time.end_time)


def forces_at_end(
    problem: Problem, displacement: Points, strain: Strain
) -> list[tuple[Load | Spring, Points]]:
    """Each load and spring with its nodal force [N], (num_points, 3), at the end of a motion.

    Pressures and springs follow the displacement [m]; under linear strain pressures stay at rest.
    """
    mesh, time = problem.mesh, None if problem.time is None else problem.time.end_time
    loads = [
        (load, factor_at_end(problem, load) * load_force(mesh, load, displacement, strain))
        for load in problem.loads
    ]
    springs = [(s, spring_force(mesh, s, displacement, time)) for s in problem.springs]
    return [*loads, *springs]


def dead_force(problem: Problem) -> Points:
    """Sum of all dead loads at the end [N], (num_points, 3); pressures and tools left out."""
    force = np.zeros_like(problem.mesh.points)
    for load in problem.loads:
        force += factor_at_end(problem, load) * nodal_force(problem.mesh, load)
    return force


def imbalance(internal: Points, external: Points, rows: Mask) -> float:
    """Largest sum of forces at these components, over the largest nodal force."""
    scale = max(float(np.abs(internal).max()), float(np.abs(external).max()))
    return relative_to(float(np.abs(internal - external)[rows].max(initial=0.0)), scale)


def relative_to(value: float, scale: float) -> float:
    """Zero over zero is zero: nothing is nothing's part."""
    if not np.isfinite(value) or not np.isfinite(scale):
        return float("inf")
    return value / scale if scale > 0.0 else (0.0 if value == 0.0 else float("inf"))
