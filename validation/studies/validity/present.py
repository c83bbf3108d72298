"""The validity map as tables to look up where linear strain may be believed, and as figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np

from palpate.validation.report.plots import (
    BLUE,
    COLOURS,
    GREY,
    RED,
    Figure,
    Line,
    Panel,
    line_figure,
)
from palpate.validation.report.study_page import Page, Table
from palpate.validation.studies.validity.block import Mode, ModePoint
from palpate.validation.studies.validity.rising import (
    LIMITS,
    BendingLimit,
    BendingPoint,
    DegreeCheck,
    border,
)

# What is lost at which load, in what linear strain predicts, and the smallest stretch there.
ModeLimits = dict[tuple[Mode, float], tuple[float, float] | None]
_PERCENT = [f"{100 * x:g} %" for x in LIMITS]
# Poisson's ratio of the figures.
_SHOWN_RATIO = 0.3


class Found(NamedTuple):
    """The map; `finer` is the limit of one of its bars on a finer mesh."""

    points: Sequence[BendingPoint]
    limits: Sequence[BendingLimit]
    finer: BendingLimit
    modes: Sequence[ModePoint]
    ends: ModeLimits
    checks: Sequence[DegreeCheck]


def present(found: Found) -> Page:
    """Tables to look up, and figures."""
    here = next(m for m in found.limits if m[:2] == found.finer[:2])
    remarks = (
        [] if found.checks else ["Not checked with quadratic tetrahedra: FEniCSx is not here."]
    )
    remarks.append(_corner_words(here, found.finer))
    return Page(
        figures={
            "map": draw_map(found.points, found.limits, _SHOWN_RATIO, slenderness=4.0),
            "rotation": draw_rotation(found.points, _SHOWN_RATIO),
            "modes": draw_modes(found.modes, _SHOWN_RATIO),
        },
        tables={
            "bending": bending_table(found.points, found.limits),
            "modes": mode_table(found.modes, found.ends),
            "quadratic": check_table(found.checks),
            "points": point_table(found.points),
        },
        remarks=remarks,
    )


def bars_of(points: Sequence[BendingPoint]) -> dict[tuple[float, float], list[BendingPoint]]:
    """Points by (slenderness, Poisson's ratio)."""
    groups = groupby(points, key=lambda p: (p.slenderness, p.poissons_ratio))
    return {place: list(bar) for place, bar in groups}


def _loads(bar: Sequence[BendingPoint]) -> list[float]:
    return [p.nominal for p in bar]


def _corner_words(here: BendingLimit, finer: BendingLimit) -> str:
    """How the limit of one bar moves with the mesh."""
    if here.load is None or finer.load is None:
        return f"The limit of the bar with L/h = {here.slenderness:g} was not reached."
    return (
        f"How much the limits depend on the mesh: L/h = {here.slenderness:g}, Poisson's ratio "
        f"{here.poissons_ratio:g} is lost at P L^2/(E I) = {here.load:.2f} with "
        f"{here.cells_across} bricks across, at {finer.load:.2f} with {finer.cells_across}."
    )


def _columns(what: str, form: str) -> dict[str, str]:
    return {f"{what} {percent}": form for percent in _PERCENT}


def bending_table(points: Sequence[BendingPoint], limits: Sequence[BendingLimit]) -> Table:
    """The borders, to look up."""
    ends = {(m.slenderness, m.poissons_ratio): m for m in limits}
    rows: list[tuple[Any, ...]] = []
    for place, bar in bars_of(points).items():
        loads, turns = _loads(bar), [math.degrees(p.tip_rotation) for p in bar]
        errors, volumes = [p.displacement_error for p in bar], [p.volume_error for p in bar]
        borders = ((errors, loads), (errors, turns), (volumes, loads))
        found = [border(*pair, limit) for pair in borders for limit in LIMITS]
        rows.append((*place, *found, ends[place].deflection, ends[place].load))
    return Table(
        "Bending: tip deflection over L by linear strain at which its error reaches a limit",
        {"L/h": "g", "nu": "g", **_columns("displacement", ".4f"),
         **_columns("tip rotation [deg] at displacement", ".1f"), **_columns("volume", ".3f"),
         "StVK lost": ".2f", "StVK lost: P L^2/(E I)": ".2f"},
        rows,
    )  # fmt: skip


def mode_table(points: Sequence[ModePoint], ends: ModeLimits) -> Table:
    """Borders of the block's modes."""
    rows: list[tuple[Any, ...]] = []
    for (mode, nu), end in ends.items():
        chosen = [p for p in points if p.mode is mode and p.poissons_ratio == nu]
        loads = [p.nominal for p in chosen]
        errors = ([p.displacement_error for p in chosen], [p.volume_error for p in chosen])
        found = [border(some, loads, limit) for some in errors for limit in LIMITS]
        rows.append((str(mode), nu, *found, None if end is None else end[0]))
    return Table(
        "Block: strain, shear or twist [rad] by linear strain at which its error reaches a limit",
        {"mode": "", "nu": "g", **_columns("displacement", ".4f"), **_columns("volume", ".4f"),
         "StVK lost (2 bricks across)": ".4f"},
        rows,
    )  # fmt: skip


def check_table(checks: Sequence[DegreeCheck]) -> Table:
    """P1 beside P2."""
    columns = {"L/h": "g", "nu": "g", "deflection": ".3f"}
    columns |= {f"{what} P{k} [%]": ".3f" for what in ("displacement", "volume") for k in (1, 2)}
    return Table(
        "Linear tetrahedra (fastsim) beside quadratic ones (reference)",
        {**columns, "load P1 / P2": ".3f"},
        [
            (p.slenderness, p.poissons_ratio, p.nominal, 100 * p.displacement_error,
             100 * c.displacement_error, 100 * p.volume_error, 100 * c.volume_error, c.load_ratio)
            for c in checks
            for p in (c.by_linear,)
        ],
    )  # fmt: skip


def point_table(points: Sequence[BendingPoint]) -> Table:
    """Every point of the bending map."""
    columns = {"L/h": "g", "nu": "g", "deflection": ".4f", "P L^2/(E I), on this mesh": ".4f"}
    columns |= {"tip rotation [deg]": ".3f", "displacement error [%]": ".3f"}
    return Table(
        "Every point of the bending map",
        {**columns, "volume, linear [%]": "+.4f", "volume, Green [%]": "+.4f"},
        [
            (p.slenderness, p.poissons_ratio, p.nominal, p.load, math.degrees(p.tip_rotation),
             100 * p.displacement_error, 100 * p.linear_volume_change, 100 * p.green_volume_change)
            for p in points
        ],
    )  # fmt: skip


def draw_map(
    points: Sequence[BendingPoint],
    limits: Sequence[BendingLimit],
    poissons_ratio: float,
    *,
    slenderness: float,
) -> Figure:
    """Two cuts through the map: over slenderness, and over Poisson's ratio."""
    bars, percent = bars_of(points), "1, 5, 10 %"
    panels = []
    for axis, other, value, words in (
        (0, 1, poissons_ratio, f"slenderness L/h (Poisson's ratio {poissons_ratio:g})"),
        (1, 0, slenderness, f"Poisson's ratio (L/h = {slenderness:g})"),
    ):
        chosen = {place[axis]: bar for place, bar in bars.items() if place[other] == value}
        lines, notes = [], []
        for name, label, style, colour, end in (
            ("displacement_error", f"displacement {percent}", "-o", BLUE, 0),
            ("volume_error", f"volume {percent} of the rest volume", "--o", RED, -1),
        ):
            for limit in LIMITS:
                borders = {
                    x: border([getattr(p, name) for p in bar], _loads(bar), limit)
                    for x, bar in chosen.items()
                }
                reached = [(x, y) for x, y in borders.items() if y is not None]
                notes += [(*at, f"{100 * limit:g} %") for at in reached[end:][:1]]
                lines.append(_through(reached, style=style, colour=colour, label=label))
                label = ""
        ends = [
            ((m.slenderness, m.poissons_ratio)[axis], m.deflection)
            for m in limits
            if m[other] == value and m.deflection
        ]
        label = "equilibrium ends (StVK)"
        lines.append(_through(ends, style="-s", width=2.2, colour=GREY, label=label))
        panels.append(
            Panel(
                lines,
                notes=notes,
                log="y" if axis else "xy",
                ticks={x: f"{x:g}" for x in chosen},
                x=words,
                y="load: tip deflection by linear strain over L",
            )
        )
    return line_figure(
        [panels],
        "A bar bent by a load at its tip. Below a line the error of linear strain against "
        "Green strain is smaller than its label. Above the squares fastsim finds no "
        "equilibrium on this mesh; on finer ones the corner of the clamp gives way earlier.",
        shares_legend=True,
    )


def _through(places: Sequence[tuple[float, float]], **look: Any) -> Line:
    return Line([x for x, _ in places], [y for _, y in places], **look)


def draw_rotation(points: Sequence[BendingPoint], poissons_ratio: float) -> Figure:
    """Error over rotation of the tip, and over strain: only the first falls together."""
    chosen = [p for p in points if p.poissons_ratio == poissons_ratio]
    lengths = sorted({p.slenderness for p in chosen})
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(lengths)))
    by_rotation, by_strain = [], []
    for colour, length in zip(map(mpl.colors.to_hex, colours), lengths, strict=True):
        bar = [p for p in chosen if p.slenderness == length]
        errors = [100.0 * p.displacement_error for p in bar]
        turns = [math.degrees(p.tip_rotation) for p in bar]
        by_rotation.append(Line(turns, errors, colour=colour, label=f"L/h = {length:g}"))
        by_strain.append(Line([100 * p.bending_strain for p in bar], errors, colour=colour))
    y, levels = "displacement error of linear strain [%]", [100.0 * limit for limit in LIMITS]
    panels = [
        Panel(lines, x=x, y=y, log="xy", levels=levels)
        for lines, x in (
            (by_rotation, "rotation of the tip [degrees]"),
            (by_strain, "largest bending strain, beam theory [%]"),
        )
    ]
    return line_figure(
        [panels],
        f"The same bars (Poisson's ratio {poissons_ratio:g}). Over the rotation the slender "
        "ones fall on one curve; over the strain they do not: rotation is what linear strain "
        "gets wrong.",
        shares_legend=True,
    )


