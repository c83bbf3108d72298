"""Where may linear strain stand in for Green strain, and where does Green strain itself end?

Linear strain (eq. 3-4) is cheap and wrong under rotation; Saint-Venant-Kirchhoff with Green strain
(eq. 6-7) is right under rotation and gives way in compression. The map says how far each reaches:
a bar bent at its tip, over load, Poisson's ratio and slenderness; and a block stretched, crushed,
sheared and twisted. Displacement errors are L2 norms over that of Green strain. Volume errors are
parts of the rest volume, since a bent bar hardly changes its own.

Loads are measured by what linear strain itself predicts, so that whoever has a linear solver can
look up whether to believe it: the deflection of the tip over the length, the nominal strain, the
angle of twist. For a slender bar the deflection is P L^2 / (3 E I).

"No equilibrium" is what fastsim finds on its mesh. In free compression it is the closed form.
At a clamp, and where a free side wrinkles, a finer mesh gives way earlier: these limits are from
above, and have no error bar. A dash in a table: not reached, up to 2 (in compression 1/4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby, product
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np

from palpate.reference.availability import is_available
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
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.closed_forms import COMPRESSION_LIMIT, elastica_error
from palpate.validation.studies.study import Study
from palpate.validation.studies.validity_loads import (
    CELLS_ACROSS,
    DEFLECTIONS,
    HOMOGENEOUS,
    LIMITS,
    MOST,
    POISSONS_RATIOS,
    SLENDERNESSES,
    BendingLimit,
    BendingPoint,
    DegreeCheck,
    Mode,
    ModePoint,
    border,
    check_by_quadratic,
    find_limit,
    find_mode_limit,
    follow_bar,
    follow_mode,
)

# The validity map as tables to look up where linear strain may be believed, and as figures.

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


MODE_RATIOS = (0.0, 0.3, 0.45)
# Points solved again with quadratic tetrahedra, (L/h, nu, nearest deflection), and bricks across.
CHECKED = ((1.0, 0.45, 0.16), (4.0, 0.3, 0.16), (4.0, 0.45, 0.08), (8.0, 0.3, 0.08))
QUADRATIC_ACROSS = 4
# fastsim's tolerance is 1e-10 of the forces; homogeneous states multiply it by a few.
HOMOGENEOUS_TOLERANCE = 1e-8
BORDER_TOLERANCE = 0.05
# A bar as short as it is high is mostly corner of the clamp, which linear tetrahedra blur.
STUBBY = 2.0
STUBBY_TOLERANCE = 0.15


def compute(progress: Progress) -> Found:
    """Compute the map."""
    points: list[BendingPoint] = []
    limits: list[BendingLimit] = []
    for place in product(SLENDERNESSES, POISSONS_RATIOS):
        progress("bending: L/h = {:g}, Poisson's ratio {:g}".format(*place))
        points += follow_bar(*place, CELLS_ACROSS, DEFLECTIONS)
        limits.append(find_limit(*place, CELLS_ACROSS))
    checks = []
    for slenderness, nu, deflection in CHECKED if is_available() else ():
        bar = bars_of(points)[slenderness, nu]
        point = min(bar, key=lambda p: abs(p.nominal - deflection))
        checks.append(check_by_quadratic(point, QUADRATIC_ACROSS, progress))
    return Found(
        points,
        limits,
        finer=find_limit(4.0, 0.3, CELLS_ACROSS + 2),
        modes=[p for m in Mode for nu in MODE_RATIOS for p in follow_mode(m, nu)],
        ends={(m, nu): find_mode_limit(m, nu) for m in Mode for nu in MODE_RATIOS},
        checks=checks,
    )


def judge(found: Found) -> list[Finding]:
    """The block, the bars, and the bars again with quadratic tetrahedra."""
    return [
        *judge_modes(found.modes, found.ends),
        *judge_bending(found.points, found.limits),
        *judge_checks(found.checks),
    ]


def judge_modes(points: Sequence[ModePoint], ends: ModeLimits) -> list[Finding]:
    """Homogeneous states against closed forms; the end of free compression."""
    homogeneous = [p for p in points if p.mode in HOMOGENEOUS]
    worst = max(p.distance for p in homogeneous)
    free = [end for (mode, _), end in ends.items() if mode is Mode.COMPRESSION]
    loads = [end[0] if end else math.inf for end in free]
    distance = max(abs(load - COMPRESSION_LIMIT) for load in loads)
    return [
        judged(
            "homogeneous states: errors and volumes of fastsim equal the closed forms to "
            f"{HOMOGENEOUS_TOLERANCE:g}",
            f"{len(homogeneous)} states, at most {worst:.1e} off",
            worst <= HOMOGENEOUS_TOLERANCE,
        ),
        judged(
            "free compression: equilibrium ends at P/E = 1/(3 sqrt 3) = "
            f"{COMPRESSION_LIMIT:.5f} for every Poisson's ratio, within one load step",
            "lost beyond "
            + ", ".join(f"{x:.5f}" for x in loads)
            + "; stretch "
            + ", ".join(f"{end[1]:.4f}" if end else "-" for end in free)
            + " (1/sqrt 3 = 0.5774)",
            # The load is raised in steps down to 1/8192 of the most.
            distance <= 1.5 * MOST[Mode.COMPRESSION] / 8192.0,
        ),
    ]


def judge_bending(points: Sequence[BendingPoint], limits: Sequence[BendingLimit]) -> list[Finding]:
    """What breaks linear strain in bending, and where Green strain ends."""
    bars = bars_of(points)
    longest = max(length for length, _ in bars)
    slender = [p for p in points if p.slenderness == longest]
    # Beyond, the shooting for the elastica has more than one root.
    thin = [p for p in slender if p.nominal <= 1.0]
    exact = {d: elastica_error(3.0 * d) for d in {p.nominal for p in thin}}
    ratios = [p.displacement_error / exact[p.nominal] for p in thin]
    # The mean of theta^2 along the bar: 2 alpha^2 / 15 with alpha = 3 delta.
    volumes = [p.linear_volume_change / (1.2 * p.nominal**2) for p in slender if p.nominal >= 0.05]
    rotations, strains, beyond = [], [], []
    ends = {(m.slenderness, m.poissons_ratio): m.deflection or math.inf for m in limits}
    for place, bar in bars.items():
        errors = [p.displacement_error for p in bar]
        tenth = border(errors, [p.nominal for p in bar], LIMITS[-1])
        beyond.append(ends[place] / (math.inf if tenth is None else tenth))
        if place[0] >= 4.0:
            rotation = border(errors, [p.tip_rotation for p in bar], 0.05)
            strain = border(errors, [p.bending_strain for p in bar], 0.05)
            rotations.append(math.inf if rotation is None else rotation)
            strains.append(math.inf if strain is None else strain)
    spread, strain_spread = max(rotations) / min(rotations), max(strains) / min(strains)
    return [
        judged(
            f"slender bars (L/h = {longest:g}): the displacement error is the elastica's, within "
            f"{BORDER_TOLERANCE:.0%}",
            f"{min(ratios):.3f} to {max(ratios):.3f} of it over {len(ratios)} points",
            max(abs(r - 1.0) for r in ratios) <= BORDER_TOLERANCE,
        ),
        judged(
            "slender bars: linear strain invents the volume of its rotations, 2/15 (P L^2/(E I))^2"
            f" of the body, within {BORDER_TOLERANCE:.0%}",
            f"{min(volumes):.3f} to {max(volumes):.3f} of it",
            max(abs(v - 1.0) for v in volumes) <= BORDER_TOLERANCE,
        ),
        judged(
            "rotation is what breaks linear strain: from L/h = 4 on the 5 % border is at one "
            "rotation of the tip for all slendernesses and Poisson's ratios, within 10 %",
            f"{math.degrees(min(rotations)):.2f} to {math.degrees(max(rotations)):.2f} degrees "
            f"(ratio {spread:.3f}), while the bending strain there varies by {strain_spread:.1f}",
            spread <= 1.10 < strain_spread,
        ),
        judged(
            "Green strain ends beyond the 10 % border of linear strain in every bar: where "
            "equilibrium is lost, linear strain has long been wrong",
            f"at {min(beyond):.1f} to {max(beyond):.0f} times its load",
            min(beyond) > 1.0,
        ),
    ]


def judge_checks(checks: Sequence[DegreeCheck]) -> list[Finding]:
    """Linear against quadratic tetrahedra."""
    if not checks:
        return []
    displacement = max(abs(c.displacement_ratio - 1.0) for c in checks)
    volumes: dict[bool, float] = {True: 0.0, False: 0.0}
    for c in checks:
        is_stubby = c.by_linear.slenderness < STUBBY
        volumes[is_stubby] = max(volumes[is_stubby], abs(c.volume_ratio - 1.0))
    stiffness = max(c.load_ratio for c in checks)
    return [
        judged(
            "the map is no artefact of linear tetrahedra: quadratic ones find the same errors at "
            f"the same deflection, within {BORDER_TOLERANCE:.0%} (volume of stubby bars, L/h below "
            f"{STUBBY:g}: {STUBBY_TOLERANCE:.0%})",
            f"{len(checks)} points: displacement within {displacement:.1%}, volume within "
            f"{volumes[False]:.1%}, of stubby bars {volumes[True]:.1%}, though the linear ones "
            f"need up to {stiffness:.2f} times the load",
            max(displacement, volumes[False]) <= BORDER_TOLERANCE
            and volumes[True] <= STUBBY_TOLERANCE,
        )
    ]


TITLE = "Linear or Green strain: where each may be believed"
STUDY = Study(TITLE, __doc__, compute, judge, present)
