"""Turek-Hron CSM3: a bar falls from rest and swings, by the implicit reference.

S. Turek, J. Hron, Proposal for numerical benchmarking of fluid-structure interaction between an
elastic object and laminar incompressible flow, 2006: circle of radius 0.05 about (0.2, 0.2), bar
0.02 high to x = 0.6, clamped on the arc, plane strain, E = 1.4e6, nu = 0.4, density 1000, body
force 2 per mass. One layer of cells with uz = 0 on both sides; degree 2, no damping.

The second bending mode rings along undamped, so the extremes of one period differ by a few per
cent from period to period and from time step to time step. What is compared with the published
extremes is the last period, as published; what is shown to converge is the mean and the first
harmonic of the whole run.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box, held, rollers
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.report.plots import Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.study import Study

# Layers of cells over the bar's height, time step [s]: steps on one mesh, then the mesh halved.
RUNS = ((2, 0.04), (2, 0.02), (2, 0.01), (2, 0.005), (4, 0.01))
END = 10.0
_HARMONICS = 3


class Period(NamedTuple):
    """Mean and amplitude of A along x and y [mm], frequency [1/s]."""

    mean: tuple[float, float]
    amplitude: tuple[float, float]
    frequency: float


CONVERGED = Period((-14.305, -63.607), (14.305, 65.160), 1.0995)
# Level 2+0 with steps of 0.02 s.
COARSE = Period((-14.384, -64.271), (14.389, 64.595), 1.0956)


class Swing(NamedTuple):
    """How point A swings, [mm] and [1/s].

    `last` is by the extremes of the last period, as published, with the frequency that fits the
    whole run best; `level` and `first_harmonic` are mean and amplitude along y of the whole run.
    `energy_error` is the largest of the balance over the largest strain energy [-], `path` where A
    goes along x and y, (num_times, 2).
    """

    num_layers: int
    time_step: float
    last: Period
    level: float
    first_harmonic: float
    energy_error: float
    path: Points


def bar_body(divisions: tuple[int, int, int]) -> tuple[TetMesh, tuple[Support, ...], int]:
    """The bar, how it is held in plane strain, and the number of its point A = (0.6, 0.2).

    Args:
        divisions: Bricks of six tetrahedra along, over the height (even) and through; the body is
            as thick as its bricks are high for each of the last.
    """
    thickness = 0.02 * divisions[2] / divisions[1]
    flat = brick_box(divisions, (1.0, 1.0, thickness))
    points = flat.points.copy()
    points[:, 1] = 0.19 + 0.02 * flat.points[:, 1]
    arc = 0.2 + np.sqrt(0.05**2 - (points[:, 1] - 0.2) ** 2)
    points[:, 0] = arc + (0.6 - arc) * flat.points[:, 0] ** 1.5  # finer towards the clamp
    mesh = TetMesh(points, flat.cells)
    facets = mesh.boundary_facets
    clamped = facets[(flat.points[facets, 0] == 0.0).all(axis=1)]
    supports = (held(clamped), *rollers(mesh, ((2, 0.0), (2, thickness))))
    return mesh, supports, int(np.argmin(np.linalg.norm(points - [0.6, 0.2, 0.0], axis=1)))


def bar_problem(num_layers: int, time_step: float, end_time: float = END) -> tuple[Problem, int]:
    """The bar in motion and the number of its point A; `num_layers` is even."""
    mesh, supports, place = bar_body((10 * num_layers, num_layers, 1))
    span = TimeSpan(end_time, time_step, 0.0, round(end_time / time_step))
    load = BodyForce((0.0, -2000.0, 0.0))
    return Problem(mesh, Material(1.4e6, 0.4, 1000.0), supports, (load,), span), place


def swing(num_layers: int, time_step: float, end_time: float = END) -> Swing:
    """Run the bar and measure how A swings."""
    from palpate.reference.child import run_task
    from palpate.reference.tasks import ImplicitTask

    problem, place = bar_problem(num_layers, time_step, end_time)
    result = run_task(ImplicitTask(degree=2, spectral_radius=1.0), problem, time_limit=7200.0)
    path: Points = 1e3 * result.displacements[:, place, :2]
    frequency, level, harmonic = fit(result.times, path[:, 1])
    last = path[result.times >= end_time - 1.0 / frequency]
    (high_x, high_y), (low_x, low_y) = last.max(axis=0).tolist(), last.min(axis=0).tolist()
    return Swing(
        num_layers,
        time_step,
        Period(
            ((high_x + low_x) / 2.0, (high_y + low_y) / 2.0),
            ((high_x - low_x) / 2.0, (high_y - low_y) / 2.0),
            frequency,
        ),
        level,
        harmonic,
        float(np.abs(result.energy_errors).max() / result.strain_energies.max()),
        path,
    )


def fit(times: Points, values: Points) -> tuple[float, float, float]:
    """Frequency of the harmonics that fit best, their mean, and the first one's amplitude."""

    def leftover(frequency: float) -> tuple[float, Points]:
        angles = 2.0 * math.pi * frequency * np.outer(times, np.arange(1, _HARMONICS + 1))
        basis = np.hstack([np.ones((len(times), 1)), np.cos(angles), np.sin(angles)])
        weights, *_ = np.linalg.lstsq(basis, values, rcond=None)
        return float(np.sum((basis @ weights - values) ** 2)), weights

    low, high = 0.9, 1.3
    for _ in range(4):
        tried = np.linspace(low, high, 41)
        best = float(tried[int(np.argmin([leftover(float(f))[0] for f in tried]))])
        step = float(tried[1] - tried[0])
        low, high = best - step, best + step
    weights = leftover(best)[1]
    return best, float(weights[0]), float(np.hypot(weights[1], weights[1 + _HARMONICS]))


