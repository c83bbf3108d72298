"""The lowest frequencies of a free and a clamped bar: is any of them one that should not be?

fastsim's stiffness at rest and the consistent mass of linear tetrahedra, beside quadratic ones on
the same mesh by the reference.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.linalg import cholesky, eigvalsh, norm, solve

from palpate.fastsim.body import Body
from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.report.plots import BLUE, GREY, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.elements.bar import make_bar

DIVISIONS = 4
RATIOS = (0.3, 0.49)
NUM_MODES = 20
NUM_RIGID = 6
# A frequency off by more is heard as another one.
NEARNESS = 0.05
# Squares of frequencies of rigid motions, over the largest of the mesh.
ROUNDING = 1e-12
NO_SCIPY = "frequencies: scipy, which finds those of quadratic tetrahedra, is not installed"


class Modes(NamedTuple):
    """Frequencies of one bar [Hz], lowest first; rigid motions are not among them.

    `num_zeros` counts those of linear and smoothed tetrahedra that are zero but for rounding.
    """

    is_free: bool
    poissons_ratio: float
    true: Floats
    linear: Floats
    smoothed: Floats
    num_zeros: tuple[int, int]

    @property
    def name(self) -> str:
        """Which bar."""
        return f"{'free' if self.is_free else 'clamped'} bar, nu = {self.poissons_ratio:g}"


def follow_modes(
    progress: Progress, *, divisions: int = DIVISIONS, ratios: Sequence[float] = RATIOS
) -> list[Modes]:
    """Both bars at each Poisson's ratio; none where scipy is not installed."""
    if importlib.util.find_spec("scipy") is None:
        progress(NO_SCIPY)
        return []
    found = []
    for nu in ratios:
        problem = make_bar(divisions, nu, ragged=0.1)
        ours = {element: stiffness_at_rest(problem, element) for element in Element}
        mass = consistent_mass(problem.mesh, problem.material.density)
        for is_free in (True, False):
            progress(f"frequencies, nu = {nu:g}, {'free' if is_free else 'clamped'}")
            held = () if is_free else problem.supports[0].points
            free = np.setdiff1d(np.arange(3 * problem.mesh.num_points), _dofs(held))
            zeros, lines = [], []
            for element in Element:
                squares = _squares(ours[element], mass, free)
                num_zero = int((np.abs(squares) <= ROUNDING * squares[-1]).sum())
                zeros.append(num_zero)
                lines.append(_hertz(squares[num_zero : num_zero + NUM_MODES]))
            true = true_frequencies(problem, is_free)
            found.append(Modes(is_free, nu, true, lines[0], lines[1], (zeros[0], zeros[1])))
    return found


def _dofs(points: Any) -> Floats:
    rows: Floats = (3 * np.asarray(points, dtype=int)[:, None] + np.arange(3)).ravel()
    return rows


def _hertz(squares: Floats) -> Floats:
    found: Floats = np.sqrt(np.abs(squares)) / (2.0 * np.pi)
    return found


def _squares(stiffness: Floats, mass: Floats, free: Any) -> Floats:
    root = cholesky(mass[np.ix_(free, free)])
    half = solve(root, stiffness[np.ix_(free, free)])
    squares: Floats = eigvalsh(solve(root, half.T))
    return squares


def stiffness_at_rest(problem: Problem, element: Element) -> Floats:
    """K [N/m], column by column: the force of linear strain is linear in the displacement."""
    body = Body.of(problem, Strain.LINEAR, element=element)
    units = np.eye(3 * problem.mesh.num_points)
    columns = [body.internal_force(unit.reshape(-1, 3)).ravel() for unit in units]
    stiffness = np.column_stack(columns)
    symmetric: Floats = 0.5 * (stiffness + stiffness.T)
    assert norm(stiffness - symmetric) <= ROUNDING * norm(symmetric)
    return symmetric


def consistent_mass(mesh: TetMesh, density: float) -> Floats:
    """Integral of rho N_a N_b [kg]: of a cell V / 20, and V / 10 on the diagonal."""
    mass = np.zeros((mesh.num_points, mesh.num_points))
    volumes = density * signed_volumes(mesh.points, mesh.cells)
    for a in range(4):
        for b in range(4):
            part = volumes / (10.0 if a == b else 20.0)
            np.add.at(mass, (mesh.cells[:, a], mesh.cells[:, b]), part)
    found: Floats = np.kron(mass, np.eye(3))
    return found


