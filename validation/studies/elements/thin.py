"""Few cells through the thickness: what both elements miss in bending, beside the rule for it.

`palpate check` says before solving what a body as thin for its mesh will miss; here the rule is
held against bars of 1 to 8 cells through the thickness, one to four times as long as high.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from palpate.fastsim.statics import solve_static
from palpate.meshes.problem import Element
from palpate.validation.references.field_truth import FieldTruth
from palpate.validation.report.estimates import expected_error
from palpate.validation.report.plots import BLUE, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.elements.bar import make_bar

THROUGH = (1, 2, 3, 4, 8)
SLENDERNESS = (1, 2, 4)
# A rule to choose a mesh by. Of linear tetrahedra it is to be right but for a fifth; of smoothed
# ones, which are soon good, it may say three times too much, and half as much again too little,
# where one of both is above what anybody asks for.
LINEAR_WITHIN = 0.2
SMOOTHED_BELOW, SMOOTHED_ABOVE = 1.0 / 3.0, 1.5
NOBODY_ASKS = 0.01
_COLOURS = {Element.LINEAR: RED, Element.SMOOTHED: BLUE}


class Thin(NamedTuple):
    """A bar on one mesh: relative L2 errors of both elements, and what the rule says."""

    poissons_ratio: float
    num_cells: int
    slenderness: int
    linear: float
    smoothed: float
    linear_rule: float
    smoothed_rule: float


def follow_thin(
    truths: Mapping[float, FieldTruth],
    progress: Progress,
    *,
    through: Sequence[int] = THROUGH,
    slenderness: Sequence[int] = SLENDERNESS,
) -> list[Thin]:
    """Both elements on every mesh that whole cells make."""
    found = []
    for nu, truth in truths.items():
        progress(f"cells through the thickness, nu = {nu:g}")
        for a in slenderness:
            for n in (n for n in through if 4 * n % a == 0):
                problem = make_bar(n, nu, slenderness=a)
                linear, smoothed = (
                    truth.error_of(
                        problem.mesh, solve_static(problem, element=element).displacement
                    )
                    for element in Element
                )
                rules = [expected_error(n, a, nu, element) for element in Element]
                found.append(Thin(nu, n, a, linear, smoothed, rules[0], rules[1]))
    return found


def judge_thin(bars: Sequence[Thin]) -> list[Finding]:
    """The rule of `palpate check`, at each Poisson's ratio."""
    findings = []
    for nu in dict.fromkeys(bar.poissons_ratio for bar in bars):
        of = [bar for bar in bars if bar.poissons_ratio == nu]
        ratios = [bar.linear / bar.linear_rule for bar in of]
        findings.append(
            judged(
                f"nu = {nu:g}: the rule says what linear tetrahedra miss in bending, but for "
                f"{100 * LINEAR_WITHIN:g} % of it, with {_words(of)}",
                f"{min(ratios):.2f} to {max(ratios):.2f} times the rule",
                all(abs(ratio - 1.0) <= LINEAR_WITHIN for ratio in ratios),
            )
        )
        asked = [bar for bar in of if max(bar.smoothed, bar.smoothed_rule) >= NOBODY_ASKS]
        ratios = [bar.smoothed / bar.smoothed_rule for bar in asked]
        findings.append(
            judged(
                f"nu = {nu:g}: smoothed tetrahedra miss at most {SMOOTHED_ABOVE:g} times what the "
                f"rule says and at least a third of it, from {100 * NOBODY_ASKS:g} % on",
                f"{min(ratios, default=0.0):.2f} to {max(ratios, default=0.0):.2f} times the rule",
                all(SMOOTHED_BELOW <= ratio <= SMOOTHED_ABOVE for ratio in ratios),
            )
        )
    return findings


def _words(bars: Sequence[Thin]) -> str:
    counts, lengths = ({getattr(b, key) for b in bars} for key in ("num_cells", "slenderness"))
    return (
        f"{min(counts)} to {max(counts)} cells through the thickness, {min(lengths)} to "
        f"{max(lengths)} times as long as high"
    )


def thin_table(bars: Sequence[Thin]) -> Table:
    """Every mesh."""
    columns = {"Poisson's ratio": "g", "cells through": "d", "length / height": "d"}
    columns |= {"linear": ".4f", "smoothed": ".4f", "linear, rule": ".4f", "smoothed, rule": ".4f"}
    return Table("Cells through the thickness: errors, and what the rule says", columns, bars)


def draw_thin(bars: Sequence[Thin]) -> Figure:
    """Cells as long as high; a panel for each Poisson's ratio."""
    panels = []
    for nu in dict.fromkeys(bar.poissons_ratio for bar in bars):
        of = [bar for bar in bars if (bar.poissons_ratio, bar.slenderness) == (nu, 1)]
        cells = [float(bar.num_cells) for bar in of]
        lines = []
        for element, colour in _COLOURS.items():
            errors, rules = (
                [getattr(bar, name) for bar in of] for name in (f"{element}", f"{element}_rule")
            )
            lines.append(Line(cells, errors, label=f"{element}", style="-o", colour=colour))
            lines.append(Line(cells, rules, label=f"{element}, rule", style="--", colour=colour))
        panels.append(
            Panel(
                lines,
                "cells through the thickness",
                "relative L2 error",
                title=f"Poisson's ratio {nu:g}",
                log="xy",
            )
        )
    return line_figure(
        [panels[k : k + 2] for k in range(0, len(panels), 2)],
        "What both elements miss where few cells, as long as high, lie through the thickness of a "
        "bent bar, and what `palpate check` says of it before solving.",
        shares_legend=True,
    )
