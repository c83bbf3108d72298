"""Section IV: tools that touch tissue. Is the contact right, and what does it cost?

A rigid sphere on a block has a closed form where the strain is small and linear (Hertz): the
linear simulator must come to it as the mesh is refined, and Green strain must depart from it by the
same amount on every mesh. Beyond that, the same discrete problem is given to the reference: force,
displacement and change of volume must be the same on the same mesh.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.reference.availability import is_available
from palpate.validation.report.plots import BLUE, GREY, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.contact.motions import (
    PART,
    Collision,
    Fold,
    Speed,
    collide,
    fold,
    measure_speeds,
)
from palpate.validation.studies.contact.scenes import Pair, all_scenes, compare, last_depth
from palpate.validation.studies.contact.sphere import (
    DEPTH,
    DEPTHS,
    LEVELS,
    Level,
    Penalty,
    hertz,
    hertz_level,
    penalty_rates,
    vary_penalty,
)
from palpate.validation.studies.study import Study

HERTZ_LIMIT = 0.03
SAME_MESH_LIMIT = 1e-6
ADDED_LIMIT = 0.2


class Outcome(NamedTuple):
    """All that was found; `last_depth` [radii] with the smallest det F there, and why it ended."""

    levels: list[Level]
    pairs: list[Pair]
    last_depth: tuple[float, float, str]
    penalties: list[Penalty]
    speeds: tuple[Speed, Speed]
    collision: Collision
    folded: Fold


def compute(progress: Progress) -> Outcome:
    """Solve, compare, time."""
    if not is_available():
        raise InputError("study contact needs FEniCSx to compare with; see the set-up in README")
    speeds = measure_speeds(progress)
    levels = [hertz_level(n, growth, progress) for n, growth in LEVELS]
    pairs = [compare(scene, strain, progress) for scene in all_scenes() for strain in Strain]
    progress("the last depth with an equilibrium, penalties")
    last, penalties = last_depth(0.35), vary_penalty()
    progress("two cubes that collide, a folded bar")
    return Outcome(levels, pairs, last, penalties, speeds, collide(), fold())


def judge(found: Outcome) -> list[Finding]:
    """What was claimed, and whether it holds."""
    away = [abs(level.linear - 1.0) for level in found.levels]
    ratios = [level.green / level.linear for level in found.levels]
    depth, det, why = found.last_depth
    rates = penalty_rates(found.penalties)
    first, second = found.speeds
    hit, bar = found.collision, found.folded
    findings = [
        judged(
            f"linear strain is within {HERTZ_LIMIT:.0%} of Hertz at d = {DEPTH:g} R, and nearer "
            "on every finer mesh",
            ", ".join(f"{level.linear - 1.0:+.2%}" for level in found.levels),
            away[-1] <= HERTZ_LIMIT and all(np.diff(away) < 0.0),
        ),
        judged(
            "Green strain departs from linear by the same on every mesh, within 0.2 %: it is the "
            "material's departure",
            ", ".join(f"{ratio - 1.0:+.2%}" for ratio in ratios),
            max(ratios) - min(ratios) <= 0.002 and max(ratios) < 0.99,
        ),
    ]
    for pair in found.pairs:
        errors = pair.force_error, pair.displacement_error, pair.volume_error
        findings.append(
            judged(
                f"{pair.scene}, {pair.strain} strain: force, displacement and change of volume "
                f"are the reference's on the same mesh, within {SAME_MESH_LIMIT:g}",
                ", ".join(f"{error:.1e}" for error in errors) + f"; up to {pair.reached}",
                all(error <= SAME_MESH_LIMIT for error in errors),
            )
        )
    return [
        *findings,
        judged(
            f"the sphere goes to {DEPTHS[-1]:g} R, and where Saint-Venant-Kirchhoff has no "
            "equilibrium any more is stated",
            f"{depth:.3f} R (smallest det F {det:.2f}): {why}",
            depth > DEPTHS[-1],
        ),
        judged(
            "penalties lack a force in proportion to 1/k, within 0.1 in the exponent",
            "exponents " + ", ".join(f"{rate:.3f}" for rate in rates),
            all(abs(rate - 1.0) <= 0.1 for rate in rates[1:]),
        ),
        judged(
            "two cubes that collide keep momentum and its moment to 1e-12, energy to 0.5 %",
            f"{hit.momentum_error:.1e}, {hit.moment_error:.1e}, {hit.energy_error:.2%}; speeds "
            f"{hit.speeds[0]:.2f} and {hit.speeds[1]:.2f} of the first after it",
            max(hit.momentum_error, hit.moment_error) <= 1e-12 and hit.energy_error <= 0.005,
        ),
        judged(
            "a folded bar rests on itself, less deep the stiffer the penalty, at last within a "
            "tenth of an edge",
            f"{bar.free:.2f} edges deep without contact, with it "
            + ", ".join(f"{depth:.3f}" for depth in bar.depths),
            bar.free > 1.0 and all(np.diff(bar.depths) < 0.0) and bar.depths[-1] <= 0.1,
        ),
        judged(
            f"a capsule adds at most {ADDED_LIMIT:.0%} to a step of {first.cells} cells",
            ", ".join(f"{share:+.1%}" for share in first.shares[:2])
            + f" (constraint, penalty); self-collision {first.shares[2]:+.1%}",
            max(first.shares[:2]) <= ADDED_LIMIT,
        ),
        judged(
            f"with a moving capsule {PART:.0%} of the cells that would run in real time still do, "
            "on one core",
            f"{second.cells} cells at {min(second.real_time_factors[1:3]):.2f} times real time "
            f"({first.real_time_cells} without a tool)",
            min(second.real_time_factors[1:3]) >= 1.0
            and second.cells >= 0.95 * PART * first.real_time_cells,
        ),
    ]


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
    bar = found.folded
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
    lines = [Line(depths, exact, style="--", colour=GREY, label="Hertz")]
    for strain, colour in zip(Strain, (BLUE, RED), strict=True):
        forces = _forces(found, strain)
        label = f"{strain} strain (reference: the same)"
        lines.append(Line(DEPTHS[: len(forces)], forces, colour=colour, label=label))
    panel = Panel(lines, x="depth / radius", y="force [mN]")
    caption = "A sphere of 10 mm pressed into a block of 5 kPa."
    return line_figure([[panel]], caption, shares_legend=False)


def draw_convergence(found: Outcome) -> Figure:
    """Distance from Hertz by mesh, and what penalties lack."""
    edges = [level.edges_per_radius for level in found.levels]
    away = [100 * abs(level.linear - 1.0) for level in found.levels]
    lacking = [100 * p.lack for p in found.penalties]
    panels = [
        Panel(
            [Line(edges, away)],
            x="edges in the contact radius",
            y="linear strain from Hertz [%]",
            log="xy",
            levels=(100 * HERTZ_LIMIT,),
            ticks={edge: f"{edge:.3g}" for edge in edges},
        ),
        Panel(
            [Line([p.stiffness for p in found.penalties], lacking)],
            x="penalty stiffness [Pa/m]",
            y="force lacking [%]",
            log="xy",
        ),
    ]
    caption = "Left: all edges shrink together (dotted: the limit). Right: penalties, first order."
    return line_figure([panels], caption, shares_legend=False)


STUDY = Study("Contact with tools (section IV)", __doc__, compute, judge, present)
