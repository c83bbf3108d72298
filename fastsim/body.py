"""An elastic body of tetrahedra: forces, energy, stiffness, mass and time step (eq. 1-10).

f_a = sum over cells of V P grad N_a (eq. 1), P from S = lmbda tr(E) I + 2 mu E (eq. 2);
engineering strain (eq. 3-4) gives R(a) = K a (eq. 5), Green strain (eq. 6-7) gives
R(a) = (K + P(a)) a (eq. 8), the Saint-Venant-Kirchhoff solid, or the material's other law:
core/mechanics/hyperelastic.hpp. The smoothed element averages the cells' strains before it
computes their stress: core/mechanics/smoothed_tet4.hpp. Under other laws smoothed_law.hpp states
which part of the energy is averaged over edges and which over nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim import _core
from palpate.fastsim.forces import lumped_areas, sum_at_points
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

# Of dividing the mass among the patches of the smoothed element; more gain a hundredth.
_ROUNDS_OF_BOUND = 8


def lame_parameters(material: Material) -> tuple[float, float]:
    """First Lamé parameter and shear modulus [Pa] of an isotropic solid."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def materials_of_cells(
    mesh: TetMesh, material: Material, inclusions: Sequence[Inclusion]
) -> tuple[Floats, Indices]:
    """Lamé's parameters, c01 [Pa], density [kg/m3] of each material, and the row of each cell."""
    materials = (material, *(i.material for i in inclusions))
    rows = [(*lame_parameters(m), m.c01, m.density) for m in materials]
    table, row = np.unique(rows, axis=0, return_inverse=True)
    number = np.zeros(mesh.num_cells, dtype=np.int32)
    for k, inclusion in enumerate(inclusions, start=1):
        number[inclusion.cells] = k
    return table, row.reshape(-1)[number]


@dataclass(frozen=True)
class CrushedCell:
    """A cell, its centre at rest [m], its det F [-], and the mean of those that share a corner."""

    cell: int
    position: tuple[float, float, float]
    det_f: float
    around: float

    def __str__(self) -> str:
        where = ", ".join(f"{x:.4g}" for x in self.position)
        return (
            f"cell {self.cell} at ({where}) m has det F {self.det_f:.3g}, those around it "
            f"{self.around:.3g} in the mean"
        )


