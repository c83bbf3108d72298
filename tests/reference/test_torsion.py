"""Torsion of a compressible cylinder of two laws against its radial equation.

Each section turns by tau Z and its circles change their radius: r(R), theta = Theta + tau Z,
z = stretch Z, in cylindrical coordinates F = [[r', 0, 0], [0, r/R, r tau], [0, 0, stretch]]. The
energy by length,
2 pi times the integral of W(F) R dR, is least where (R. W. Ogden, Non-linear Elastic Deformations,
1984, section 5.2)

    (R P_rR)' = P_thetaTheta + R tau P_thetaZ,   P_rR = 0 at the free side.

Solved by Galerkin with r = R p(R^2), p a polynomial, and the judge's own stresses; then the whole
cylinder is turned and stretched at its ends, its side free, on three meshes; and a block out of it
is given its displacements at all six faces, so that no facet stands for a curve.
"""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference.availability import is_available
from palpate.validation.diagnosis.law_simulators import example_material
from palpate.validation.diagnosis.material_hypotheses import lame_of
from palpate.validation.metrics.grid_convergence import assess_grid_convergence
from palpate.validation.metrics.laws import energy_density, finite_stress, stress_change

if is_available():
    from palpate.reference.discrete_problem import internal_force
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

TAU = 0.8  # turn by length [1/m], of a cylinder with a radius of 1 m
LAWS = pytest.mark.parametrize("law", [Law.NEO_HOOKEAN_STABLE, Law.OGDEN])


class Cylinder:
    """r(R) = R p(R^2), with so many Chebyshev coefficients of p."""

    def __init__(self, law: Law, size: int, stretch: float = 1.0) -> None:
        self.material, self.stretch = example_material(law, 0.3), stretch
        x, weights = np.polynomial.legendre.leggauss(40)
        R, weights = 0.5 * (x + 1.0), 0.5 * weights
        self._R, self._weights = R, weights * R
        # Of r and r' by the coefficients.
        T = np.polynomial.chebyshev.Chebyshev.basis
        p = np.stack([T(k)(2 * R**2 - 1) for k in range(size)], axis=1)
        slope = np.stack([T(k).deriv()(2 * R**2 - 1) for k in range(size)], axis=1)
        self._r = R[:, None] * p
        self._slope = p + 4.0 * R[:, None] ** 2 * slope
        lmbda, mu = lame_of(self.material)
        self._constants = [np.full(len(R), of) for of in (lmbda, mu, 0.0)]
        self._constants.append(self.material.ogden_terms)
        c = np.zeros(size)
        c[0] = 1.0
        for _ in range(30):
            step = np.linalg.solve(self._change(c), self._balance(c))
            c = c - step
            if np.abs(step).max() < 1e-14:
                break
        self.coefficients = c
        self.radius = np.polynomial.chebyshev.Chebyshev(c, (0.0, 1.0))

    def _gradient(self, c, one=1.0):
        """F - I at the points, or its derivative by a coefficient where `one` is 0."""
        F = np.zeros((len(self._R), 3, 3))
        F[:, 0, 0], F[:, 1, 1] = self._slope @ c - one, self._r @ c / self._R - one
        F[:, 1, 2] = TAU * (self._r @ c)
        F[:, 2, 2] = one * (self.stretch - 1.0)
        return F

    def _along(self, P):
        """What a stress does along each coefficient, summed over the section."""
        by_r = P[:, 1, 1] / self._R + TAU * P[:, 1, 2]
        return (self._weights * P[:, 0, 0]) @ self._slope + (self._weights * by_r) @ self._r

    def _balance(self, c):
        law = self.material.law
        return self._along(finite_stress(law, self._gradient(c), *self._constants))

    def _change(self, c):
        H, law = self._gradient(c), self.material.law
        columns = []
        for k in range(len(c)):
            dH = self._gradient(np.eye(len(c))[k], 0.0)
            columns.append(self._along(stress_change(law, H, dH, *self._constants)))
        return np.stack(columns, axis=1)

    def moved(self, positions):
        """Displacements of places at rest [m]."""
        R2 = positions[:, 0] ** 2 + positions[:, 1] ** 2
        turn, p = TAU * positions[:, 2], self.radius(R2)
        c, s = np.cos(turn), np.sin(turn)
        x = p * (c * positions[:, 0] - s * positions[:, 1])
        y = p * (s * positions[:, 0] + c * positions[:, 1])
        return np.stack([x, y, self.stretch * positions[:, 2]], axis=1) - positions

    def torque(self):
        """About the axis, through any section [N m]."""
        law, c = self.material.law, self.coefficients
        P = finite_stress(law, self._gradient(c), *self._constants)
        return 2.0 * np.pi * float((self._weights * P[:, 1, 2]) @ (self._r @ c))

    def densities(self, positions):
        """W at places across the axis, (n, 2) [J/m3]."""
        R2 = (positions**2).sum(axis=1)
        R, p, slope = np.sqrt(R2), self.radius(R2), self.radius.deriv()(R2)
        H = np.zeros((len(R), 3, 3))
        H[:, 0, 0], H[:, 1, 1], H[:, 1, 2] = p + 2 * R2 * slope - 1, p - 1, TAU * R * p
        constants = [np.full(len(R), of[0]) for of in self._constants[:3]]
        return energy_density(self.material.law, H, *constants, self.material.ogden_terms)

    def energy(self):
        """By length [J/m]."""
        H = self._gradient(self.coefficients)
        W = energy_density(self.material.law, H, *self._constants)
        return 2.0 * np.pi * float(self._weights @ W)