def true_frequencies(problem: Problem, is_free: bool) -> Floats:
    """Quadratic tetrahedra with consistent mass, rigid motions left out [Hz]."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import eigsh

    from palpate.reference import fenicsx
    from palpate.reference.discrete_problem import DiscreteProblem

    body = DiscreteProblem(problem, strain=Strain.LINEAR, degree=2)
    ufl = fenicsx.ufl
    dx = ufl.dx(domain=body.space.transferred.mesh, metadata={"quadrature_degree": 4})
    trial = ufl.TrialFunction(body.space.space)
    form = fenicsx.form(problem.material.density * ufl.inner(trial, body.v) * dx)
    mass = fenicsx.create_matrix(form)
    fenicsx.assemble_into_matrix(mass, form)
    free = np.arange(body.num_dofs) if is_free else body.free

    def sparse(matrix: Any) -> Any:
        starts, columns, values = matrix.getValuesCSR()
        return csr_matrix((values, columns, starts), shape=matrix.getSize())[free][:, free].tocsc()

    stiffness = sparse(body.tangent(np.zeros(body.num_dofs), 0.0))
    skipped = NUM_RIGID if is_free else 0
    # A little below zero, where the matrix of a free body is regular: squares of 1 rad/s.
    squares = eigsh(
        stiffness, NUM_MODES + skipped, sparse(mass), sigma=-1.0, return_eigenvectors=False
    )
    return _hertz(np.sort(squares)[skipped:])


def judge_modes(modes: Sequence[Modes]) -> list[Finding]:
    """Six zeros of a free body, none of a clamped one, and no frequency that is not there."""
    findings = []
    for bar in modes:
        expected = NUM_RIGID if bar.is_free else 0
        findings.append(
            judged(
                f"{bar.name}: {expected} zero frequencies",
                f"linear {bar.num_zeros[0]}, smoothed {bar.num_zeros[1]}",
                bar.num_zeros == (expected, expected),
            )
        )
        off = bar.smoothed / bar.true - 1.0
        findings.append(
            judged(
                f"{bar.name}: the lowest {NUM_MODES} frequencies of smoothed tetrahedra are "
                f"within {100 * NEARNESS:g} % of quadratic ones: no spurious mode",
                f"{100 * off.min():+.1f} to {100 * off.max():+.1f} %",
                bool(np.abs(off).max() <= NEARNESS),
            )
        )
    return findings


def modes_table(modes: Sequence[Modes]) -> Table:
    """Every frequency."""
    columns = {"body": "", "mode": "d", "quadratic [Hz]": ".4g", "linear [Hz]": ".4g"}
    columns |= {"smoothed [Hz]": ".4g"}
    rows = [
        (bar.name, number, float(true), float(linear), float(smoothed))
        for bar in modes
        for number, (true, linear, smoothed) in enumerate(
            zip(bar.true, bar.linear, bar.smoothed, strict=True), start=1
        )
    ]
    return Table(f"Lowest {NUM_MODES} frequencies, consistent mass", columns, rows)


def draw_modes(modes: Sequence[Modes]) -> Figure:
    """Frequencies over those of quadratic tetrahedra."""
    panels = []
    for bar in modes:
        numbers = [float(k) for k in range(1, len(bar.true) + 1)]
        lines = [
            Line(numbers, linear / bar.true, label=label, colour=colour)
            for label, colour, linear in (
                ("linear", RED, bar.linear),
                ("smoothed", BLUE, bar.smoothed),
            )
        ]
        lines.append(
            Line(numbers, np.ones(len(numbers)), style=":", colour=GREY, label="quadratic")
        )
        panels.append(Panel(lines, "mode", "frequency / quadratic", title=bar.name))
    return line_figure(
        [panels[k : k + 2] for k in range(0, len(panels), 2)],
        "Frequencies over those of quadratic tetrahedra on the same mesh, one by one from the "
        "lowest: a spurious mode would pull the blue line far down.",
        shares_legend=True,
    )
