"""Figure of the study of sensitivity: what each number owes to what."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.validation.report.plots import figure_svg
from palpate.validation.report.study_page import StudyFigure
from palpate.validation.studies.input_sensitivity import Budget
from palpate.validation.studies.study_folder import paper_style

_INPUT, _MESH, _SUM, _MODEL = "#2f6f8f", "#c98a12", "#3a3a3a", "#b5332e"


def draw_uncertainty(budgets: Sequence[Budget]) -> StudyFigure:
    """Every part as a mark, a panel for each number, on one logarithmic scale."""
    from matplotlib import pyplot

    with paper_style():
        figure, axes = pyplot.subplots(
            1, len(budgets), figsize=(10.4, 3.8), sharey=True, sharex=True, squeeze=False
        )
        for panel, budget in zip(axes[0], budgets, strict=True):
            parts = _parts(budget)
            for place, (_, value, colour) in enumerate(reversed(parts)):
                # On a logarithmic scale a length means nothing: marks, not bars.
                panel.axhline(place, color="#e4e4e4", lw=0.7, zorder=0)
                panel.plot(100.0 * value, place, "o", color=colour, ms=7)
                text = f"{100 * value:.2g} %"
                panel.text(135.0 * value, place, text, va="center", fontsize=8.5)
            panel.set_yticks(range(len(parts)), [name for name, _, _ in reversed(parts)])
            panel.set_xscale("log")
            panel.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
            panel.set_title(budget.quantity, fontsize=10)
            panel.set_xlabel("% of the value")
            for side in ("top", "right"):
                panel.spines[side].set_visible(False)
        largest = max(value for b in budgets for _, value, _ in _parts(b))
        axes[0][0].set_xlim(0.3, 600.0 * largest)
        figure.tight_layout()
        return StudyFigure(
            figure_svg(figure),
            "The kidney case. Blue: standard uncertainty from inputs known to +-10 %. Ochre: "
            "numerical, as u_num on the finest mesh and as the error of the case's own mesh. "
            "Dark: u_val, both together. Red: linear instead of Green strain, for comparison; "
            "no part of u_val.",
        )


def _parts(budget: Budget) -> list[tuple[str, float, str]]:
    parts = [(f"{name}, +-10 %", value, _INPUT) for name, value in budget.input_parts.items()]
    parts.append(("u_input", budget.input_uncertainty, _INPUT))
    if budget.finest_uncertainty is not None:
        parts.append(("u_num, finest mesh", budget.finest_uncertainty, _MESH))
    parts.append(("error, case's mesh", abs(budget.mesh_error), _MESH))
    if budget.validation_uncertainty is not None:
        parts.append(("u_val", budget.validation_uncertainty, _SUM))
    parts.append(("linear strain", abs(budget.model_error), _MODEL))
    return parts
