"""Do the answers converge, and as fast as theory says?

In the cell size h (fastsim's linear tetrahedra), in the degree p (the reference), in the time step
dt (fastsim's explicit steps), each on a smooth problem whose answer is known, where theory gives
the order: p + 1 in the L2 norm, p in the energy norm, 2 in time. A code that solves other equations
than it says converges too, to something else: only the closed forms and the manufactured solution
see that.

Then on the kidney, where nothing is known beforehand: three meshes give the observed order,
Richardson's value and the grid convergence index (Roache 1994; Celik et al. 2008), held against the
stored reference, quadratic tetrahedra on the mesh cut in eight. The edge of the held surface is
singular, displacement there goes like the square root of the distance, so the order falls from 2
to about 1 on uniform meshes: an error falls by half, not by four, with each cut in eight. On meshes
of this size it is still a little below 1, and so Richardson's value may lie beyond the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.reference.availability import is_available
from palpate.validation.case import load_case
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
from palpate.validation.studies.convergence_runs import (
    ColumnGrid,
    ErrorFamily,
    follow_block,
    follow_column,
    follow_degrees,
    follow_manufactured,
    follow_wave,
)
from palpate.validation.studies.kidney import (
    QUANTITIES,
    MeshFamily,
    StoredTruth,
    follow_meshes,
    stored_truth,
)
from palpate.validation.studies.study import Study

# Between the limit, 1, and the order of a smooth problem, 2: nearer the first.
LARGEST_SINGULAR_ORDER = 1.5
_TITLES = {
    "h": "fastsim, manufactured solution",
    "p": "reference, confined column",
    "dt": "fastsim, explicit steps",
}


class Found(NamedTuple):
    """Every family, the column's numbers, the kidney's and what is stored of it."""

    families: Sequence[ErrorFamily]
    grids: Sequence[ColumnGrid]
    meshes: MeshFamily
    truth: Mapping[str, StoredTruth]


def compute(progress: Progress) -> Found:
    """Follow every family; the degrees where FEniCSx is."""
    progress("manufactured solution, linear tetrahedra")
    families = follow_manufactured()
    grids = follow_column()
    if is_available():
        families += follow_degrees(progress)
    progress("explicit steps")
    families += [follow_wave(), follow_block()]
    case = load_case("kidney")
    return Found(families, grids, follow_meshes(case.problem, progress), stored_truth(case))


def judge(found: Found) -> list[Finding]:
    """Orders against theory, and the kidney against its stored reference."""
    return [
        *judge_families(found.families),
        *judge_column(found.grids),
        *judge_kidney(found.meshes, found.truth),
    ]


def judge_families(families: Sequence[ErrorFamily]) -> list[Finding]:
    """Observed orders between the two finest runs against theory."""
    return [
        judged(
            f"{f.name}: order {f.expected_order:g} in {'dt' if f.what == 'dt' else 'h'}, "
            f"within {f.tolerance:g}",
            f"order {', '.join(f'{order:.3f}' for order in f.orders)}; error "
            f"{f.errors[0]:.2e} down to {f.errors[-1]:.2e}",
            f.is_as_expected,
        )
        for f in families
    ]


def judge_column(grids: Sequence[ColumnGrid]) -> list[Finding]:
    """Does the grid convergence index hold what it promises where the answer is known?"""
    return [
        judged(
            f"column, {g.quantity}, P1 (fastsim): order 2 within 0.2, and the error bar of the "
            "grid convergence index holds the exact value",
            f"order {_order(g.assessed)}, {g.assessed.value:.6g} +- {_bar(g.assessed)}, "
            f"extrapolated {_extrapolated(g.assessed)}, exact {g.exact:.6g}",
            g.is_as_expected,
        )
        for g in grids
    ]


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
            "column": column_table(found.grids),
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


def column_table(grids: Sequence[ColumnGrid]) -> Table:
    """GCI where the answer is known."""
    return Table(
        "Confined column, linear tetrahedra on three meshes (fastsim)",
        {"quantity": "", "finest": ".8g", **_ASSESSED, "exact": ".8g"},
        [(g.quantity, g.assessed.value, *_assessed(g.assessed), g.exact) for g in grids],
    )


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


STUDY = Study("Convergence in h, p and dt", __doc__, compute, judge, present)
