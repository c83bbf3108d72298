"""Tables and figures of the study of contact."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from palpate.meshes.problem import Strain
from palpate.validation.report.line_plot import BLUE, GREY, RED, Line, Panel, line_figure
from palpate.validation.report.study_page import Figure, Page, Table
from palpate.validation.studies.contact.bodies import Collision, Fold
from palpate.validation.studies.contact.scenes import Pair
from palpate.validation.studies.contact.speed import Speed
from palpate.validation.studies.contact.sphere import DEPTH, DEPTHS, Level, Penalty, hertz

HERTZ_LIMIT = 0.03


class Outcome(NamedTuple):
    """All that was found; `last_depth` [radii] with the smallest det F there, and why it ended."""

    levels: list[Level]
    pairs: list[Pair]
    last_depth: tuple[float, float, str]
    penalties: list[Penalty]
    speeds: tuple[Speed, Speed]
    collision: Collision
    fold: Fold


def present(found: Outcome) -> Page:
    """Every table, and the two figures about Hertz."""
    depth, det, why = found.last_depth
    return Page(
        figures={"force_depth": draw_forces(found), "convergence": draw_convergence(found)},
        tables=make_tables(found),
        numbers={
            "last_depth": {"radii": depth, "smallest_det_f": det, "reason": why},
            "collision": found.collision._asdict(),
        },
    )


def make_tables(found: Outcome) -> dict[str, Table]:
    """By name of their file."""
    levels = Table(
        f"Force over Hertz' at d = {DEPTH:g} R",
        {"edges in the contact radius": ".2f", "cells": "d", "linear / Hertz": ".4f",
         "Green / Hertz": ".4f", "Green / linear": ".4f"},
        [(*level, level.green / level.linear) for level in found.levels],
    )  # fmt: skip
    same_mesh = Table(
        "fastsim and the reference on the same mesh",
        {"scene": "", "strain": "", "cells": "d", "last force [N]": ".5g", "force error": ".1e",
         "displacement error": ".1e", "volume change error": ".1e"},
        [
            (*p[:3], float(np.linalg.norm(p.forces[-1])), p.force_error, p.displacement_error,
             p.volume_error)
            for p in found.pairs
        ],
    )  # fmt: skip
    penalty = Table(
        "Penalties, at d = 0.05 R",
        {"k [layers of cells]": "g", "k [Pa/m]": ".3g", "force lacking [-]": ".3e",
         "penetration [um]": ".2f"},
        [(*p[:3], 1e6 * p.penetration) for p in found.penalties],
    )  # fmt: skip
    kinds = ("no tool", "constraint", "penalty", "self-collision")
    speed = Table(
        "Steps with a capsule that slides over the kidney",
        {"kidney, one core, single precision": "", "cells": "d", "step [us]": ".1f",
         "added": "+.1%", "times real time": ".2f"},
        [
            (kind, s.cells, 1e6 * seconds, added, factor)
            for s in found.speeds
            for kind, seconds, added, factor in zip(
                kinds, s.seconds, (None, *s.shares), s.real_time_factors, strict=True
            )
        ],
    )  # fmt: skip
    bar = found.fold
    folded = Table(
        "A folded bar on itself",
        {"penalty [Pa/m]": ".3g", "deepest vertex [edges]": ".3f"},
        [("none", bar.free), *zip(bar.stiffnesses, bar.depths, strict=True)],
    )
    return {
        "hertz": levels,
        "force_depth": curve_table(found),
        "same_mesh": same_mesh,
        "penalty": penalty,
        "speed": speed,
        "folded_bar": folded,
    }


def curve_table(found: Outcome) -> Table:
    """Force against depth of the sphere."""
    rows: list[list[Any]] = []
    for k, depth in enumerate(DEPTHS):
        row: list[Any] = [depth, 1e3 * hertz(depth)]
        for forces in (_forces(found, strain) for strain in Strain):
            known = forces[k] if k < len(forces) else None
            row += [known, (known and depth and known / row[1]) or None]
        rows.append(row)
    columns = {"d / R": "g", "Hertz [mN]": ".4f"}
    for strain in Strain:
        columns |= {f"{strain} [mN]": ".4f", f"{strain} over Hertz": ".4f"}
    return Table("Sphere into a block: force against depth", columns, rows)


def _forces(found: Outcome, strain: Strain) -> list[float]:
    """Whole forces of the indentation along z, as far as there are [mN]."""
    pair = next(p for p in found.pairs if p.scene == "sphere into block" and p.strain is strain)
    return [1e3 * force[2] for force in pair.forces]


def draw_forces(found: Outcome) -> Figure:
    """Force against depth."""
    depths = np.linspace(0.0, DEPTHS[-1], 100).tolist()
    exact = [1e3 * hertz(depth) for depth in depths]
    lines = [Line(x=depths, y=exact, style="--", colour=GREY, label="Hertz")]
    for strain, colour in zip(Strain, (BLUE, RED), strict=True):
        forces = _forces(found, strain)
        label = f"{strain} strain (reference: the same)"
        lines.append(Line(x=DEPTHS[: len(forces)], y=forces, colour=colour, label=label))
    panel = Panel(lines=lines, x="depth / radius", y="force [mN]")
    caption = "A sphere of 10 mm pressed into a block of 5 kPa."
    return line_figure([[panel]], caption, shares_legend=False)


def draw_convergence(found: Outcome) -> Figure:
    """Distance from Hertz by mesh, and what penalties lack."""
    edges = [level.edges_per_radius for level in found.levels]
    away = [100 * abs(level.linear - 1.0) for level in found.levels]
    lacking = [100 * p.lack for p in found.penalties]
    panels = [
        Panel(
            lines=[Line(x=edges, y=away)],
            x="edges in the contact radius",
            y="linear strain from Hertz [%]",
            log="xy",
            levels=(100 * HERTZ_LIMIT,),
            ticks={edge: f"{edge:.3g}" for edge in edges},
        ),
        Panel(
            lines=[Line(x=[p.stiffness for p in found.penalties], y=lacking)],
            x="penalty stiffness [Pa/m]",
            y="force lacking [%]",
            log="xy",
        ),
    ]
    caption = "Left: all edges shrink together (dotted: the limit). Right: penalties, first order."
    return line_figure([panels], caption, shares_legend=False)
