"""Do the answers converge, and as fast as theory says?

In the cell size h and the degree p on a confined column that is pulled by its own weight, in the
time step dt (fastsim's explicit steps) on a block that is let go. The column's stretch is known in
closed form: rollers on the sides leave one unknown, the stretch a(x) along the column of length L,
with (lmbda + 2 mu) a (a^2 - 1) / 2 = f (L - x). Theory gives the order: p in the energy norm, 2 p
for a change of volume, 2 in time. The difference of strain energy at equilibrium is the square of
the energy norm of the error, to leading order.

Then on the kidney, where nothing is known beforehand: three meshes give the observed order,
Richardson's value and the grid convergence index (Roache 1994; Celik et al. 2008), held against the
stored reference, quadratic tetrahedra on the mesh cut in eight. The edge of the held surface is
singular, displacement there goes like the square root of the distance, so the order falls from 2
to about 1 on uniform meshes: an error falls by half, not by four, with each cut in eight. On meshes
of this size it is still a little below 1, and so Richardson's value may lie beyond the truth.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from palpate.fastsim.body import Body, lame_parameters
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Traction
from palpate.meshes.bricks import brick_box, rollers, side, support_of
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.refinement import refine_problem
from palpate.reference.availability import is_available
from palpate.validation.case import load_case
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.grid_convergence import GridConvergence
from palpate.validation.report.plots import (
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    RED,
    Figure,
    Line,
    Panel,
    line_figure,
)
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.kidney import (
    QUANTITIES,
    MeshFamily,
    StoredTruth,
    follow_meshes,
    stored_truth,
)
from palpate.validation.studies.study import volume_change

TITLE = "Convergence in h, p and dt"

# Between the limit, 1, and the order of a smooth problem, 2: nearer the first.
LARGEST_SINGULAR_ORDER = 1.5
_TITLES = {
    "h": "fastsim, confined column",
    "p": "reference, confined column",
    "dt": "fastsim, explicit steps",
}
MATERIAL = Material(1.0, 0.3, 1.0)
LENGTH, WIDTH = 1.0, 0.5
# f L / (lmbda + 2 mu): stretched by 1.276 where it is held.
LOAD = 0.4
# How many meshes of the column, each cut in eight, for each degree: more would take minutes, and
# drown in rounding; and what the order may be off where so many are near the limit.
LEVELS = {1: 3, 2: 3, 3: 2}
_TOLERANCES = {1: 0.1, 2: 0.1, 3: 0.2}
_OUTPUTS = 20


@dataclass(frozen=True)
class ErrorFamily:
    """Relative errors of ever finer runs against an exact solution, or one that is far better.

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


class Found(NamedTuple):
    """Every family, the kidney's numbers and what is stored of it."""

    families: Sequence[ErrorFamily]
    meshes: MeshFamily
    truth: Mapping[str, StoredTruth]


class ColumnNumbers(NamedTuple):
    """Strain energy [J] and change of volume over the rest volume [-]."""

    strain_energy: float
    volume_change: float


def column(refinements: int) -> Problem:
    """The column on a mesh whose inner points are moved, so that no symmetry helps.

    Args:
        refinements: How often its 96 cells are cut in eight.
    """
    mesh = brick_box((4, 2, 2), (LENGTH, WIDTH, WIDTH), ragged=0.1)
    sides = ((0, 0.0), (1, 0.0), (1, WIDTH), (2, 0.0), (2, WIDTH))
    force = LOAD * _confined_modulus() / LENGTH
    problem = Problem(mesh, MATERIAL, rollers(mesh, sides), (BodyForce((force, 0.0, 0.0)),))
    for _ in range(refinements):
        problem = refine_problem(problem)
    return problem


def _confined_modulus() -> float:
    lmbda, mu = lame_parameters(MATERIAL)
    return lmbda + 2.0 * mu


