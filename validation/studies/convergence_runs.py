"""Ever finer runs on smooth problems with known answers: the order in h, p and dt that they show.

The wave (linear strain): u = A sin(pi x / 2 L) cos(w t), w = (pi / 2 L) sqrt((lmbda + 2 mu) / rho),
held at x = 0, free at x = L, rollers on the sides.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Traction
from palpate.meshes.bricks import brick_box, held, rollers, side
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.states import Progress
from palpate.validation.studies.closed_forms import (
    Solve,
    confined_modulus,
    stretch_under,
    volume_change,
)

# Two smooth nonlinear problems whose answers are known.
#
# A manufactured solution for Saint-Venant-Kirchhoff: choose u, work out the body force it needs.
# u_i = A c_i sin(pi x) sin(pi y) sin(pi z) on the unit cube, held at 0 all around. With H = grad u,
# F = I + H and G_iJK = d2 u_i / dX_J dX_K,
#
# (Div P)_i = G_iJK S_JK + F_iJ S_JK,K,   S_JK,K = lmbda tr(E),J + 2 mu E_JK,K,
# tr(E),J = G_iiJ + H_iK G_iKJ,   E_JK,K = (G_JKK + G_KJK + G_iJK H_iK + H_iJ G_iKK) / 2.
#
# Method: P. J. Roache, J. Fluids Eng. 124 (2002) 4-10.
#
# A confined column pulled by its own weight: rollers on the sides leave one unknown, the stretch
# a(x) along the column of length L, with (lmbda + 2 mu) a (a^2 - 1) / 2 = f (L - x). Supports and
# load are what every simulator can be given.

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


def relative_errors(mesh: TetMesh, displacement: Points) -> tuple[float, float]:
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


# Refinements of the column for each degree: more would take minutes, and drown in rounding.
LEVELS = {1: 3, 2: 3, 3: 2}
# Of the order of a field: 0.1 where three meshes are near the limit, 0.2 where two must do.
_TOLERANCES = {1: 0.1, 2: 0.1, 3: 0.2}
BAR_MATERIAL = Material(1.0, 0.3, 1.0)
_AMPLITUDE = 1e-3
_WIDTH = 0.1
_OUTPUTS = 20
_TIME_TOLERANCE = 0.1


@dataclass(frozen=True)
class ErrorFamily:
    """Relative errors of ever finer runs against an exact answer, or one that is far better.

    `what` is varied: "h", "p" or "dt"; sizes are cell sizes or time steps in any unit; the last
    observed order may be `tolerance` off the expected one; notes say cells or time step.
    """

    name: str
    label: str
    what: str
    sizes: tuple[float, ...]
    errors: tuple[float, ...]
    expected_order: float
    tolerance: float
    notes: tuple[str, ...] = ()

    @property
    def orders(self) -> tuple[float, ...]:
        """Observed order between neighbours [-], the last between the two finest."""
        pairs = pairwise(zip(self.sizes, self.errors, strict=True))
        return tuple(math.log(e / f) / math.log(h / g) for (h, e), (g, f) in pairs)

    @property
    def is_as_expected(self) -> bool:
        """Does the order between the two finest runs agree with theory?"""
        return abs(self.orders[-1] - self.expected_order) <= self.tolerance


def follow_manufactured(
    bricks: tuple[int, ...] = (6, 12, 24), *, solve: Solve = solve_static
) -> list[ErrorFamily]:
    """Fastsim's P1 on uniform meshes of the cube, bricks along an edge: L2 order 2, H1 order 1."""
    found, notes = [], []
    for count in bricks:
        problem = manufactured_problem(count)
        found.append(relative_errors(problem.mesh, solve(problem).displacement))
        notes.append(_num_cells(problem))
    sizes = tuple(1.0 / n for n in bricks)
    return [
        ErrorFamily(f"manufactured solution, {norm} of P1 (fastsim)", f"P1, {norm} norm", "h",
                    sizes, tuple(pair[k] for pair in found), order, tolerance, tuple(notes))
        for k, (norm, order, tolerance) in enumerate((("L2", 2.0, 0.2), ("H1", 1.0, 0.1)))
    ]  # fmt: skip