def draw_modes(points: Sequence[ModePoint], poissons_ratio: float) -> Figure:
    """Error of each mode over what linear strain predicts; lines in closed form where known."""
    displacement: list[Line] = []
    volume: list[Line] = []
    for mode, colour in zip(Mode, COLOURS, strict=False):
        chosen = [p for p in points if p.mode is mode and p.poissons_ratio == poissons_ratio]
        x = [p.nominal for p in chosen]
        exact = [p.closed_form for p in chosen if p.closed_form is not None]
        for lines, found, known in (
            (displacement, [p.displacement_error for p in chosen], [e for e, _, _ in exact]),
            (volume, [p.volume_error for p in chosen], [abs(a - b) for _, a, b in exact]),
        ):
            style, percent = "o" if known else "-o", np.multiply(100.0, found)
            lines.append(Line(x, percent, label=mode, style=style, colour=colour))
            if known:
                lines.append(Line(x, np.multiply(100.0, known), style="-", colour=colour))
    panels = [
        Panel(
            lines,
            x="strain, shear or twist [rad] by linear strain",
            y=f"error of linear strain, {what}",
            log="xy",
            levels=[100.0 * limit for limit in LIMITS],
            x_range=(0.002, None),
            y_range=(0.03, None),
        )
        for lines, what in ((displacement, "displacement [%]"), (volume, "volume [% of rest]"))
    ]
    return line_figure(
        [panels],
        f"A block, Poisson's ratio {poissons_ratio:g}. Marks: fastsim; lines through them "
        "without their own points: closed form. Between plates the displacement is largely "
        "prescribed, so shear shows in volume and force rather than in displacement.",
        shares_legend=True,
    )
