"""Figures for a paper: PDF or SVG, a column or two wide, text as text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib import pyplot

from palpate.validation.judging.error_budget import Budget
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.figure_form import FigureForm
from palpate.validation.report.motion_plot import motion_figure
from palpate.validation.report.pictures import draw_pictures
from palpate.validation.report.plots import COLUMN, budget_figure, checks_figure, plot_style


def write_figures(
    result: CaseResult, folder: Path, form: FigureForm, budgets: Sequence[Budget] = ()
) -> list[Path]:
    """Write every figure of a report as NAME-WHAT.pdf or .svg.

    Plots of checks, budgets and motions are 88 mm wide, a column; pictures of the body in several
    panels 180 mm, two. Bodies of more than 20 000 facets are pixels within the figure. Files are
    the same for the same results.

    Args:
        result: A judged case.
        folder: That exists.
        form: Of the files.
        budgets: Of the candidates' errors, where they are known.

    Returns:
        The files, without those for which the case has nothing to show.
    """
    made = []
    with plot_style(COLUMN):
        figures = {"checks": checks_figure(result, COLUMN), "motion": motion_figure(result, COLUMN)}
        quantities = dict.fromkeys(budget.quantity for budget in budgets)
        for number, quantity in enumerate(quantities, start=1):
            rows = [budget for budget in budgets if budget.quantity == quantity]
            figures[f"budget-{number}"] = budget_figure(rows, COLUMN)
        for name, figure in figures.items():
            if figure is not None:
                path = folder / f"{result.name}-{name}.{form}"
                date = "CreationDate" if form is FigureForm.PDF else "Date"
                figure.savefig(path, metadata={date: None})
                pyplot.close(figure)
                made.append(path)
    return made + list(draw_pictures(result, folder, str(form)).values())