def exact_column() -> ColumnNumbers:
    """By Gauss quadrature of the closed form, to rounding."""
    nodes, weights = np.polynomial.legendre.leggauss(40)  # type: ignore[no-untyped-call]
    load = LOAD * 0.5 * (1.0 - nodes)
    a = np.array([max(np.roots([1.0, 0.0, -1.0, -2.0 * one]).real) for one in load])
    energy = LENGTH * WIDTH**2 * _confined_modulus() / 8.0 * 0.5 * weights @ (a**2 - 1.0) ** 2
    return ColumnNumbers(float(energy), float(0.5 * weights @ (a - 1.0)))


def follow_column(progress: Progress, *, levels: int = 3) -> list[ErrorFamily]:
    """Fastsim's linear tetrahedra on the column: energy norm and change of volume."""
    exact, found, notes = exact_column(), [], []
    for level in range(levels):
        problem = column(level)
        progress(f"column, fastsim, {_num_cells(problem)}")
        u = solve_static(problem).displacement
        energy = body_of(problem, Strain.GREEN).energy(u)
        found.append(
            (
                abs(energy / exact.strain_energy - 1.0) ** 0.5,
                abs(volume_change(problem.mesh, u) / exact.volume_change - 1.0),
            )
        )
        notes.append(_num_cells(problem))
    sizes = tuple(0.5**level for level in range(levels))
    return [
        ErrorFamily(f"confined column, {norm} of P1 (fastsim)", f"P1, {norm}", "h", sizes,
                    tuple(pair[k] for pair in found), order, tolerance, tuple(notes))
        for k, (norm, order, tolerance) in enumerate(
            (("energy norm", 1.0, 0.1), ("change of volume", 2.0, 0.2))
        )
    ]  # fmt: skip


def follow_degrees(progress: Progress, *, levels: Mapping[int, int] = LEVELS) -> list[ErrorFamily]:
    """The reference's P1, P2 and P3 on the column, on so many meshes each: the energy norm."""
    from palpate.reference.child import run_task
    from palpate.reference.tasks import StaticTask

    exact = exact_column()
    families = []
    for degree, count in levels.items():
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


def follow_block(
    bricks: int = 2, *, halvings: int = 3, end_time: float = 6.0, damping: float = 0.1
) -> ErrorFamily:
    """A block that a traction sets swinging, the step halved, against a step a sixteenth of that.

    It is 2 x 1 x 1 m and turns far beyond small rotations; the mesh is the same for all steps.

    Args:
        bricks: Over the height.
        halvings: Of the step, from about 0.8 of the critical one.
        end_time: [s].
        damping: Mass damping [1/s].
    """
    mesh = brick_box((2 * bricks, bricks, bricks), (2.0, 1.0, 1.0), ragged=0.1)
    load = Traction(side(mesh, 0, 2.0), (0.0, 0.01, -0.02))
    problem = Problem(mesh, MATERIAL, (support_of(side(mesh, 0, 0.0)),), (load,))
    longest = 0.8 * Body(mesh, MATERIAL).critical_time_step_bound()
    between = end_time / _OUTPUTS
    counts = [math.ceil(between / longest) * 2**k for k in range(halvings + 1)]

    def states(per_output: int) -> Points:
        span = TimeSpan(end_time, between / per_output, damping, _OUTPUTS)
        return simulate(dataclasses.replace(problem, time=span)).displacements

    truth = states(16 * counts[-1])
    scale = max(l2_norm(mesh, u) for u in truth)
    errors = [
        max(l2_norm(mesh, u - v) for u, v in zip(states(count), truth, strict=True)) / scale
        for count in counts
    ]
    name = "block let go, Green strain, damped: dt alone, against a small step (fastsim)"
    sizes = tuple(between / count for count in counts)
    notes = tuple(f"dt = {size:.4g} s" for size in sizes)
    return ErrorFamily(name, "block, small step", "dt", sizes, tuple(errors), 2.0, 0.1, notes)


def _num_cells(problem: Problem) -> str:
    return f"{problem.mesh.num_cells} cells"


