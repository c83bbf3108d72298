"""Linear and smoothed tetrahedra side by side: which is nearer the truth in the same time?

A soft bar, four times as long as wide, clamped at one end and bent by a traction on the other, at
four Poisson's ratios up to 0.499, on finer and finer meshes. The truth is the reference's quadratic
tetrahedra, from 0.49 on with pressure among the unknowns (linear tetrahedra lock there, and plain
quadratic ones begin to); the error is the relative L2 distance from it, read at its own points.

The time is processor time of fastsim's equilibrium, without start-up. Other simulators that are
installed stand on the same figure, timed by themselves.

Then frequencies: the lowest twenty of the bar, free and clamped, beside quadratic tetrahedra on the
same mesh, both with consistent mass. A free body has six zeros, and a spurious mode would be a
frequency far below the true one.

Then a mesh whose inner points are moved until its smallest dihedral angle is five degrees; and the
pressures of nodes, which may jump from node to node: how far they scatter about the averages of
cells, which are what is to be read.

Last, bars of few cells through the thickness, and cells longer than high: what `palpate check` says
of them before solving is a rule that is held against them here.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.linalg import cholesky, eigvalsh, norm, solve

from palpate.fastsim.body import Body, lame_parameters
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InvertedCellError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.quality import measure_quality
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.references.field_truth import FieldTruth
from palpate.validation.report.estimates import expected_error
from palpate.validation.report.plots import BLUE, GREY, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.elements_bar import (
    WIDTH,
    Bars,
    bars_table,
    draw_bars,
    follow_bars,
    judge_bars,
    levels_table,
    make_bar,
)
from palpate.validation.studies.study import Study

# What a mesh with slivers does to both elements, and how far node pressures can be read.

DIVISIONS = 8
SLIVER = 5.0  # degrees, the smallest dihedral angle of the distorted mesh


class Distortion(NamedTuple):
    """Both elements on a mesh of bricks, and on the same with its inner points moved.

    Angles are the smallest dihedral ones [degrees]; errors relative L2 distances from the truth,
    regular and distorted.
    """

    poissons_ratio: float
    angles: tuple[float, float]
    linear: tuple[float, float]
    smoothed: tuple[float, float]


class Pressures(NamedTuple):
    """Pressures of smoothed tetrahedra, volumetric part [Pa].

    `at_nodes` is -lmbda theta of each node; `averages` those of the cells, which are means of their
    four nodes, averaged over the cells at the node. `places` are along the axis of the bar [m], and
    the pressures there.
    """

    poissons_ratio: float
    scatter: float
    places: Floats
    at_nodes: Floats
    averages: Floats


def distorted_bar(divisions: int, poissons_ratio: float) -> Problem:
    """Inner points moved as far as leaves a smallest dihedral angle of `SLIVER` or little more."""
    for ragged in np.arange(0.3, 0.0, -0.002):
        try:
            problem = make_bar(divisions, poissons_ratio, ragged=float(ragged))
        except InvertedCellError:
            continue
        if measure_quality(problem.mesh).smallest_dihedral_deg >= SLIVER:
            return problem
    raise AssertionError("bricks as they are have angles of 45 degrees")


def follow_meshes(
    truths: Mapping[float, FieldTruth], progress: Progress, *, divisions: int = DIVISIONS
) -> tuple[list[Distortion], list[Pressures]]:
    """Both elements on both meshes, and the pressures on the regular one."""
    distortions, pressures = [], []
    for nu, truth in truths.items():
        progress(f"distorted mesh, nu = {nu:g}")
        problems = make_bar(divisions, nu), distorted_bar(divisions, nu)
        first, second = (measure_quality(p.mesh).smallest_dihedral_deg for p in problems)
        answers = {e: [solve_static(p, element=e).displacement for p in problems] for e in Element}
        linear, smoothed = (
            [truth.error_of(p.mesh, u) for p, u in zip(problems, answers[e], strict=True)]
            for e in Element
        )
        distortions.append(
            Distortion(nu, (first, second), (linear[0], linear[1]), (smoothed[0], smoothed[1]))
        )
        pressures.append(read_pressures(problems[0], answers[Element.SMOOTHED][0]))
    return distortions, pressures


def read_pressures(problem: Problem, displacement: Points) -> Pressures:
    """Of an answer of smoothed tetrahedra on a bar."""
    mesh = problem.mesh
    body = Body.of(problem, Strain.GREEN, element=Element.SMOOTHED)
    H = body.displacement_gradients(displacement).reshape(-1, 3, 3)
    # tr E = tr H + H : H / 2.
    trace = np.trace(H, axis1=1, axis2=2) + 0.5 * (H**2).sum(axis=(1, 2))
    volumes = signed_volumes(mesh.points, mesh.cells)

    def at_nodes(of_cells: Floats) -> Floats:
        corners = mesh.cells.ravel()
        weights = np.repeat(volumes, 4)
        sums = np.bincount(corners, weights * np.repeat(of_cells, 4), mesh.num_points)
        found: Floats = sums / np.bincount(corners, weights, mesh.num_points)
        return found

    pressure = -lame_parameters(problem.material)[0] * at_nodes(trace)
    averages = at_nodes(pressure[mesh.cells].mean(axis=1))
    on_axis = (norm(mesh.points[:, 1:] - 0.5 * WIDTH, axis=1) < 1e-9 * WIDTH).nonzero()[0]
    on_axis = on_axis[np.argsort(mesh.points[on_axis, 0])]
    scatter = float(norm(pressure - averages) / norm(averages))
    return Pressures(
        problem.material.poissons_ratio,
        scatter,
        mesh.points[on_axis, 0],
        pressure[on_axis],
        averages[on_axis],
    )


def judge_distortions(distortions: Sequence[Distortion]) -> list[Finding]:
    """Slivers may cost something, but not what smoothing gains."""
    return [
        judged(
            f"nu = {d.poissons_ratio:g}: smoothed tetrahedra with slivers of {d.angles[1]:.1f} "
            "degrees are nearer the truth than linear ones on the regular mesh",
            f"{100 * d.smoothed[1]:.2f} % against {100 * d.linear[0]:.1f} %",
            d.smoothed[1] < d.linear[0],
        )
        for d in distortions
    ]


def distortions_table(distortions: Sequence[Distortion]) -> Table:
    """Errors on both meshes."""
    columns = {"Poisson's ratio": "g", "mesh": "", "smallest dihedral [deg]": ".1f"}
    columns |= {"linear": ".4f", "smoothed": ".4f"}
    rows = [
        (d.poissons_ratio, name, *numbers)
        for d in distortions
        for name, *numbers in zip(
            ("regular", "distorted"), d.angles, d.linear, d.smoothed, strict=True
        )
    ]
    return Table("Errors on a distorted mesh beside the regular one", columns, rows)


def pressures_table(pressures: Sequence[Pressures]) -> Table:
    """How far node pressures scatter about the cells' averages."""
    columns = {"Poisson's ratio": "g", "scatter of node pressures / cell averages": ".3f"}
    rows = [(p.poissons_ratio, p.scatter) for p in pressures]
    return Table("Node pressures: read cell averages instead", columns, rows)


