"""The report: one HTML file that opens offline anywhere, verdict first."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from palpate.meshes.problem import Strain
from palpate.meshes.quality import measure_quality
from palpate.validation.outputs import check_name
from palpate.validation.report.pictures import draw_pictures
from palpate.validation.report.plots import checks_svg
from palpate.validation.report.table_one import state_table, state_table_csv
from palpate.validation.results import CaseResult


def write_report(results: Sequence[CaseResult], folder: Path) -> Path:
    """Write report.html with its pictures and tables into a folder that exists.

    A picture that cannot be drawn is said so in its place; the verdict never depends on it.
    """
    environment = Environment(
        loader=PackageLoader("palpate.validation.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["check_name"] = check_name
    environment.filters["number"] = _number
    environment.filters["signed"] = lambda x: "" if x is None else f"{x:+.2f} %"
    page = environment.get_template("report.html.j2").render(
        cases=[_case_view(result, folder) for result in results],
        title=", ".join(result.title for result in results),
    )
    path = folder / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


def _case_view(result: CaseResult, folder: Path) -> dict[str, Any]:
    pictures = draw_pictures(result, folder)
    for name, path in list(pictures.items()):
        pictures[name] = path.rename(folder / f"{result.name}-{name}.png")
    (folder / f"{result.name}-states.csv").write_text(state_table_csv(result), encoding="utf-8")
    try:
        # The SVG is our own drawing; the text in it is a fixed list of metric names.
        plot = Markup(checks_svg(result))
    except Exception as error:  # a plot must never take the verdict with it
        plot = Markup("<p>The plot could not be drawn ({}).</p>").format(type(error).__name__)
    mesh = result.problem.mesh
    material = result.problem.material
    green = result.state(result.candidate, Strain.GREEN)
    return {
        "result": result,
        "table": state_table(result),
        "pictures": {name: _data_url(path) for name, path in pictures.items()},
        "plot": plot,
        "quality": measure_quality(mesh),
        "material": material,
        "green": green,
        "num_supports": len(result.problem.supports),
        "loads": [type(load).__name__ for load in result.problem.loads],
        "provenance": json.dumps(dict(result.provenance), indent=2, allow_nan=False),
    }


def _data_url(path: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def _number(value: float | None) -> str:
    """Six digits for sizes, three for small errors, a dash for nothing."""
    if value is None:
        return "–"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.4g}"
    if 1e4 <= abs(value) < 1e9:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.2e}"