def compute(progress: Progress) -> Found:
    """Follow every family; the degrees where FEniCSx is."""
    families = follow_column(progress, levels=4)
    if is_available():
        families += follow_degrees(progress)
    progress("explicit steps")
    families.append(follow_block())
    case = load_case("kidney")
    return Found(families, follow_meshes(case.problem, progress), stored_truth(case))


def judge(found: Found) -> list[Finding]:
    """Orders against theory, and the kidney against its stored reference."""
    families = [
        judged(
            f"{f.name}: order {f.expected_order:g} in {'dt' if f.what == 'dt' else 'h'}, "
            f"within {f.tolerance:g}",
            f"order {', '.join(f'{order:.3f}' for order in f.orders)}; error "
            f"{f.errors[0]:.2e} down to {f.errors[-1]:.2e}",
            f.is_as_expected,
        )
        for f in found.families
    ]
    return families + judge_kidney(found.meshes, found.truth)


def judge_kidney(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> list[Finding]:
    """The kidney's orders and bars, and whether they agree with the stored reference."""
    findings = []
    for quantity, (unit, _) in QUANTITIES.items():
        found, known = meshes.assess(quantity), truth[quantity]
        bar, index = found.error_bar, found.index_fine
        is_singular = found.order is not None and found.order <= LARGEST_SINGULAR_ORDER
        agrees = bar is not None and abs(found.value - known.value) <= bar + known.bar
        findings.append(
            judged(
                f"kidney, {quantity}: the clamp holds the order below {LARGEST_SINGULAR_ORDER:g}, "
                "and the finest value agrees with the stored P2 within both error bars",
                f"order {_order(found)}, {found.value:.5g} +- {_bar(found)} {unit} (GCI "
                f"{'-' if index is None else f'{100 * index:.2f} %'}), extrapolated "
                f"{_extrapolated(found)}; stored {known.value:.5g} +- {known.bar:.3g}",
                is_singular and agrees,
            )
        )
    return findings


def _order(found: GridConvergence) -> str:
    return str(found.behaviour) if found.order is None else f"{found.order:.2f}"


def _bar(found: GridConvergence) -> str:
    return "no bar" if found.error_bar is None else f"{found.error_bar:.3g}"


def _extrapolated(found: GridConvergence) -> str:
    return "-" if found.extrapolated is None else f"{found.extrapolated:.6g}"


def present(found: Found) -> Page:
    """Errors over sizes, the kidney's numbers over sizes, and all of it in tables."""
    has_degrees = any(f.what == "p" for f in found.families)
    left_out = "Degrees 1 to 3 of the reference are left out: FEniCSx is not here."
    return Page(
        figures={
            "orders": draw_families(found.families),
            "kidney": draw_kidney(found.meshes, found.truth),
        },
        tables={
            "families": family_table(found.families),
            "kidney_grids": kidney_table(found.meshes, found.truth),
        },
        remarks=() if has_degrees else (left_out,),
    )


def family_table(families: Sequence[ErrorFamily]) -> Table:
    """Every run with its error and order."""
    columns = {"family": "", "varied": "", "run": "", "relative error": ".4e", "order": ".3f"}
    rows = [
        (f.name, f.what, note, error, order, f.expected_order)
        for f in families
        for note, error, order in zip(f.notes, f.errors, (None, *f.orders), strict=True)
    ]
    return Table("Errors and observed orders", {**columns, "theory": "g"}, rows)


_ASSESSED = {"order": ".2f", "extrapolated": ".6g", "error bar": ".3g", "GCI [%]": ".2f"}


def _assessed(found: GridConvergence) -> tuple[Any, ...]:
    order = str(found.behaviour) if found.order is None else found.order
    return order, found.extrapolated, found.error_bar, _percent(found.index_fine)


def _percent(value: float | None) -> float | None:
    return None if value is None else 100.0 * value


def kidney_table(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> Table:
    """The kidney's numbers on three meshes, with order, Richardson's value and GCI."""
    columns = {"quantity": "", **{f"{n} cells": ".6g" for n in meshes.cells}, **_ASSESSED}
    rows = []
    for quantity, (unit, _) in QUANTITIES.items():
        found, values = meshes.assess(quantity), [r[quantity] for r in meshes.responses]
        coarse = _percent(found.index_coarse)
        name = f"{quantity} [{unit}]"
        rows.append((name, *values, *_assessed(found), coarse, *truth[quantity]))
    return Table(
        "Kidney, linear tetrahedra on its mesh and on that mesh cut in eight, twice (fastsim)",
        {**columns, "GCI coarse [%]": ".2f", "stored P2": ".6g", "its bar": ".3g"},
        rows,
    )


def draw_families(families: Sequence[ErrorFamily]) -> Figure:
    """Errors over size, a panel each for h, p and dt, with the slope of theory beside them."""
    panels = []
    for what, title in _TITLES.items():
        lines: list[Line] = []
        ticks: dict[float, str] = {}
        for f, colour in zip((f for f in families if f.what == what), COLOURS, strict=False):
            sizes = np.array(f.sizes) / f.sizes[0]
            theory = f.errors[-1] * (sizes / sizes[-1]) ** f.expected_order
            label = f"{f.label}: {f.orders[-1]:.2f}"
            lines.append(Line(sizes, theory, style="--", width=0.9, colour=GREY))
            lines.append(Line(sizes, f.errors, label=label, colour=colour))
            ticks |= {round(s, 6): f"1/{round(1 / s)}" if s < 1 else "1" for s in sizes}
        if lines:
            x = "step, longest = 1" if what == "dt" else "cell size, coarsest = 1"
            # Room for the legend above the lines.
            errors = [error for line in lines for error in line.y]
            top = max(errors) * (max(errors) / min(errors)) ** 0.35
            panels.append(
                Panel(lines, ticks=ticks, log="xy", title=title, x=x, y="relative error",
                      y_range=(None, top))
            )  # fmt: skip
    return line_figure(
        [panels],
        "Errors against the exact answer (block let go: against a small step). Dashed: the "
        "slope of theory through the finest run; the number is the order observed last.",
        shares_legend=False,
    )


def draw_kidney(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> Figure:
    """Each number over cell size, with Richardson's value and both error bars."""
    sizes = np.array([0.5**k for k in range(len(meshes.cells))])
    panels = []
    for quantity, (unit, _) in QUANTITIES.items():
        found, known = meshes.assess(quantity), truth[quantity]
        values = [r[quantity] for r in meshes.responses]
        lines = [
            Line((0.0, 1.0), (known.value,) * 2, style="-", colour=GREEN,
                 label="stored P2, its bar"),
            Line(sizes, values, colour=BLUE, label="P1 on three meshes"),
        ]  # fmt: skip
        if found.extrapolated is not None and found.order is not None:
            h = np.linspace(0.0, 1.0, 60)
            slope = (values[-1] - found.extrapolated) / sizes[-1] ** found.order
            power_law = found.extrapolated + slope * h**found.order
            lines += [
                Line(h, power_law, style=":", colour=BLUE),
                Line((0.0,), (found.extrapolated,), style="s", colour=RED, label="Richardson"),
            ]
        if found.error_bar is not None:
            ends = (found.value - found.error_bar, found.value + found.error_bar)
            lines.append(Line((sizes[-1],) * 2, ends, style="-_", colour=BLUE))
        panels.append(
            Panel(
                lines,
                band=(known.value - known.bar, known.value + known.bar),
                ticks={0.0: "0", 0.25: "1/4", 0.5: "1/2", 1.0: "1"},
                title=f"{quantity} [{unit}]\nobserved order {_order(found)}",
                x="cell size, first mesh = 1",
            )
        )
    return line_figure(
        [panels],
        f"The kidney on meshes of {', '.join(map(str, meshes.cells))} cells. The dotted line "
        "is the power law through the three; the bar at the finest is its grid convergence "
        "index.",
        shares_legend=True,
    )