def draw_pressures(pressures: Sequence[Pressures]) -> Figure:
    """Along the axis of the bar, at the largest Poisson's ratio."""
    last = pressures[-1]
    lines = [
        Line(1e3 * last.places, last.at_nodes, label="at nodes", colour=RED),
        Line(1e3 * last.places, last.averages, label="averages of cells", colour=BLUE),
    ]
    panel = Panel(
        lines,
        x="along the axis [mm]",
        y="pressure [Pa]",
        title=f"Poisson's ratio {last.poissons_ratio:g}",
    )
    return line_figure(
        [[panel]],
        "Node pressures of smoothed tetrahedra may jump from node to node like a checkerboard; "
        "displacements, forces and volumes do not. Read the averages of cells.",
        shares_legend=False,
    )


# The lowest frequencies of a free and a clamped bar: is any of them one that should not be?
#
# fastsim's stiffness at rest and the consistent mass of linear tetrahedra, beside quadratic ones on
# the same mesh by the reference.

MODE_DIVISIONS = 4
MODE_RATIOS = (0.3, 0.49)
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
    progress: Progress, *, divisions: int = MODE_DIVISIONS, ratios: Sequence[float] = MODE_RATIOS
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


# Few cells through the thickness: what both elements miss in bending, beside the rule for it.
#
# `palpate check` says before solving what a body as thin for its mesh will miss; here the rule is
# held against bars of 1 to 8 cells through the thickness, one to four times as long as high.