def farthest(found: Period, published: Period) -> float:
    """Largest relative distance from a published row, of its five numbers [-]."""
    ours = (*found.mean, *found.amplitude, found.frequency)
    theirs = (*published.mean, *published.amplitude, published.frequency)
    return max(abs(a / b - 1.0) for a, b in zip(ours, theirs, strict=True))


def compute(progress: Progress) -> list[Swing]:
    """Run the sequence."""
    found = []
    for num_layers, time_step in RUNS:
        progress(f"{num_layers} layers of cells, steps of {time_step:g} s")
        found.append(swing(num_layers, time_step))
    return found


def converged_frequency(rows: list[Swing]) -> tuple[float, float]:
    """Frequency [1/s] extrapolated to no time step on the fine mesh, and its order in the step."""
    by = {(r.num_layers, r.time_step): r.last.frequency for r in rows}
    a, b, c = (by[2, dt] for dt in (0.02, 0.01, 0.005))
    order = math.log2(abs(b - a) / abs(c - b)) if c != b else math.inf
    return c + (c - b) / 3.0 + by[4, 0.01] - by[2, 0.01], order


def judge(rows: list[Swing]) -> list[Finding]:
    """Against the published rows."""
    by = {(r.num_layers, r.time_step): r for r in rows}
    limit, order = converged_frequency(rows)
    first, coarse = by[4, 0.01].first_harmonic, farthest(by[2, 0.02].last, COARSE)
    frequency_off = limit / CONVERGED.frequency - 1.0
    amplitude_off = first / CONVERGED.amplitude[1] - 1.0
    return [
        judged(
            "frequency within 0.5 % of 1.0995 1/s, extrapolated to no time step, fine mesh",
            f"{limit:.4f} 1/s, {frequency_off:+.2%}",
            abs(frequency_off) <= 0.005,
        ),
        judged(
            "amplitude along y within 0.5 % of 65.160 mm (first harmonic of the run)",
            f"{first:.3f} mm, {amplitude_off:+.2%}",
            abs(amplitude_off) <= 0.005,
        ),
        judged(
            "steps of 0.02 s: all five numbers within 1 % of the published row of that step",
            f"at most {coarse:.2%} off",
            coarse <= 0.01,
        ),
        judged(
            "frequency converges with second order in the time step",
            f"order {order:.2f}",
            abs(order - 2.0) <= 0.3,
        ),
    ]


def present(rows: list[Swing]) -> Page:
    """How A swings, as numbers and as a figure."""
    columns = {"layers": "d", "step [s]": "g", "mean x": ".3f", "mean y": ".3f"}
    columns |= {"amplitude x": ".3f", "amplitude y": ".3f", "frequency": ".4f", "level y": ".3f"}
    table = Table(
        "Point A, millimetres and 1/s; last period, then whole run",
        {**columns, "first harmonic y": ".3f", "energy error": ".1e"},
        [
            (r.num_layers, r.time_step, *r.last.mean, *r.last.amplitude, r.last.frequency, *r[3:6])
            for r in rows
        ],
    )  # fmt: skip
    lines = [
        Line(
            r.time_step * np.arange(n),
            r.path[:n, 1],
            style="-",
            label=f"{r.num_layers} layers, {r.time_step:g} s",
        )
        for r in rows
        for n in [round(4.0 / r.time_step) + 1]
    ]
    panel = Panel(lines, x="t [s]", y="u_y of A [mm]")
    figure = line_figure([[panel]], "Displacement of A along y, 0 to 4 s.", shares_legend=True)
    limit, order = converged_frequency(rows)
    numbers = {"frequency": limit, "order": order}
    return Page(figures={"swing": figure}, tables={"swing": table}, numbers=numbers)


STUDY = Study("Turek-Hron CSM3", __doc__, compute, judge, present)
