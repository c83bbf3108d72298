"""Two smooth nonlinear problems whose answers are known.

A manufactured solution for Saint-Venant-Kirchhoff: choose u, work out the body force it needs.
u_i = A c_i sin(pi x) sin(pi y) sin(pi z) on the unit cube, held at 0 all around. With H = grad u,
F = I + H and G_iJK = d2 u_i / dX_J dX_K,

(Div P)_i = G_iJK S_JK + F_iJ S_JK,K,   S_JK,K = lmbda tr(E),J + 2 mu E_JK,K,
tr(E),J = G_iiJ + H_iK G_iKJ,   E_JK,K = (G_JKK + G_KJK + G_iJK H_iK + H_iJ G_iKK) / 2.

Method: P. J. Roache, J. Fluids Eng. 124 (2002) 4-10.

A confined column pulled by its own weight: rollers on the sides leave one unknown, the stretch a(x)
along the column of length L, with (lmbda + 2 mu) a (a^2 - 1) / 2 = f (L - x). Supports and load are
what every simulator can be given.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import BodyForce, PointForce
from palpate.meshes.bricks import brick_box, held, rollers
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.studies.bodies import Solve, volume_change
from palpate.validation.studies.closed_forms import confined_modulus, stretch_under

MATERIAL = Material(1.0, 0.3)
# Strains up to about a third: the quadratic part of Green strain counts.
AMPLITUDE = 0.1
_DIRECTION = np.array([1.0, -0.7, 0.5])


def exact_displacement(places: Points) -> Points:
    """U at places, shape (n, 3)."""
    u: Points = AMPLITUDE * _derivative(places)[:, None] * _DIRECTION
    return u


def exact_gradient(places: Points) -> Floats:
    """H_iJ = du_i/dX_J at places [-], shape (n, 3, 3)."""
    first = np.array([_derivative(places, j) for j in range(3)])
    H: Floats = AMPLITUDE * np.einsum("i,jn->nij", _DIRECTION, first)
    return H


def body_force(places: Points, material: Material = MATERIAL) -> Points:
    """-Div P of the exact solution [N/m3], shape (n, 3)."""
    mu = material.youngs_modulus / (2.0 * (1.0 + material.poissons_ratio))
    lmbda = confined_modulus(material) - 2.0 * mu
    H = exact_gradient(places)
    second = np.array([[_derivative(places, j, k) for k in range(3)] for j in range(3)])
    G = AMPLITUDE * np.einsum("i,jkn->nijk", _DIRECTION, second)
    E = 0.5 * (H + H.transpose(0, 2, 1) + np.einsum("nki,nkj->nij", H, H))
    S = 2.0 * mu * E + lmbda * np.einsum("nii->n", E)[:, None, None] * np.eye(3)
    trace = np.einsum("niij->nj", G) + np.einsum("nik,nikj->nj", H, G)
    turn = np.einsum("njkk->nj", G) + np.einsum("nkjk->nj", G)
    turn += np.einsum("nijk,nik->nj", G, H) + np.einsum("nij,nikk->nj", H, G)
    slope = lmbda * trace + mu * turn
    force: Points = -(np.einsum("nijk,njk->ni", G, S) + slope + np.einsum("nij,nj->ni", H, slope))
    return force


def manufactured_problem(bricks: int, *, amplitude: float = 1.0) -> Problem:
    """The unit cube, held all around, with the consistent nodal forces of the body force.

    Args:
        bricks: Along each edge, six cells each.
        amplitude: Factor on the forces: 1, unless the problem is spoiled on purpose.
    """
    mesh = brick_box((bricks, bricks, bricks), (1.0, 1.0, 1.0))
    forces = np.zeros_like(mesh.points)
    for barycentric, weight in zip(*_rule(), strict=True):
        places = np.einsum("a,cai->ci", barycentric, mesh.points[mesh.cells])
        share = weight * signed_volumes(mesh.points, mesh.cells)[:, None] * body_force(places)
        for a in range(4):
            np.add.at(forces, mesh.cells[:, a], barycentric[a] * share)
    every = np.arange(mesh.num_points, dtype=np.int32)
    load = PointForce(every, amplitude * forces)
    return Problem(mesh, MATERIAL, (held(mesh.boundary_facets),), (load,))


def errors(mesh: TetMesh, displacement: Points) -> tuple[float, float]:
    """Relative L2 error of u and of its gradient (H1 seminorm) [-], by quadrature."""
    corners = mesh.points[mesh.cells]
    edges = corners[:, 1:] - corners[:, :1]
    moved = displacement[mesh.cells]
    # Rows of `edges` are dX, rows of the other du: du = dX H^T.
    H = np.linalg.solve(edges, moved[:, 1:] - moved[:, :1]).transpose(0, 2, 1)
    volumes = signed_volumes(mesh.points, mesh.cells)
    sums = np.zeros(4)
    for barycentric, weight in zip(*_rule(), strict=True):
        places = np.einsum("a,cai->ci", barycentric, corners)
        u, gradient = exact_displacement(places), exact_gradient(places)
        found = np.einsum("a,cai->ci", barycentric, moved)
        fields = (found - u, u, H - gradient, gradient)
        sums += weight * np.array(
            [volumes @ (f**2).reshape(len(volumes), -1).sum(axis=1) for f in fields]
        )
    return float(np.sqrt(sums[0] / sums[1])), float(np.sqrt(sums[2] / sums[3]))


def gauss_rule(count: int) -> tuple[Floats, Floats]:
    """Gauss-Legendre points and weights on 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)  # type: ignore[no-untyped-call]
    return 0.5 * (nodes + 1.0), 0.5 * weights