THROUGH = (1, 2, 3, 4, 8)
SLENDERNESS = (1, 2, 4)
# A rule to choose a mesh by. Of linear tetrahedra it is to be right but for a fifth; of smoothed
# ones, which are soon good, it may say three times too much, and half as much again too little,
# where one of both is above what anybody asks for.
LINEAR_WITHIN = 0.2
SMOOTHED_BELOW, SMOOTHED_ABOVE = 1.0 / 3.0, 1.5
NOBODY_ASKS = 0.01
_COLOURS = {Element.LINEAR: RED, Element.SMOOTHED: BLUE}


class Thin(NamedTuple):
    """A bar on one mesh: relative L2 errors of both elements, and what the rule says."""

    poissons_ratio: float
    num_cells: int
    slenderness: int
    linear: float
    smoothed: float
    linear_rule: float
    smoothed_rule: float


def follow_thin(
    truths: Mapping[float, FieldTruth],
    progress: Progress,
    *,
    through: Sequence[int] = THROUGH,
    slenderness: Sequence[int] = SLENDERNESS,
) -> list[Thin]:
    """Both elements on every mesh that whole cells make."""
    found = []
    for nu, truth in truths.items():
        progress(f"cells through the thickness, nu = {nu:g}")
        for a in slenderness:
            for n in (n for n in through if 4 * n % a == 0):
                problem = make_bar(n, nu, slenderness=a)
                linear, smoothed = (
                    truth.error_of(
                        problem.mesh, solve_static(problem, element=element).displacement
                    )
                    for element in Element
                )
                rules = [expected_error(n, a, nu, element) for element in Element]
                found.append(Thin(nu, n, a, linear, smoothed, rules[0], rules[1]))
    return found


def judge_thin(bars: Sequence[Thin]) -> list[Finding]:
    """The rule of `palpate check`, at each Poisson's ratio."""
    findings = []
    for nu in dict.fromkeys(bar.poissons_ratio for bar in bars):
        of = [bar for bar in bars if bar.poissons_ratio == nu]
        ratios = [bar.linear / bar.linear_rule for bar in of]
        findings.append(
            judged(
                f"nu = {nu:g}: the rule says what linear tetrahedra miss in bending, but for "
                f"{100 * LINEAR_WITHIN:g} % of it, with {_words(of)}",
                f"{min(ratios):.2f} to {max(ratios):.2f} times the rule",
                all(abs(ratio - 1.0) <= LINEAR_WITHIN for ratio in ratios),
            )
        )
        asked = [bar for bar in of if max(bar.smoothed, bar.smoothed_rule) >= NOBODY_ASKS]
        ratios = [bar.smoothed / bar.smoothed_rule for bar in asked]
        findings.append(
            judged(
                f"nu = {nu:g}: smoothed tetrahedra miss at most {SMOOTHED_ABOVE:g} times what the "
                f"rule says and at least a third of it, from {100 * NOBODY_ASKS:g} % on",
                f"{min(ratios, default=0.0):.2f} to {max(ratios, default=0.0):.2f} times the rule",
                all(SMOOTHED_BELOW <= ratio <= SMOOTHED_ABOVE for ratio in ratios),
            )
        )
    return findings


