"""Where may linear strain stand in for Green strain, and where does Green strain itself end?

Linear strain (eq. 3-4) is cheap and wrong under rotation; Saint-Venant-Kirchhoff with Green strain
(eq. 6-7) is right under rotation and gives way in compression. The map says how far each reaches:
a bar bent at its tip, over load, Poisson's ratio and slenderness; and a block stretched, crushed,
sheared and twisted. Displacement errors are L2 norms over that of Green strain. Volume errors are
parts of the rest volume, since a bent bar hardly changes its own.

Loads are measured by what linear strain itself predicts, so that whoever has a linear solver can
look up whether to believe it: the deflection of the tip over the length, the nominal strain, the
angle of twist. For a slender bar the deflection is P L^2 / (3 E I), and it is hardly touched by the
stiffness that linear tetrahedra add in bending.

"No equilibrium" is what fastsim finds on its mesh. In free compression it is the closed form.
At a clamp, and where a free side wrinkles, a finer mesh gives way earlier: these limits are from
above, and have no error bar. A dash in a table: not reached, up to 2 (in compression 1/4).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import StrEnum
from itertools import product
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np

from palpate.fastsim.body import lame_parameters
from palpate.fastsim.errors import EquilibriumLostError
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, rollers, side, support_of
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
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
from palpate.validation.studies.study import volume_change

TITLE = "Linear or Green strain: where each may be believed"

# Errors of linear strain that the map is about.
LIMITS = (0.01, 0.05, 0.10)
# Where the map is computed: L / h, Poisson's ratio, delta = w_linear / L.
SLENDERNESSES = (1.0, 2.0, 4.0, 8.0, 16.0)
POISSONS_RATIOS = (0.0, 0.15, 0.3, 0.4, 0.45)
DEFLECTIONS = (*(0.01 * 2.0 ** (k / 2.0) for k in range(13)), 1.28, 2.56)
# Bricks over the height; as long as high, a third as many over the width.
CELLS_ACROSS = 6
# Of the block.
MODE_RATIOS = (0.0, 0.3, 0.45)
# L / h and Poisson's ratio of the bar that is looked at again on a finer mesh; the figures are cuts
# through the map there.
AGAIN = (4.0, 0.3)
FINER_ACROSS = CELLS_ACROSS + 2


class Mode(StrEnum):
    """How the bar, or the block, is loaded."""

    BENDING = "bending"
    STRETCH = "stretch"
    COMPRESSION = "compression"
    CONFINED_COMPRESSION = "confined compression"
    SHEAR = "shear between plates"
    TWIST = "twist"


OF_THE_BLOCK = tuple(Mode)[1:]
# Up to where the block is followed, in what linear strain predicts: strain, shear angle or twist;
# and up to where a loss of equilibrium is looked for.
LARGEST = dict(zip(OF_THE_BLOCK, (0.6, 0.19, 0.19, 1.0, 1.0), strict=True))
MOST = dict(zip(OF_THE_BLOCK, (2.0, 0.25, 0.25, 2.0, 2.0), strict=True))
_POINTS = 13


class Point(NamedTuple):
    """Linear beside Green strain under one load.

    `nominal` is what linear strain predicts; `displacement_error` the L2 norm of the difference
    over that of Green strain; changes of volume are over the rest volume [-]; `rotation` is that of
    the loaded end by Green strain [rad], and `bending_strain` by beam theory that at the surface at
    the clamp, M h / (2 E I) [-], both of the bent bar.
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
    """One body under rising loads.

    The load is P L^2 / (E I) of the bar, whose `slenderness` is L / h [-]; of the block the nominal
    strain, the shear angle, or the largest tangential traction [-].
    """

    mode: Mode
    slenderness: float
    poissons_ratio: float
    points: tuple[Point, ...]

    def values(self, name: str) -> list[float]:
        """One number of all points."""
        return [getattr(point, name) for point in self.points]

    def border(
        self, limit: float, error: str = "displacement_error", measure: str = "nominal"
    ) -> float | None:
        """Where an error reaches a limit, between two points; None where it does not.

        The logarithms are interpolated: small errors are powers of the load.

        Args:
            limit: [-], > 0.
            error: Which number of a `Point`.
            measure: The number that is asked for there.
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
    """The map: every series, where each ends (None: not up to the load tried).

    `finer` is the end of the bar that is looked at again, on a finer mesh.
    """

    bars: Sequence[Series]
    bar_ends: Sequence[End | None]
    blocks: Sequence[Series]
    block_ends: Sequence[End | None]
    finer: End | None


def make_body(
    mode: Mode, slenderness: float, poissons_ratio: float, load: float, cells_across: int
) -> Problem:
    """A bar or block of E = 1 Pa under a load.

    The bar is 1 m high and wide, clamped at x = 0, its tip pushed down; the block a cube of 1 m, or
    for twist a bar twice as high, loaded at its top.

    Args:
        mode: How it is loaded.
        slenderness: Length of the bar [m].
        poissons_ratio: [-].
        load: See `Series`.
        cells_across: Bricks over the height of the bar, a third as many over its width where it is
            as long as high; along an edge of the block.
    """
    material, n = Material(1.0, poissons_ratio), cells_across
    if mode is Mode.BENDING:
        L = slenderness
        mesh = brick_box((max(2, round(n * L)), max(2, n // 3), n), (L, 1.0, 1.0))
        # I = 1/12, and the end has an area of 1.
        push = Traction(side(mesh, 0, L), (0.0, 0.0, -load / (12.0 * L * L)))
        return Problem(mesh, material, (support_of(side(mesh, 0, 0.0)),), (push,))
    height = 2.0 if mode is Mode.TWIST else 1.0
    mesh = brick_box((n, n, round(n * height)), (1.0, 1.0, height))
    top = side(mesh, 2, height)
    clamp = support_of(side(mesh, 2, 0.0))
    if mode is Mode.SHEAR:
        return Problem(mesh, material, (clamp, support_of(top, displacement=(load, 0.0, 0.0))), ())
    if mode is Mode.TWIST:
        # Dead tractions around the axis of the bar, each facet its own.
        centres = mesh.points[top].mean(axis=1)
        tractions = tuple(
            Traction(top[k : k + 1], (-load * (y - 0.5), load * (x - 0.5), 0.0))
            for k, (x, y, _) in enumerate(centres)
        )
        return Problem(mesh, material, (clamp,), tractions)
    sides = [(axis, 0.0) for axis in range(3)]
    stiffness = 1.0
    if mode is Mode.CONFINED_COMPRESSION:
        sides += [(0, 1.0), (1, 1.0)]
        lmbda, mu = lame_parameters(material)
        stiffness = lmbda + 2.0 * mu
    stress = stiffness * (load if mode is Mode.STRETCH else -load)
    return Problem(mesh, material, rollers(mesh, sides), (Traction(top, (0.0, 0.0, stress)),))


def predicted(mode: Mode, mesh: TetMesh, displacement: Points) -> float:
    """What a displacement says under a load of 1: deflection over length, or twist [rad].

    The nominal strain and the shear angle are their own loads.
    """
    if mode is Mode.BENDING:
        L = float(mesh.points[:, 0].max())
        end = mesh.points[:, 0] > L * (1 - 1e-9)
        return -float(displacement[end, 2].mean()) / L
    if mode is Mode.TWIST:  # by least squares, for small rotations
        top = mesh.points[:, 2] > mesh.points[:, 2].max() - 1e-9
        x, y = (mesh.points[top, :2] - 0.5).T
        u, v = displacement[top, :2].T
        return float(np.sum(x * v - y * u) / np.sum(x * x + y * y))
    return 1.0


def _end_rotation(mesh: TetMesh, displacement: Points) -> float:
    """Angle of the normal of the end section, downwards [rad]."""
    corners = (mesh.points + displacement)[side(mesh, 0, mesh.points[:, 0].max())]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    return math.atan2(-normal[2], normal[0])


def follow(
    mode: Mode,
    poissons_ratio: float,
    nominals: Iterable[float],
    *,
    slenderness: float = 1.0,
    cells_across: int = CELLS_ACROSS,
) -> Series:
    """Linear and Green strain under rising loads, as far as Green strain bears them.

    Args:
        mode: How the body is loaded.
        poissons_ratio: [-].
        nominals: The loads, in what linear strain predicts.
        slenderness: See `make_body`.
        cells_across: See `make_body`.
    """

    def make(load: float) -> Problem:
        return make_body(mode, slenderness, poissons_ratio, load, cells_across)

    unit = make(1.0)
    linear = solve_static(unit, strain=Strain.LINEAR).displacement
    compliance = predicted(mode, unit.mesh, linear)
    points, green = [], None
    for nominal in nominals:
        load = nominal / compliance
        loaded = make(load)
        try:
            green = solve_static(loaded, start=green).displacement
        except EquilibriumLostError:
            break
        mesh, bent = loaded.mesh, load * linear
        error = l2_norm(mesh, bent - green) / l2_norm(mesh, green)
        is_bent = mode is Mode.BENDING
        points.append(
            Point(
                nominal,
                load,
                error,
                volume_change(mesh, bent),
                volume_change(mesh, green),
                _end_rotation(mesh, green) if is_bent else 0.0,
                load / (2.0 * slenderness) if is_bent else 0.0,
            )
        )
    return Series(mode, slenderness, poissons_ratio, tuple(points))


def follow_block(mode: Mode, poissons_ratio: float) -> Series:
    """One mode of the block up to `LARGEST`; where the state is homogeneous two bricks will do."""
    nominals = np.geomspace(0.01 * LARGEST[mode], LARGEST[mode], _POINTS).tolist()
    cells_across = 4 if mode in (Mode.SHEAR, Mode.TWIST) else 2
    return follow(mode, poissons_ratio, nominals, cells_across=cells_across)


def find_end(
    mode: Mode, poissons_ratio: float, *, slenderness: float = 1.0, cells_across: int = 2
) -> End | None:
    """Raise the load until fastsim says that equilibrium is lost; None where it is not.

    The block's mesh is too coarse to buckle before the material gives way.
    """

    def make(load: float) -> Problem:
        return make_body(mode, slenderness, poissons_ratio, load, cells_across)

    unit = make(1.0)
    linear = solve_static(unit, strain=Strain.LINEAR).displacement
    compliance = predicted(mode, unit.mesh, linear)
    # A bar's limit grows with a power of L between 1 and 2; this is about twice of it (measured).
    of_bar = 1.5 * slenderness + 0.5 * slenderness**2
    most = of_bar if mode is Mode.BENDING else MOST[mode] / compliance
    try:
        solve_static(make(most))
    except EquilibriumLostError as error:
        load = most * error.load_factor
        return End(load * compliance, load)
    return None


def compute(progress: Progress) -> Found:
    """Compute the map."""
    bars, ends = [], []
    for L, nu in product(SLENDERNESSES, POISSONS_RATIOS):
        progress(f"bending: L/h = {L:g}, Poisson's ratio {nu:g}")
        bars.append(follow(Mode.BENDING, nu, DEFLECTIONS, slenderness=L))
        ends.append(find_end(Mode.BENDING, nu, slenderness=L, cells_across=CELLS_ACROSS))
    progress("block")
    block = list(product(OF_THE_BLOCK, MODE_RATIOS))
    L, nu = AGAIN
    finer = find_end(Mode.BENDING, nu, slenderness=L, cells_across=FINER_ACROSS)
    return Found(
        bars,
        ends,
        [follow_block(mode, nu) for mode, nu in block],
        [find_end(mode, nu) for mode, nu in block],
        finer,
    )


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
        for bar, end in zip(found.bars, found.bar_ends, strict=True)
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
    pairs = zip(found.bars, found.bar_ends, strict=True)
    here = next(end for bar, end in pairs if (bar.slenderness, bar.poissons_ratio) == AGAIN)
    remark = f"The limit of the bar with L/h = {AGAIN[0]:g} was not reached."
    if here is not None and found.finer is not None:
        remark = (
            f"How much the limits depend on the mesh: L/h = {AGAIN[0]:g}, Poisson's ratio "
            f"{AGAIN[1]:g} is lost at P L^2/(E I) = {here.load:.2f} with {CELLS_ACROSS} bricks "
            f"across, at {found.finer.load:.2f} with {FINER_ACROSS}."
        )
    return Page(
        figures={
            "map": _draw_map(found),
            "rotation": _draw_rotation(found.bars),
            "modes": _draw_modes(found.blocks),
        },
        tables={
            "bending": _bending_table(found),
            "modes": _mode_table(found),
            "points": _point_table(found.bars),
        },
        remarks=[remark],
    )


def _columns(what: str, form: str) -> dict[str, str]:
    return {f"{what} {100 * limit:g} %": form for limit in LIMITS}


def _bending_table(found: Found) -> Table:
    """The borders, to look up."""
    rows = []
    for bar, end in zip(found.bars, found.bar_ends, strict=True):
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


def _mode_table(found: Found) -> Table:
    """Borders of the block's modes."""
    rows = [
        (
            str(block.mode),
            block.poissons_ratio,
            *(block.border(limit) for limit in LIMITS),
            *(block.border(limit, "volume_error") for limit in LIMITS),
            None if end is None else end.nominal,
        )
        for block, end in zip(found.blocks, found.block_ends, strict=True)
    ]
    return Table(
        "Block: strain, shear or twist [rad] by linear strain at which its error reaches a limit",
        {"mode": "", "nu": "g", **_columns("displacement", ".4f"), **_columns("volume", ".4f"),
         "StVK lost (2 bricks across)": ".4f"},
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
        pairs = zip(found.bars, found.bar_ends, strict=True)
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


def _draw_modes(blocks: Sequence[Series]) -> Figure:
    """Error of each mode over what linear strain predicts."""
    chosen = [block for block in blocks if block.poissons_ratio == AGAIN[1]]
    panels = [
        Panel(
            [
                Line(
                    block.values("nominal"),
                    np.multiply(100.0, block.values(error)),
                    label=block.mode,
                    colour=colour,
                )
                for block, colour in zip(chosen, COLOURS, strict=False)
            ],
            x="strain, shear or twist [rad] by linear strain",
            y=f"error of linear strain, {what}",
            log="xy",
            levels=[100.0 * limit for limit in LIMITS],
            x_range=(0.002, None),
            y_range=(0.03, None),
        )
        for error, what in (
            ("displacement_error", "displacement [%]"),
            ("volume_error", "volume [% of rest]"),
        )
    ]
    return line_figure(
        [panels],
        f"A block, Poisson's ratio {AGAIN[1]:g}. Between plates the displacement is largely "
        "prescribed, so shear shows in volume and force rather than in displacement.",
        shares_legend=True,
    )