def _derivative(places: Points, *along: int) -> Floats:
    """Derivative of the product of sines along some axes, shape (n,)."""
    s, c = np.sin(np.pi * places), np.cos(np.pi * places)
    by_order = (s, np.pi * c, -(np.pi**2) * s)
    found: Floats = np.prod([by_order[along.count(a)][:, a] for a in range(3)], axis=0)
    return found


def _rule() -> tuple[Points, Points]:
    """Barycentric points and weights (sum 1): Gauss points of a cube folded to a tetrahedron.

    Three in each direction: exact to degree 3 (Stroud 1971, conical product formulas).
    """
    t, w = gauss_rule(3)
    a, b, c = (g.ravel() for g in np.meshgrid(t, t, t, indexing="ij"))
    wa, wb, wc = (g.ravel() for g in np.meshgrid(w, w, w, indexing="ij"))
    x, y, z = a, b * (1.0 - a), c * (1.0 - a) * (1.0 - b)
    barycentric = np.column_stack([1.0 - x - y - z, x, y, z])
    return barycentric, 6.0 * wa * wb * wc * (1.0 - a) ** 2 * (1.0 - b)


LENGTH, WIDTH = 1.0, 0.5
# f L / (lmbda + 2 mu): stretched by 1.276 where it is held.
LOAD = 0.4


class ColumnAnswer(NamedTuple):
    """Strain energy [J] and change of volume [m3]; both converge with order 2 p."""

    strain_energy: float
    volume_change: float


def column(refinements: int) -> Problem:
    """The column on a mesh whose inner points are moved, so that no symmetry helps.

    Args:
        refinements: How often its 96 cells are cut in eight.
    """
    mesh = brick_box((4, 2, 2), (LENGTH, WIDTH, WIDTH), ragged=0.1)
    sides = ((0, 0.0), (1, 0.0), (1, WIDTH), (2, 0.0), (2, WIDTH))
    force = LOAD * confined_modulus(MATERIAL) / LENGTH
    problem = Problem(mesh, MATERIAL, rollers(mesh, sides), (BodyForce((force, 0.0, 0.0)),))
    for _ in range(refinements):
        problem = refine_problem(problem)
    return problem


def exact_column() -> ColumnAnswer:
    """By Gauss quadrature of the closed form, to rounding."""
    x, w = (LENGTH * part for part in gauss_rule(40))
    a = np.array([stretch_under(LOAD * (1.0 - place / LENGTH)) for place in x])
    area = WIDTH**2
    energy = area * confined_modulus(MATERIAL) / 8.0 * float(w @ (a**2 - 1.0) ** 2)
    return ColumnAnswer(energy, area * float(w @ (a - 1.0)))


class ColumnGrid(NamedTuple):
    """A number of the column in closed form, and what fastsim's three meshes tell about it."""

    quantity: str
    exact: float
    assessed: GridConvergence

    @property
    def is_as_expected(self) -> bool:
        """Is the order 2 within 0.2, and does the error bar hold the exact value?"""
        bar, order = self.assessed.error_bar, self.assessed.order
        if bar is None or order is None:
            return False
        return abs(self.assessed.value - self.exact) <= bar and abs(order - 2.0) <= 0.2


def follow_column(*, first: int = 1, solve: Solve = solve_static) -> list[ColumnGrid]:
    """Energy and change of volume of the column by fastsim on three meshes, with their GCI.

    Args:
        first: Refinements of the coarsest mesh.
        solve: fastsim's statics, or what is put to the test in its place.
    """
    answers = []
    for problem in map(column, (first + 2, first + 1, first)):
        u = solve(problem).displacement
        change = volume_change(problem.mesh, u) * problem.mesh.volume
        answers.append(ColumnAnswer(body_of(problem, Strain.GREEN).energy(u), change))
    names = ("strain energy [J]", "change of volume [m3]")
    return [
        ColumnGrid(
            name, exact, assess_grid_convergence(values, [1.0, 2.0, 4.0], expected_order=2.0)
        )
        for name, exact, *values in zip(names, exact_column(), *answers, strict=True)
    ]
