"""Where may linear strain stand in for Green strain, and where does Green strain itself end?

Linear strain (eq. 3-4) is cheap and wrong under rotation; Saint-Venant-Kirchhoff with Green strain
(eq. 6-7) is right under rotation and gives way in compression. The map says how far each reaches:
a bar bent at its tip, over load, Poisson's ratio and slenderness. Displacement errors are L2 norms
over that of Green strain. Volume errors are parts of the rest volume, since a bent bar hardly
changes its own.

Loads are measured by what linear strain itself predicts, so that whoever has a linear solver can
look up whether to believe it: the deflection of the tip over the length. For a slender bar it is
P L^2 / (3 E I), and it is hardly touched by the stiffness that linear tetrahedra add in bending.

"No equilibrium" is what fastsim finds on its mesh. At a clamp a finer mesh gives way earlier: these
limits are from above, and have no error bar. A dash in a table: not reached.

Without rotation both are closed forms: under a nominal stress of P the stretch l is 1 + P / E by
linear strain, and P / E = l (l^2 - 1) / 2 by Green strain, which ends at P = -0.192 E. So linear
strain is 1, 5 and 10 % off at a strain of about 0.7, 3.5 and 7 %.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np

from palpate.fastsim.errors import EquilibriumLostError
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.report.plots import BLUE, GREY, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress

TITLE = "Linear or Green strain: where each may be believed"

# Errors of linear strain that the map is about.
LIMITS = (0.01, 0.05, 0.10)
# Where the map is computed: L / h, Poisson's ratio, delta = w_linear / L.
SLENDERNESSES = (1.0, 2.0, 4.0, 8.0, 16.0)
POISSONS_RATIOS = (0.0, 0.15, 0.3, 0.4, 0.45)
DEFLECTIONS = (*(0.01 * 2.0 ** (k / 2.0) for k in range(13)), 1.28, 2.56)
# Bricks over the height; as long as high, a third as many over the width.
CELLS_ACROSS = 6
# L / h and Poisson's ratio of the bar that is looked at again on a finer mesh; the figures are cuts
# through the map there.
AGAIN = (4.0, 0.3)
FINER_ACROSS = CELLS_ACROSS + 2


class Point(NamedTuple):
    """Linear beside Green strain under one load, P L^2 / (E I) [-].

    `nominal` is the deflection over the length that linear strain predicts; `displacement_error`
    the L2 norm of the difference over that of Green strain; changes of volume are over the rest
    volume [-]; `rotation` is that of the loaded end by Green strain [rad], and `bending_strain` by
    beam theory that at the surface at the clamp, M h / (2 E I) [-].
    """

    nominal: float
    load: float
    displacement_error: float
    linear_volume_change: float
    green_volume_change: float
    rotation: float
    bending_strain: float

    @property
    def volume_error(self) -> float:
        """Difference of volume over the rest volume: in bending the change itself is near 0."""
        return abs(self.linear_volume_change - self.green_volume_change)


class Series(NamedTuple):
    """A bar, whose `slenderness` is L / h [-], under rising loads."""

    slenderness: float
    poissons_ratio: float
    points: tuple[Point, ...]

    def values(self, name: str) -> list[float]:
        """One number of all points."""
        return [getattr(point, name) for point in self.points]

    def border(
        self, limit: float, error: str = "displacement_error", measure: str = "nominal"
    ) -> float | None:
        """The `measure` where an `error` of the points reaches a limit [-]; None where it does not.

        Logarithms are interpolated between two points: small errors are powers of the load.
        """
        errors, measures = self.values(error), self.values(measure)
        for k in range(1, len(errors)):
            if 0.0 < errors[k - 1] <= limit < errors[k]:
                part = math.log(limit / errors[k - 1]) / math.log(errors[k] / errors[k - 1])
                a, b = measures[k - 1 : k + 1]
                return float(a * (b / a) ** part)
        return None


class End(NamedTuple):
    """The last equilibrium of Saint-Venant-Kirchhoff: what linear strain predicts, and the load."""

    nominal: float
    load: float


class Found(NamedTuple):
    """The map: every bar, where each ends (None: not up to the load tried).

    `finer` is the end of the bar that is looked at again, on a finer mesh.
    """

    bars: Sequence[Series]
    ends: Sequence[End | None]
    finer: End | None


def make_bar(slenderness: float, poissons_ratio: float, load: float, cells_across: int) -> Problem:
    """A bar of E = 1 Pa, clamped at x = 0, its tip pushed down by P L^2 / (E I) [-].

    It is `slenderness` m long, 1 m high and wide, with so many bricks over the height and a third
    as many over the width.
    """
    L, n = slenderness, cells_across
    mesh = brick_box((max(2, round(n * L)), max(2, n // 3), n), (L, 1.0, 1.0))
    # I = 1/12, and the end has an area of 1.
    push = Traction(side(mesh, 0, L), (0.0, 0.0, -load / (12.0 * L * L)))
    material = Material(1.0, poissons_ratio)
    return Problem(mesh, material, (support_of(side(mesh, 0, 0.0)),), (push,))


def deflection(mesh: TetMesh, displacement: Points) -> float:
    """How far the tip sinks, over the length [-]."""
    L = float(mesh.points[:, 0].max())
    return -float(displacement[mesh.points[:, 0] > L * (1 - 1e-9), 2].mean()) / L


def _end_rotation(mesh: TetMesh, displacement: Points) -> float:
    """Angle of the normal of the end section, downwards [rad]."""
    corners = (mesh.points + displacement)[side(mesh, 0, mesh.points[:, 0].max())]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    return math.atan2(-normal[2], normal[0])


def follow(
    slenderness: float,
    poissons_ratio: float,
    nominals: Iterable[float],
    *,
    cells_across: int = CELLS_ACROSS,
) -> Series:
    """Linear and Green strain under rising loads, as far as Green strain bears them.

    The loads are given by the deflection over the length that linear strain predicts.
    """
    linear, compliance = _unit_response(slenderness, poissons_ratio, cells_across)
    points, green = [], None
    for nominal in nominals:
        load = nominal / compliance
        loaded = make_bar(slenderness, poissons_ratio, load, cells_across)
        try:
            green = solve_static(loaded, start=green).displacement
        except EquilibriumLostError:
            break
        mesh, bent = loaded.mesh, load * linear
        error = l2_norm(mesh, bent - green) / l2_norm(mesh, green)
        by_linear, by_green = (
            signed_volumes(mesh.points + u, mesh.cells).sum() / mesh.volume - 1.0
            for u in (bent, green)
        )
        rotation, strain = _end_rotation(mesh, green), load / (2.0 * slenderness)
        points.append(Point(nominal, load, error, by_linear, by_green, rotation, strain))
    return Series(slenderness, poissons_ratio, tuple(points))


def _unit_response(L: float, nu: float, cells_across: int) -> tuple[Points, float]:
    """Displacement by linear strain under a load of 1 [m], and the deflection in it [-]."""
    unit = make_bar(L, nu, 1.0, cells_across)
    linear = solve_static(unit, strain=Strain.LINEAR).displacement
    return linear, deflection(unit.mesh, linear)


def find_end(slenderness: float, poissons_ratio: float, cells_across: int) -> End | None:
    """Raise the load until fastsim says that equilibrium is lost; None where it is not."""
    _, compliance = _unit_response(slenderness, poissons_ratio, cells_across)
    # The limit grows with a power of L between 1 and 2; this is about twice of it (measured).
    most = 1.5 * slenderness + 0.5 * slenderness**2
    try:
        solve_static(make_bar(slenderness, poissons_ratio, most, cells_across))
    except EquilibriumLostError as error:
        load = most * error.load_factor
        return End(load * compliance, load)
    return None


def compute(progress: Progress) -> Found:
    """Compute the map."""
    bars, ends = [], []
    for L, nu in product(SLENDERNESSES, POISSONS_RATIOS):
        progress(f"bending: L/h = {L:g}, Poisson's ratio {nu:g}")
        bars.append(follow(L, nu, DEFLECTIONS))
        ends.append(find_end(L, nu, CELLS_ACROSS))
    return Found(bars, ends, find_end(*AGAIN, FINER_ACROSS))


def judge(found: Found) -> list[Finding]:
    """What breaks linear strain in bending, and where Green strain ends."""
    slender = [bar for bar in found.bars if bar.slenderness >= 4.0]
    turns, strains = (
        [bar.border(0.05, measure=measure) or math.inf for bar in slender]
        for measure in ("rotation", "bending_strain")
    )
    spread, strain_spread = max(turns) / min(turns), max(strains) / min(strains)
    beyond = [
        (end.nominal if end else math.inf) / (bar.border(LIMITS[-1]) or math.inf)
        for bar, end in zip(found.bars, found.ends, strict=True)
    ]
    return [
        judged(
            "rotation is what breaks linear strain: from L/h = 4 on the 5 % border is at one "
            "rotation of the tip for all slendernesses and Poisson's ratios, within 10 %",
            f"{math.degrees(min(turns)):.2f} to {math.degrees(max(turns)):.2f} degrees "
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


def present(found: Found) -> Page:
    """Tables to look up, and figures."""
    pairs = zip(found.bars, found.ends, strict=True)
    here = next(end for bar, end in pairs if (bar.slenderness, bar.poissons_ratio) == AGAIN)
    remark = f"The limit of the bar with L/h = {AGAIN[0]:g} was not reached."
    if here is not None and found.finer is not None:
        remark = (
            f"How much the limits depend on the mesh: L/h = {AGAIN[0]:g}, Poisson's ratio "
            f"{AGAIN[1]:g} is lost at P L^2/(E I) = {here.load:.2f} with {CELLS_ACROSS} bricks "
            f"across, at {found.finer.load:.2f} with {FINER_ACROSS}."
        )
    return Page(
        figures={"map": _draw_map(found), "rotation": _draw_rotation(found.bars)},
        tables={"bending": _bending_table(found), "points": _point_table(found.bars)},
        remarks=[remark],
    )


def _columns(what: str, form: str) -> dict[str, str]:
    return {f"{what} {100 * limit:g} %": form for limit in LIMITS}


def _bending_table(found: Found) -> Table:
    """The borders, to look up."""
    rows = []
    for bar, end in zip(found.bars, found.ends, strict=True):
        turns = [bar.border(limit, measure="rotation") for limit in LIMITS]
        row = [bar.slenderness, bar.poissons_ratio, *(bar.border(limit) for limit in LIMITS)]
        row += [None if turn is None else math.degrees(turn) for turn in turns]
        row += [bar.border(limit, "volume_error") for limit in LIMITS]
        rows.append([*row, *(end or (None, None))])
    return Table(
        "Bending: tip deflection over L by linear strain at which its error reaches a limit",
        {"L/h": "g", "nu": "g", **_columns("displacement", ".4f"),
         **_columns("tip rotation [deg] at displacement", ".1f"), **_columns("volume", ".3f"),
         "StVK lost": ".2f", "StVK lost: P L^2/(E I)": ".2f"},
        rows,
    )  # fmt: skip


def _point_table(bars: Sequence[Series]) -> Table:
    """Every point of the bending map."""
    columns = {"L/h": "g", "nu": "g", "deflection": ".4f", "P L^2/(E I), on this mesh": ".4f"}
    columns |= {"tip rotation [deg]": ".3f", "displacement error [%]": ".3f"}
    return Table(
        "Every point of the bending map",
        {**columns, "volume, linear [%]": "+.4f", "volume, Green [%]": "+.4f"},
        [
            (bar.slenderness, bar.poissons_ratio, p.nominal, p.load, math.degrees(p.rotation),
             100 * p.displacement_error, 100 * p.linear_volume_change, 100 * p.green_volume_change)
            for bar in bars
            for p in bar.points
        ],
    )  # fmt: skip


def _draw_map(found: Found) -> Figure:
    """Two cuts through the map: over slenderness, and over Poisson's ratio."""
    slenderness, nu = AGAIN
    panels = []
    for axis, other, value, words in (
        ("slenderness", "poissons_ratio", nu, f"slenderness L/h (Poisson's ratio {nu:g})"),
        ("poissons_ratio", "slenderness", slenderness, f"Poisson's ratio (L/h = {slenderness:g})"),
    ):
        pairs = zip(found.bars, found.ends, strict=True)
        chosen = {getattr(b, axis): (b, end) for b, end in pairs if getattr(b, other) == value}
        lines, notes = [], []
        for error, label, style, colour, where in (
            ("displacement_error", "displacement 1, 5, 10 %", "-o", BLUE, 0),
            ("volume_error", "volume 1, 5, 10 % of the rest volume", "--o", RED, -1),
        ):
            for limit in LIMITS:
                borders = [(x, bar.border(limit, error)) for x, (bar, _) in chosen.items()]
                reached = [(x, y) for x, y in borders if y is not None]
                notes += [(*at, f"{100 * limit:g} %") for at in reached[where:][:1]]
                lines.append(_through(reached, style=style, colour=colour, label=label))
                label = ""
        ends = [(x, end.nominal) for x, (_, end) in chosen.items() if end is not None]
        label = "equilibrium ends (StVK)"
        lines.append(_through(ends, style="-s", width=2.2, colour=GREY, label=label))
        panels.append(
            Panel(
                lines,
                notes=notes,
                log="xy" if axis == "slenderness" else "y",
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


def _through(points: Sequence[tuple[float, float]], **style: Any) -> Line:
    return Line([x for x, _ in points], [y for _, y in points], **style)


def _draw_rotation(bars: Sequence[Series]) -> Figure:
    """Error over rotation of the tip, and over strain: only the first falls together."""
    chosen = [bar for bar in bars if bar.poissons_ratio == AGAIN[1]]
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(chosen)))
    panels = []
    for measure, factor, x in (
        ("rotation", 180.0 / math.pi, "rotation of the tip [degrees]"),
        ("bending_strain", 100.0, "largest bending strain, beam theory [%]"),
    ):
        lines = [
            Line(
                np.multiply(factor, bar.values(measure)),
                np.multiply(100.0, bar.values("displacement_error")),
                colour=mpl.colors.to_hex(colour),
                label=f"L/h = {bar.slenderness:g}",
            )
            for colour, bar in zip(colours, chosen, strict=True)
        ]
        y = "displacement error of linear strain [%]"
        panels.append(Panel(lines, x=x, y=y, log="xy", levels=[100.0 * v for v in LIMITS]))
    return line_figure(
        [panels],
        f"The same bars (Poisson's ratio {AGAIN[1]:g}). Over the rotation the slender ones fall on "
        "one curve; over the strain they do not: rotation is what linear strain gets wrong.",
        shares_legend=True,
    )
