"""The truth of a tool reaches what is known in closed form: Hertz' sphere and a flat round punch.

Stored truths with tools come from the reference alone, on meshes refined where the force's error
comes from, with bars from how those meshes settle. Here the same machinery meets two answers that
it does not know, on blocks of three sizes that are led to the half space.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.meshes.errors import InputError
from palpate.reference.availability import is_available
from palpate.validation.report.plots import BLUE, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.half_space.blocks import (
    CONTACT_RADIUS,
    HalfSpace,
    closed_force,
    hertz_radius,
    solve_half_space,
)
from palpate.validation.studies.study import Study

# Wider bars would show nothing.
WIDEST, WIDEST_SETTLEMENT = 0.015, 0.3
# The sphere is rounder than Hertz' paraboloid, the punch a polygon.
SHAPES = 2e-4
# The nodes' areas tell the contact to a part of a cell.
RADIUS_LIMIT = 0.03


class Outcome(NamedTuple):
    """What both tools say of the half space."""

    punch: HalfSpace
    sphere: HalfSpace


def compute(progress: Progress) -> Outcome:
    """Solve all blocks, under linear strain."""
    if not is_available():
        raise InputError("study half-space needs FEniCSx; see the set-up in README")
    return Outcome(solve_half_space("punch", progress), solve_half_space("sphere", progress))


def judge(found: Outcome) -> list[Finding]:
    """What was claimed, and whether it holds."""
    findings = [
        judged(
            f"{name}: the force on the half space is that of the closed form within the bar, and "
            f"the bar within {WIDEST:.1%}",
            f"{each.ratio - 1.0:+.2%}; bar {each.bar:.2%} of the truths and {each.remainder:.2g} "
            "of what the extrapolation leaves",
            abs(each.ratio - 1.0) <= each.bar + each.remainder + SHAPES
            and each.bar + each.remainder <= WIDEST,
        )
        for name, each in (("flat punch, F = 2 E* a d", found.punch), (_HERTZ, found.sphere))
    ]
    k = [found.punch.settlement, found.sphere.settlement]
    within = found.punch.settlement_bar + found.sphere.settlement_bar
    off = [block.touching / hertz_radius(block.force) - 1.0 for block in found.sphere.blocks]
    return [
        *findings,
        judged(
            "a block of size W settles by the same k F / (E W) under either tool, within the bars",
            f"k = {k[0]:.4f} and {k[1]:.4f}, bars {within:.2g}",
            abs(k[0] - k[1]) <= within <= WIDEST_SETTLEMENT * abs(k[0]),
        ),
        judged(
            "the sphere's contact has Hertz' radius for its force, a = (3 F R / (4 E*))^(1/3), "
            f"within {RADIUS_LIMIT:.0%}",
            ", ".join(f"{value:+.2%}" for value in off),
            bool(np.max(np.abs(off)) <= RADIUS_LIMIT),
        ),
    ]


_HERTZ = "sphere, F = 4/3 E* R^(1/2) d^(3/2)"


def present(found: Outcome) -> Page:
    """The blocks, and the half space."""
    blocks = Table(
        "Force at the depth over the closed form's, by the block's size",
        {"tool": "", "size [contact radii]": "g", "force / closed form": ".5f", "bar": ".2%",
         "meshes": "d", "cells": "d", "unknowns": "d"},
        [
            (each.tool, b.size, b.force / closed_force(each.tool), b.bar, b.meshes, b.cells,
             b.unknowns)
            for each in found
            for b in each.blocks
        ],
    )  # fmt: skip
    limits = Table(
        "Led to the half space",
        {"tool": "", "force / closed form": ".5f", "bar": ".2%", "left by x^3": ".1e",
         "k": ".4f", "bar of k": ".4f"},
        [
            (h.tool, h.ratio, h.bar, h.remainder, h.settlement, h.settlement_bar) for h in found
        ],
    )  # fmt: skip
    numbers = {each.tool: {"ratio": each.ratio, "bar": each.bar} for each in found}
    return Page(
        figures={"sizes": draw(found)},
        tables={"blocks": blocks, "half_space": limits},
        numbers=numbers,
    )


def draw(found: Outcome) -> Figure:
    """Force over the closed form's against contact radius over size, with the half space at 0."""
    lines = [
        Line(
            [0.0, *(1.0 / block.size for block in each.blocks[::-1])],
            [each.ratio, *(b.force / closed_force(each.tool) for b in each.blocks[::-1])],
            colour=colour,
            label=each.tool,
        )
        for each, colour in zip(found, (BLUE, RED), strict=True)
    ]
    panel = Panel(lines, x="contact radius / size of the block", y="force / closed form")
    caption = f"Contact radius {1e3 * CONTACT_RADIUS:g} mm; at 0 what the sizes are led to."
    return line_figure([[panel]], caption, shares_legend=False)


STUDY = Study("Tools on the half space", __doc__, compute, judge, present)
