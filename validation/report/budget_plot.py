"""The error budget as a picture: bars of signed terms, one row a candidate."""

from __future__ import annotations

from palpate.validation.evidence.error_budget import DISCRETISATION, MODEL, TIME, Budget
from palpate.validation.evidence.remainder import SOLVER
from palpate.validation.report.plots import figure_svg


def budget_svg(budgets: list[Budget]) -> str:
    """Bars of the terms, signed, in per cent of the truth; a tick marks the total."""
    if not budgets:
        return ""
    from matplotlib import pyplot

    colours = {MODEL: "#b5332e", DISCRETISATION: "#2f6f8f", TIME: "#c98a12"}
    labelled: set[str] = set()
    figure, axes = pyplot.subplots(figsize=(8.4, 1.2 + 0.62 * len(budgets)))
    for place, budget in enumerate(reversed(budgets)):
        scale = (abs(budget.truth) or 1.0) / 100.0
        up = down = 0.0
        rest = "#2f8f4e" if budget.rest == SOLVER else "#6b3fa0"
        for name, colour in (colours | {budget.rest: rest, "interaction": "#999999"}).items():
            value = budget.interaction if name == "interaction" else budget.terms.get(name)
            width = (value or 0.0) / scale
            start = up if width >= 0.0 else down
            label = name.partition(":")[0]
            axes.barh(
                place, width, left=start, height=0.5, color=colour,
                label=None if label in labelled else label,
            )  # fmt: skip
            labelled.add(label)
            up, down = (up + width, down) if width >= 0.0 else (up, down + width)
        axes.plot([budget.total / scale] * 2, [place - 0.36, place + 0.36], color="black", lw=2)
    names = [f"{b.quantity}\n{b.candidate}" for b in reversed(budgets)]
    axes.set_yticks(range(len(budgets)), names, fontsize=8)
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_xlabel("error in per cent of the truth; black tick: total")
    axes.grid(axis="x", color="#dddddd", lw=0.6)
    axes.legend(frameon=False, fontsize=8, ncol=5, loc="lower center", bbox_to_anchor=(0.45, 1.0))
    figure.tight_layout()
    return figure_svg(figure)
