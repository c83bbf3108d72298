"""Tables of the validity map, to look up where linear strain may be believed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import groupby, pairwise

from palpate.validation.report.study_page import StudyTable
from palpate.validation.studies.validity_bending import (
    LIMITS,
    BendingLimit,
    BendingPoint,
    DegreeCheck,
    border,
)
from palpate.validation.studies.validity_modes import Mode, ModePoint

ModeLimits = dict[tuple[Mode, float], tuple[float, float] | None]


def bars_of(points: Sequence[BendingPoint]) -> dict[tuple[float, float], list[BendingPoint]]:
    """Points by (slenderness, Poisson's ratio)."""
    groups = groupby(points, key=lambda p: (p.slenderness, p.poissons_ratio))
    return {place: list(bar) for place, bar in groups}


def corner_words(limits: Sequence[BendingLimit], finer: BendingLimit) -> str:
    """How the limit of one bar moves with the mesh."""
    place = (finer.slenderness, finer.poissons_ratio)
    here = next(m for m in limits if (m.slenderness, m.poissons_ratio) == place)
    if here.load is None or finer.load is None:
        return "The limit of the bar with L/h = 4 was not reached."
    return (
        f"How much the limits depend on the mesh: L/h = {place[0]:g}, Poisson's ratio {place[1]:g} "
        f"is lost at P L^2/(E I) = {here.load:.2f} with {here.cells_across} bricks across, "
        f"at {finer.load:.2f} with {finer.cells_across}."
    )


def bending_table(points: Sequence[BendingPoint], limits: Sequence[BendingLimit]) -> StudyTable:
    """The borders, to look up."""
    ends = {(m.slenderness, m.poissons_ratio): m for m in limits}
    rows = []
    for (length, nu), bar in bars_of(points).items():
        end = ends[length, nu]
        deflections = [border(bar, lambda p: p.displacement_error, x) for x in LIMITS]
        rotations = [
            border(bar, lambda p: p.displacement_error, x, lambda p: math.degrees(p.tip_rotation))
            for x in LIMITS
        ]
        volumes = [border(bar, lambda p: p.volume_error, x) for x in LIMITS]
        rows.append(
            [
                f"{length:g}",
                f"{nu:g}",
                *(_text(x, ".4f") for x in deflections),
                *(_text(x, ".1f") for x in rotations),
                *(_text(x, ".3f") for x in volumes),
                _text(end.deflection, ".2f"),
                _text(end.load, ".2f"),
            ]
        )
    percent = [f"{100 * x:g} %" for x in LIMITS]
    return StudyTable(
        "Bending: tip deflection over L by linear strain at which its error reaches a limit",
        ["L/h", "nu", *(f"displacement {p}" for p in percent),
         *(f"tip rotation there, {p} [deg]" for p in percent),
         *(f"volume {p}" for p in percent), "StVK lost", "StVK lost: P L^2/(E I)"],
        rows,
    )  # fmt: skip


def mode_table(points: Sequence[ModePoint], ends: ModeLimits) -> StudyTable:
    """Borders of the block's modes."""
    rows = []
    for (mode, nu), end in ends.items():
        chosen = [p for p in points if p.mode is mode and p.poissons_ratio == nu]
        displacement = [mode_border(chosen, lambda p: p.displacement_error, x) for x in LIMITS]
        volume = [mode_border(chosen, lambda p: p.volume_error, x) for x in LIMITS]
        rows.append(
            [
                str(mode),
                f"{nu:g}",
                *(_text(x, ".4f") for x in (*displacement, *volume)),
                _text(None if end is None else end[0], ".4f"),
            ]
        )
    percent = [f"{100 * x:g} %" for x in LIMITS]
    return StudyTable(
        "Block: strain, shear or twist [rad] by linear strain at which its error reaches a limit",
        ["mode", "nu", *(f"displacement {p}" for p in percent), *(f"volume {p}" for p in percent),
         "StVK lost (2 bricks across)"],
        rows,
    )  # fmt: skip


def mode_border(
    points: Sequence[ModePoint], error: Callable[[ModePoint], float], limit: float
) -> float | None:
    """Where an error of a mode reaches a limit; None where it does not."""
    for a, b in pairwise(points):
        if 0.0 < error(a) <= limit < error(b):
            part = math.log(limit / error(a)) / math.log(error(b) / error(a))
            return float(a.nominal * (b.nominal / a.nominal) ** part)
    return None


def check_table(checks: Sequence[DegreeCheck]) -> StudyTable:
    """P1 beside P2."""
    rows = [
        [
            f"{c.linear_tetrahedra.slenderness:g}",
            f"{c.linear_tetrahedra.poissons_ratio:g}",
            f"{c.linear_tetrahedra.deflection:.3f}",
            f"{100 * c.linear_tetrahedra.displacement_error:.3f}",
            f"{100 * c.quadratic_displacement_error:.3f}",
            f"{100 * c.linear_tetrahedra.volume_error:.3f}",
            f"{100 * c.quadratic_volume_error:.3f}",
            f"{c.load_ratio:.3f}",
        ]
        for c in checks
    ]
    return StudyTable(
        "Linear tetrahedra (fastsim) beside quadratic ones (reference)",
        ["L/h", "nu", "deflection", "displacement P1 [%]", "P2 [%]", "volume P1 [%]", "P2 [%]",
         "load P1 / P2"],
        rows,
    )  # fmt: skip


def point_table(points: Sequence[BendingPoint]) -> StudyTable:
    """Every point of the bending map."""
    rows = [
        [
            f"{p.slenderness:g}",
            f"{p.poissons_ratio:g}",
            f"{p.deflection:.4f}",
            f"{p.load:.4f}",
            f"{math.degrees(p.tip_rotation):.3f}",
            f"{100 * p.displacement_error:.3f}",
            f"{100 * p.linear_volume_change:+.4f}",
            f"{100 * p.green_volume_change:+.4f}",
        ]
        for p in points
    ]
    return StudyTable(
        "Every point of the bending map",
        ["L/h", "nu", "deflection", "P L^2/(E I), on this mesh", "tip rotation [deg]",
         "displacement error [%]", "volume, linear [%]", "volume, Green [%]"],
        rows,
    )  # fmt: skip


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