def _words(bars: Sequence[Thin]) -> str:
    counts, lengths = ({getattr(b, key) for b in bars} for key in ("num_cells", "slenderness"))
    return (
        f"{min(counts)} to {max(counts)} cells through the thickness, {min(lengths)} to "
        f"{max(lengths)} times as long as high"
    )


def thin_table(bars: Sequence[Thin]) -> Table:
    """Every mesh."""
    columns = {"Poisson's ratio": "g", "cells through": "d", "length / height": "d"}
    columns |= {"linear": ".4f", "smoothed": ".4f", "linear, rule": ".4f", "smoothed, rule": ".4f"}
    return Table("Cells through the thickness: errors, and what the rule says", columns, bars)


def draw_thin(bars: Sequence[Thin]) -> Figure:
    """Cells as long as high; a panel for each Poisson's ratio."""
    panels = []
    for nu in dict.fromkeys(bar.poissons_ratio for bar in bars):
        of = [bar for bar in bars if (bar.poissons_ratio, bar.slenderness) == (nu, 1)]
        cells = [float(bar.num_cells) for bar in of]
        lines = []
        for element, colour in _COLOURS.items():
            errors, rules = (
                [getattr(bar, name) for bar in of] for name in (f"{element}", f"{element}_rule")
            )
            lines.append(Line(cells, errors, label=f"{element}", style="-o", colour=colour))
            lines.append(Line(cells, rules, label=f"{element}, rule", style="--", colour=colour))
        panels.append(
            Panel(
                lines,
                "cells through the thickness",
                "relative L2 error",
                title=f"Poisson's ratio {nu:g}",
                log="xy",
            )
        )
    return line_figure(
        [panels[k : k + 2] for k in range(0, len(panels), 2)],
        "What both elements miss where few cells, as long as high, lie through the thickness of a "
        "bent bar, and what `palpate check` says of it before solving.",
        shares_legend=True,
    )


class Found(NamedTuple):
    """What was run; no modes where scipy is missing."""

    bars: Bars
    modes: Sequence[Modes] = ()
    distortions: Sequence[Distortion] = ()
    pressures: Sequence[Pressures] = ()
    thin: Sequence[Thin] = ()


def compute(progress: Progress) -> Found:
    """Run everything.

    Raises:
        ReferenceFailedError: No FEniCSx, and so no truth.
    """
    bars = follow_bars(progress)
    thin = follow_thin(bars.truths, progress)
    return Found(bars, follow_modes(progress), *follow_meshes(bars.truths, progress), thin)


def judge(found: Found) -> list[Finding]:
    """Limits near incompressibility, equal errors and times, frequencies, slivers, thin bodies."""
    return [
        *judge_bars(found.bars),
        *judge_modes(found.modes),
        *judge_distortions(found.distortions),
        *judge_thin(found.thin),
    ]


def present(found: Found) -> Page:
    """Error over processor time, every run, frequencies, slivers and pressures."""
    bars, modes = found.bars, found.modes
    changes = {f"{nu:g}": change for nu, change in bars.truth_changes.items()}
    left_out = [*bars.left_out, *([] if modes else [NO_SCIPY])]
    figures = {"bar": draw_bars(bars)}
    tables = {"times": levels_table(bars), "bar": bars_table(bars)}
    if modes:
        figures["modes"] = draw_modes(modes)
        tables["modes"] = modes_table(modes)
    if found.distortions:
        tables["distorted"] = distortions_table(found.distortions)
    if found.pressures:
        figures["pressures"] = draw_pressures(found.pressures)
        tables["pressures"] = pressures_table(found.pressures)
    if found.thin:
        figures["thin"] = draw_thin(found.thin)
        tables["thin"] = thin_table(found.thin)
    return Page(
        figures=figures,
        tables=tables,
        remarks=[f"Left out: {line}" for line in left_out],
        numbers={"truth_changes": changes, "left_out": left_out},
    )


STUDY = Study("Linear and smoothed tetrahedra", __doc__, compute, judge, present)