class Body:
    """A mesh with its materials, strain measure and element, and what the core keeps of them.

    Args:
        mesh: Rest mesh [m].
        material: Isotropic solid.
        strain: Engineering or Green strain.
        element: Linear tetrahedra, plain or smoothed. Nothing is smoothed across cells of other
            elastic constants.
        inclusions: Cells of another material.
        masses: Masses on its surface.

    Attributes:
        law: What the material follows under Green strain.
        core: The compiled body; holds one stiffness matrix at a time.
        lmbda, mu: Lamé's parameters of each cell [Pa], shape (num_cells,).
        density: Density of each cell [kg/m3], shape (num_cells,).

    Raises:
        InputError: By every method that is given a displacement: wrong shape, or a value that is
            not finite.

    Note:
        Saint-Venant-Kirchhoff softens under compression, from a stretch of 1/sqrt(3) = 0.577
        downwards; for other laws see `Law`.
    """

    def __init__(
        self,
        mesh: TetMesh,
        material: Material,
        strain: Strain = Strain.GREEN,
        *,
        element: Element = Element.LINEAR,
        inclusions: Sequence[Inclusion] = (),
        masses: Sequence[PointMass] = (),
    ) -> None:
        self.mesh = mesh
        self._masses = masses
        self.strain = strain
        self.element = element
        self.law = material.law
        self._materials, self._row = materials_of_cells(mesh, material, inclusions)
        self.lmbda, self.mu, _, self.density = self._materials[self._row].T
        # The isochoric neo-Hookean law is Mooney and Rivlin's with c01 = 0.
        is_isochoric = self.law is Law.NEO_HOOKEAN_ISOCHORIC
        moduli, kinds = np.unique(self._materials[:, :3], axis=0, return_inverse=True)
        self.core = _core.ElasticBody(
            mesh.points,
            mesh.cells,
            np.ascontiguousarray(moduli),
            kinds.reshape(-1)[self._row].astype(np.int32),
            getattr(_core.StrainMeasure, strain.name.lower()),
            "mooney_rivlin" if is_isochoric else self.law.name.lower(),
            getattr(_core.Element, element.name.lower()),
        )
        if material.ogden_terms:
            self.core.set_ogden_terms(np.array(material.ogden_terms))

    @classmethod
    def of(
        cls,
        problem: Problem,
        strain: Strain = Strain.GREEN,
        *,
        element: Element = Element.LINEAR,
    ) -> Body:
        """The body of a problem."""
        return cls(
            problem.mesh,
            problem.material,
            strain,
            element=element,
            inclusions=problem.inclusions,
            masses=problem.masses,
        )

    @cached_property
    def lumped_mass(self) -> Floats:
        """Diagonal of M [kg], (num_points,).

        A quarter of each cell's mass to its corners, and a third of what masses are on a facet.
        """
        mesh = self.mesh
        quarter = self.density * mesh.cell_volumes / 4.0
        lumped = sum_at_points(quarter, mesh.cells, mesh.num_points)
        for mass in self._masses:
            lumped += mass.density(mesh.points) * lumped_areas(mesh, mass.facets)
        return lumped

    @cached_property
    def shape_gradients(self) -> Floats:
        """Gradients of the four shape functions in each cell [1/m], shape (num_cells, 4, 3)."""
        rest = self.core.shape_gradients().reshape(-1, 3, 3)
        return np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)

    def checked(self, displacement: ArrayLike) -> Points:
        """A displacement as a C-ordered float64 array of the mesh's shape, finite."""
        u = np.ascontiguousarray(displacement, dtype=np.float64)
        if u.shape != self.mesh.points.shape:
            raise InputError(
                f"displacement has shape {u.shape}, the mesh has points {self.mesh.points.shape}"
            )
        if not np.isfinite(u).all():
            bad = int(np.flatnonzero(~np.isfinite(u).all(axis=1))[0])
            raise InputError(f"displacement of point {bad} is NaN or infinite")
        return u

    def internal_force(self, displacement: ArrayLike) -> Points:
        """R(a) of eq. 1 [N], shape (num_points, 3); its sum over the points is zero."""
        return self.core.internal_force(self.checked(displacement))

    def strain_energy(self, displacement: ArrayLike) -> float:
        """Integral of W over the rest volume [J]: lmbda/2 tr(E)^2 + mu tr(E^2), or the law's."""
        return self.core.strain_energy(self.checked(displacement))

    def stresses(self, strains: Floats) -> Floats:
        """The stresses that the element makes of small strains of the cells: linear, symmetric.

        Of any strains where the law is Hooke's or Saint-Venant-Kirchhoff's.

        Args:
            strains: Symmetric [-], shape (num_cells, 3, 3).

        Returns:
            [Pa], shape (num_cells, 3, 3): lmbda tr(E) I + 2 mu E, of averages of E for the
            smoothed element. The energy is half the integral of E : S.
        """
        rows = np.ascontiguousarray(strains, dtype=np.float64).reshape(self.mesh.num_cells, 9)
        return self.core.stresses(rows).reshape(-1, 3, 3)

    def first_piola_kirchhoff_stresses(self, displacement: ArrayLike) -> Floats:
        """P of each cell, by which it makes forces [Pa], shape (num_cells, 3, 3)."""
        found = self.core.first_piola_kirchhoff_stresses(self.checked(displacement))
        return found.reshape(-1, 3, 3)

    def displacement_gradients(self, displacement: ArrayLike) -> Floats:
        """H = du/dX of each cell [-], shape (num_cells, 3, 3)."""
        return self.core.displacement_gradients(self.checked(displacement)).reshape(-1, 3, 3)

    def det_f(self, displacement: ArrayLike) -> Floats:
        """Volume over rest volume of each cell [-], shape (num_cells,); <= 0 if inverted."""
        return self.core.det_f(self.checked(displacement))

    def smallest_det_f(self, displacement: ArrayLike) -> tuple[float, int]:
        """Smallest det F [-] and its cell."""
        values = self.det_f(displacement)
        cell = int(np.argmin(values))
        return float(values[cell]), cell

    @property
    def folds(self) -> bool:
        """Whether single cells may fold under pressure: smoothed ones of Saint-Venant-Kirchhoff.

        Pressure pushes on every cell by its own turns and shears, which are resisted in averages
        over edges until these go over to the plain cells. Where the volumetric part of a law is one
        of J it does not.
        """
        is_green = self.strain is Strain.GREEN
        return is_green and self.element is Element.SMOOTHED and self.law.is_linear_in_strain

    def crushed_cell(self, displacement: ArrayLike) -> CrushedCell:
        """The cell of smallest det F at a displacement [m], and how far those around it are."""
        values, cells = self.det_f(displacement), self.mesh.cells
        cell = int(np.argmin(values))
        around = np.isin(cells, cells[cell]).any(axis=1)
        around[cell] = False
        mean = float(values[around].mean()) if around.any() else float(values[cell])
        x, y, z = self.mesh.points[cells[cell]].mean(axis=0)
        return CrushedCell(cell, (float(x), float(y), float(z)), float(values[cell]), mean)

    def critical_time_step_bound(self) -> float:
        """A stable step of central differences about the rest state [s], safe and quickly found.

        omega^2 is at most the largest eigenvalue of any single cell's stiffness over its own
        lumped mass (Fried 1972, "Bounds on the extremal eigenvalues of the finite element
        stiffness and mass matrices"); for one cell that is 4 / rho times the largest eigenvalue
        of B^T D B, which D^(1/2) B B^T D^(1/2) has too, a 6 x 6 matrix. For the smoothed element
        patches of edges and nodes replace the cells: core/mechanics/smoothed_bound.hpp. Masses on
        the surface only lengthen the step.

        At rest all laws are as stiff, so it is the same for all. Away from it, it may be too long:
        Saint-Venant-Kirchhoff stiffens under stretch, the logarithm of a volume without bound as
        that nears 0; `critical_time_step` at a displacement gives the step of the body there.
        """
        if self.element is Element.SMOOTHED:
            squared = self.core.smoothed_bound(self.lumped_mass, _ROUNDS_OF_BOUND)
            return float(2.0 / np.sqrt(squared))
        return float(self.cell_time_steps().min())

    def cell_time_steps(self) -> Floats:
        """Each linear tetrahedron's own stable step about rest [s], shape (num_cells,).

        The smallest is `critical_time_step_bound`; where it is much smaller than the rest, few
        cells decide the step of the whole body.

        Raises:
            InputError: The element is smoothed: its patches decide, not its cells.
        """
        if self.element is Element.SMOOTHED:
            raise InputError("smoothed tetrahedra have no step cell by cell; use the linear ones")
        # Square root of D / rho in Voigt order (xx, yy, zz, xy, yz, zx), by material.
        elasticity = np.zeros((len(self._materials), 6, 6))
        lmbda, mu, _, density = self._materials.T
        elasticity[:, range(6), range(6)] = np.outer(mu, [2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
        elasticity[:, :3, :3] += lmbda[:, None, None]
        values, vectors = np.linalg.eigh(elasticity / density[:, None, None])
        roots = vectors * np.sqrt(values)[:, None, :] @ vectors.transpose(0, 2, 1)
        largest = np.zeros(self.mesh.num_cells)
        for part in np.array_split(
            np.arange(self.mesh.num_cells), max(1, self.mesh.num_cells // 20000)
        ):
            gradients = self.shape_gradients[part]
            strain = np.zeros((len(part), 6, 12))
            for a in range(4):
                gx, gy, gz = gradients[:, a].T
                strain[:, 0, 3 * a], strain[:, 1, 3 * a + 1], strain[:, 2, 3 * a + 2] = gx, gy, gz
                strain[:, 3, 3 * a], strain[:, 3, 3 * a + 1] = gy, gx
                strain[:, 4, 3 * a + 1], strain[:, 4, 3 * a + 2] = gz, gy
                strain[:, 5, 3 * a], strain[:, 5, 3 * a + 2] = gz, gx
            half = roots[self._row[part]] @ strain
            largest[part] = np.linalg.eigvalsh(half @ half.transpose(0, 2, 1))[:, -1]
        return np.asarray(2.0 / np.sqrt(4.0 * largest), dtype=np.float64)

    def critical_time_step(
        self,
        *,
        displacement: Points | None = None,
        mass: Floats | None = None,
        springs: PatchSprings | None = None,
        relative_tolerance: float = 1e-4,
        max_iterations: int = 2000,
    ) -> float:
        """2 / omega_max of K x = omega^2 M x [s] (paper, section III), by Lanczos iterations.

        Approached from above: the result is too long by at most about the tolerance, so multiply
        it by a safety factor. Never below `critical_time_step_bound`. Stretched Green-strain
        cells are stiffer than at rest: keep a margin. After k products, over random starts, omega^2
        is a part e too small with a probability of at most 1.648 root(n) exp(-(2 k - 1) root(e)),
        n the number of unknowns (Kuczynski and Wozniakowski, SIAM J. Matrix Anal. Appl. 13, 1992).

        Args:
            displacement: State about which the body moves [m], shape (num_points, 3); None is
                rest.
            mass: Lumped mass [kg], shape (num_points,); None is the material's.
            springs: Springs on the body, at full stiffness; None is none.
            relative_tolerance: Change of the eigenvalue over ten iterations at which to stop.
            max_iterations: Matrix products at most.
        """
        rest, multiply = np.zeros_like(self.mesh.points), self.core.multiply
        if displacement is None and self.element is Element.SMOOTHED:
            multiply = _core.StiffnessAtRest(self.core, chosen_instruction_set()).multiply
        else:
            self.core.assemble_tangent(rest if displacement is None else self.checked(displacement))
        scale = 1.0 / np.sqrt(self.lumped_mass if mass is None else mass)[:, None]
        q = np.random.default_rng(0).standard_normal(rest.shape)
        q /= np.linalg.norm(q)
        before = np.zeros_like(q)
        diagonal: list[float] = []
        beside: list[float] = []
        known = 0.0
        for iteration in range(1, min(max_iterations, rest.size) + 1):
            moved = scale * q
            product = multiply(moved)
            if springs is not None:
                product += springs.multiply(moved)
            w = scale * product - (beside[-1] * before if beside else 0.0)
            diagonal.append(float(np.sum(w * q)))
            w -= diagonal[-1] * q
            beside.append(float(np.linalg.norm(w)))
            is_exhausted = beside[-1] <= 1e-12 * abs(diagonal[0])
            if iteration % 10 == 0 or is_exhausted:
                off = beside[: len(diagonal) - 1]
                ritz = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
                largest = float(np.linalg.eigvalsh(ritz)[-1])
                if is_exhausted or largest - known <= relative_tolerance * largest:
                    known = largest
                    break
                known = largest
            before, q = q, w / beside[-1]
        return float(2.0 / np.sqrt(known))


# Stresses of cells: what the energy is made of, and Cauchy's.
#
# On linear tetrahedra, smoothed or not, both are constant in a cell. The smoothed element's S
# already is an average over the cell's edges and corners; it is turned by the cell's own F.


def cell_stress(body: Body, displacement: ArrayLike) -> Floats:
    """Stress of each cell: S = lmbda tr(E) I + 2 mu E (eq. 2, 3-4, 6-7), by the element's strain.

    Under another law, and of smoothed cells, S = F^-1 P. With engineering strain it is Cauchy's
    stress, with finite strain the second Piola-Kirchhoff stress [Pa], symmetric, shape
    (num_cells, 3, 3).
    """
    gradient = body.displacement_gradients(displacement)
    is_plain = body.law.is_linear_in_strain and body.element is Element.LINEAR
    if body.strain is Strain.GREEN and not is_plain:
        P = body.first_piola_kirchhoff_stresses(displacement)
        return np.linalg.solve(np.eye(3) + gradient, P)
    E = 0.5 * (gradient + gradient.transpose(0, 2, 1))
    if body.strain is Strain.GREEN:
        E = E + 0.5 * np.einsum("cki,ckj->cij", gradient, gradient)
    return body.stresses(E)


def cauchy_stress(body: Body, displacement: ArrayLike) -> Floats:
    """Cauchy's stress of each cell [Pa], F S F^T / det F, (num_cells, 3, 3); see `cell_stress`.

    Not finite where det F is 0 or a number overflows.
    """
    S = cell_stress(body, displacement)
    if body.strain is Strain.LINEAR:
        return S
    F = np.eye(3) + body.displacement_gradients(displacement)
    with np.errstate(all="ignore"):
        sigma: Floats = F @ S @ F.transpose(0, 2, 1) / body.det_f(displacement)[:, None, None]
    return sigma