def round_bar(rings):
    """Radius and length 1 m, so many rings of triangles and layers; points on circles."""
    disc, starts = [(0.0, 0.0)], [0]
    for ring in range(1, rings + 1):
        starts.append(len(disc))
        angles = 2.0 * np.pi * np.arange(6 * ring) / (6 * ring)
        disc += [(ring / rings * np.cos(a), ring / rings * np.sin(a)) for a in angles]
    triangles = []
    for ring in range(1, rings + 1):
        for sector in range(6):
            for k in range(ring):
                outer, inner = sector * ring + k, sector * (ring - 1) + k

                def on(which, position):
                    return starts[which] + position % max(6 * which, 1)

                a, b, c = on(ring, outer), on(ring, outer + 1), on(ring - 1, inner)
                triangles.append((a, b, c))
                if k < ring - 1:
                    triangles.append((b, on(ring - 1, inner + 1), c))
    disc, size = np.array(disc), len(disc)
    points = np.concatenate(
        [np.column_stack([disc, np.full(size, z)]) for z in np.linspace(0.0, 1.0, rings + 1)]
    )
    cells = []
    for layer in range(rings):
        for triangle in triangles:
            # By growing numbers, so that diagonals of neighbours are the same.
            a, b, c = (layer * size + p for p in sorted(triangle))
            cells += [(a, b, c, a + size), (b, c, a + size, b + size)]
            cells.append((c, a + size, b + size, c + size))
    cells = np.array(cells)
    turned = signed_volumes(points, cells) < 0.0
    cells[turned] = cells[turned][:, [0, 2, 1, 3]]
    return TetMesh(points, cells)


@LAWS
@pytest.mark.long
def test_the_whole_of_it_is_the_radial_equations_within_the_bar(law):
    cylinder = Cylinder(law, 12, stretch=1.1)
    exact = np.array([1.0 - cylinder.radius(1.0), cylinder.energy(), cylinder.torque()])
    rings, found = (8, 6, 4), []
    for count in rings:
        mesh = round_bar(count)
        z = mesh.points[:, 2]
        moved = cylinder.moved(mesh.points)
        ends = np.flatnonzero((z < 1e-9) | (z > 1.0 - 1e-9))
        fixed = tuple(Support(np.array([p]), displacement=tuple(moved[p].tolist())) for p in ends)
        state = solve_static(Problem(mesh, cylinder.material, fixed, ()), degree=1)
        side = np.hypot(*mesh.points[:, :2].T) > 1.0 - 1e-9
        position = mesh.points + state.displacement
        radius = np.hypot(*position[side & (np.abs(z - 0.5) < 1e-9), :2].T)
        force = internal_force(mesh, state.displacement, material=cylinder.material)
        top = z > 1.0 - 1e-9
        torque = np.cross(position[top], force[top])[:, 2].sum()
        found.append((1.0 - radius.mean(), state.strain_energy, torque))
    for value, of_meshes in zip(exact, np.array(found).T, strict=True):
        known = assess_grid_convergence(
            of_meshes, [1.0 / count for count in rings], expected_order=2.0
        )
        assert known.error_bar is not None
        assert known.error_bar < 0.05 * value
        assert abs(known.value - value) <= known.error_bar
        # Richardson's value is nearer still: the bar is of the right mistake.
        assert abs(known.extrapolated - value) < 0.3 * known.error_bar


@LAWS
def test_a_block_of_it_is_the_radial_equations(box, law):
    cylinder, finer = Cylinder(law, 12), Cylinder(law, 16)
    R2 = np.linspace(0.0, 1.0, 50)
    # To 1e-10; a twist of 46 degrees a radius narrows the cylinder.
    assert np.abs(cylinder.radius(R2) - finer.radius(R2)).max() < 1e-10
    assert cylinder.energy() == pytest.approx(finer.energy(), rel=1e-10)
    assert cylinder.radius(1.0) < 0.99
    # Out of the middle of the wall; its faces do not lie along the axes of any symmetry.
    corner, size = np.array([0.15, 0.05, 0.0]), 0.5
    x, weights = np.polynomial.legendre.leggauss(12)
    x, weights = size * 0.5 * (x + 1.0), size * 0.5 * weights
    across = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2) + corner[:2]
    exact = size * float(np.outer(weights, weights).ravel() @ cylinder.densities(across))
    errors, energies = [], []
    for count in (2, 4):
        unit = box((count,) * 3, (size,) * 3)
        mesh = TetMesh(unit.points + corner, unit.cells)
        moved = cylinder.moved(mesh.points)
        fixed = tuple(
            Support(np.array([p]), displacement=tuple(moved[p].tolist()))
            for p in np.unique(mesh.boundary_facets)
        )
        found = solve_static(Problem(mesh, cylinder.material, fixed, ()), degree=1)
        errors.append(np.abs(found.displacement - moved).max() / np.abs(moved).max())
        energies.append(found.strain_energy / exact - 1.0)
    # Linear tetrahedra: a quarter of the error where cells are halved.
    assert errors[1] < 0.35 * errors[0]
    assert energies[1] == pytest.approx(0.25 * energies[0], rel=0.1)
    bar = abs(energies[0] - energies[1]) / 3.0
    assert abs((4.0 * energies[1] - energies[0]) / 3.0) < 0.1 * bar