def follow_degrees(progress: Progress) -> list[ErrorFamily]:
    """The reference's P1, P2 and P3 on the column: energy, whose order is twice the field's.

    The difference of strain energy at equilibrium is the square of the energy norm of the error,
    to leading order, so half its order is that of the displacement in the energy norm: p.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import StaticTask

    exact = exact_column()
    families = []
    for degree, count in LEVELS.items():
        found, notes = [], []
        for level in range(count):
            problem = column(level)
            progress(f"column, P{degree}, {_num_cells(problem)}")
            result = run_task(StaticTask(degree=degree, relative_tolerance=1e-12), problem)
            found.append(abs(result.strain_energy / exact.strain_energy - 1.0) ** 0.5)
            notes.append(_num_cells(problem))
        name = f"confined column, energy norm of P{degree} (reference)"
        sizes = tuple(0.5**level for level in range(count))
        families.append(
            ErrorFamily(name, f"P{degree}, energy norm", "p", sizes, tuple(found), float(degree),
                        _TOLERANCES[degree], tuple(notes))
        )  # fmt: skip
    return families


def wave_bar(bricks: int) -> Problem:
    """The confined bar, 1 x 0.1 x 0.1 m, a quarter wave long; a tenth as many bricks across."""
    across = max(1, bricks // 10)
    mesh = brick_box((bricks, across, across), (1.0, _WIDTH, _WIDTH))
    sides = ((0, 0.0), (1, 0.0), (1, _WIDTH), (2, 0.0), (2, _WIDTH))
    return Problem(mesh, BAR_MATERIAL, rollers(mesh, sides), ())


def wave_frequency() -> float:
    """Angular frequency of the wave [1/s]."""
    return 0.5 * math.pi * math.sqrt(confined_modulus(BAR_MATERIAL) / BAR_MATERIAL.density)


def follow_wave(bricks: tuple[int, ...] = (10, 20, 40)) -> ErrorFamily:
    """The wave against its closed form over a period, step and mesh refined together."""
    omega = wave_frequency()
    end = 2.0 * math.pi / omega
    # One part of the critical step on every mesh: sizes in proportion.
    longest = 0.5 * Body(wave_bar(bricks[0]).mesh, BAR_MATERIAL).critical_time_step_bound()
    steps = math.ceil(end / _OUTPUTS / longest)
    sizes, found, notes = [], [], []
    for count in bricks:
        problem = wave_bar(count)
        dt = end / _OUTPUTS / (steps * count / bricks[0])
        shape = np.zeros_like(problem.mesh.points)
        shape[:, 0] = _AMPLITUDE * np.sin(0.5 * math.pi * problem.mesh.points[:, 0])
        timed = dataclasses.replace(problem, time=TimeSpan(end, dt, num_outputs=_OUTPUTS))
        run = simulate(timed, strain=Strain.LINEAR, displacement=shape)
        exact = np.cos(omega * run.times)[:, None, None] * shape
        sizes.append(dt)
        found.append(_largest_error(problem, run.displacements, exact))
        notes.append(_num_cells(problem))
    name = "P-wave over a period against its closed form, h and dt together (fastsim)"
    return ErrorFamily(name, "P-wave, closed form", "dt", tuple(sizes), tuple(found), 2.0,
                       _TIME_TOLERANCE, tuple(notes))  # fmt: skip


def block_let_go(bricks: int) -> Problem:
    """A block 2 x 1 x 1 m that a traction sets swinging, far beyond small rotations."""
    mesh = brick_box((2 * bricks, bricks, bricks), (2.0, 1.0, 1.0), ragged=0.1)
    load = Traction(side(mesh, 0, 2.0), (0.0, 0.01, -0.02))
    return Problem(mesh, BAR_MATERIAL, (held(side(mesh, 0, 0.0)),), (load,))


def follow_block(
    bricks: int = 2, *, halvings: int = 3, end_time: float = 6.0, damping: float = 0.1
) -> ErrorFamily:
    """The block on one mesh, the step halved, against a step a sixteenth of the last.

    Args:
        bricks: Over the height.
        halvings: Of the step, from about 0.8 of the critical one.
        end_time: [s].
        damping: Mass damping [1/s].
    """
    problem = block_let_go(bricks)
    longest = 0.8 * Body(problem.mesh, BAR_MATERIAL).critical_time_step_bound()
    between = end_time / _OUTPUTS
    counts = [math.ceil(between / longest) * 2**k for k in range(halvings + 1)]

    def states(per_output: int) -> Points:
        span = TimeSpan(end_time, between / per_output, damping, _OUTPUTS)
        return simulate(dataclasses.replace(problem, time=span)).displacements

    truth = states(16 * counts[-1])
    found = tuple(_largest_error(problem, states(count), truth) for count in counts)
    name = "block let go, Green strain, damped: dt alone, against a small step (fastsim)"
    sizes = tuple(between / count for count in counts)
    notes = tuple(f"dt = {size:.4g} s" for size in sizes)
    return ErrorFamily(name, "block, small step", "dt", sizes, found, 2.0, _TIME_TOLERANCE, notes)


def _largest_error(problem: Problem, found: Points, exact: Points) -> float:
    scale = max(l2_norm(problem.mesh, u) for u in exact)
    return max(l2_norm(problem.mesh, u - v) for u, v in zip(found, exact, strict=True)) / scale


def _num_cells(problem: Problem) -> str:
    return f"{problem.mesh.num_cells} cells"
