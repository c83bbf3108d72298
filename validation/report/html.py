"""The report: one HTML file for each case, which opens offline and begins with the verdict."""

from __future__ import annotations

import base64
import hashlib
import io
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib import image

from palpate.fastsim.errors import FastsimError
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.meshes.quality import measure_quality
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case.units import Units
from palpate.validation.exchange.case_folder import describe_conventions
from palpate.validation.judging.error_budget import (
    Budget,
    budget_rows,
    case_budgets,
    motion_budgets,
)
from palpate.validation.judging.outputs import citation
from palpate.validation.judging.provenance import stored_record
from palpate.validation.judging.results import MEASUREMENT, CaseResult, CheckResult, tone_of
from palpate.validation.metrics import CATALOGUE
from palpate.validation.quoting import for_html
from palpate.validation.references.reference_set import OF_ELEMENT
from palpate.validation.report import FigureForm
from palpate.validation.report.answer import (
    amount_of,
    check_in_words,
    key_in_words,
    metric_in_words,
)
from palpate.validation.report.case_plots import budget_svg, checks_svg, motion_svg, write_figures
from palpate.validation.report.comparisons import comparisons_of
from palpate.validation.report.drawing import draw
from palpate.validation.report.linear_strain import green_truth, percent_off
from palpate.validation.report.loads_and_tools import (
    inclusion_names,
    inclusions_of,
    tools_in_words,
)
from palpate.validation.report.measured_plots import measured_figure
from palpate.validation.report.pictures import draw_pictures, first_view
from palpate.validation.report.tables import provenance_rows, record_text, state_table, write_tables
from palpate.validation.report.trust import trust_of
from palpate.validation.report.truth_record import truth_record
from palpate.validation.report.viewer import viewer_json
from palpate.validation.states import Verdict, gravest

_PACKAGE = "palpate.validation.report"
# The state of a factor of V&V 40 that the case file has no evidence for.
_ABSENT = "not given"
# A key or a table of a case file that is commented out.
_UNUSED_KEY = re.compile(r"\s*#\s*(\[{1,2}\w[\w.]*\]{1,2}|[\w.]+\s*=)")


def page_environment() -> Environment:
    """Templates that escape every text and make its hidden characters visible."""
    return Environment(
        loader=PackageLoader(_PACKAGE),
        autoescape=True,
        finalize=for_html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def template_text(name: str) -> str:
    """The text of a file in the folder of templates, unchanged."""
    return (resources.files(_PACKAGE) / "templates" / name).read_text(encoding="utf-8")


def script_of(*names: str) -> tuple[Markup, Markup]:
    """Scripts joined into one, and the hash by which a page's policy admits it."""
    script = "\n".join(template_text(name) for name in names)
    return Markup(script), policy_hash(script)


def policy_hash(text: str) -> Markup:
    """The hash of a script or a style for a Content-Security-Policy."""
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")
    return Markup("sha256-{}").format(digest)


INDEX = "index.html"
# Most cells times steps of a motion; its budget takes about fifty times as long, some 10 s.
_CHEAP_MOTION = 2e7
# Limits from here on are stated in per cent [-].
_LEAST_PER_CENT = 1e-4
# Width of a picture in the index [pixels].
_SMALL = 480


def write_report(
    results: Sequence[CaseResult], folder: Path, *, figures: FigureForm | None = None
) -> Path:
    """Write the pages with their pictures and tables into a folder that exists.

    One case gives report.html; several give NAME.html each, and index.html that links them, with
    the reason of each that has no check because it could not be judged. A picture that cannot be
    drawn is replaced by a message; the verdict never depends on it. `figures` is the form in which
    each figure is also written for a paper. Returns the page to open first.
    """
    environment = report_environment()
    if len(results) == 1:
        return _write_case(environment, results[0], folder / "report.html", "", figures)
    judged = [result for result in results if result.checks]
    for result in judged:
        _write_case(environment, result, folder / f"{result.name}.html", INDEX, figures)
    path = folder / INDEX
    page = environment.get_template("index.html.j2").render(
        results=results, verdict=gravest([r.verdict for r in results]), closest=_closest,
        tone=tone_of(results), narrow=sum(r.tone == "narrow" for r in results),
        truths={r.name: trust_of(r).scale[:1] for r in judged},
        pictures={r.name: _small(folder / f"{r.name}-states.png") for r in judged},
    )  # fmt: skip
    path.write_text(page, encoding="utf-8")
    return path


def report_environment() -> Environment:
    """Templates with the filters for words and numbers of a report."""
    environment = page_environment()
    environment.filters["number"] = _number
    environment.filters["of_check"] = _of_check
    environment.filters["bar_of_check"] = lambda check: (
        check.bar_in_words(100.0, " %") if _is_in_per_cent(check) else check.bar_says
    )
    environment.filters["in_words"] = check_in_words
    environment.filters["metric_in_words"] = metric_in_words
    environment.filters["key_in_words"] = key_in_words
    environment.filters["amount"] = amount_of
    environment.filters["raised"] = _raised
    environment.filters["signed"] = lambda x: "" if x is None else f"{x:+.2f} %"
    return environment


def _write_case(
    environment: Environment,
    result: CaseResult,
    path: Path,
    index: str,
    figures: FigureForm | None,
) -> Path:
    """Write one page; its policy admits our own script, by hash, and nothing from elsewhere."""
    script, script_hash = script_of("drawing.js", "viewer.js")
    page = environment.get_template("report.html.j2").render(
        r=result,
        index=index,
        script=script,
        script_hash=script_hash,
        **_case_view(result, path.parent, figures),
    )
    path.write_text(page, encoding="utf-8")
    return path


def _case_view(result: CaseResult, folder: Path, figures: FigureForm | None) -> dict[str, Any]:
    try:
        pictures = draw_pictures(result, folder)
    except Exception:  # a picture that fails must not lose the verdict
        pictures = {}
    problem, units = result.problem, result.units

    def own(value: float, dimension: str) -> str:
        size, unit = units.of(dimension)
        return f"{_number(value / size)} {_raised(unit)}"

    record = in_own_units(result.provenance, units)
    budgets, no_budget = _budgets(result)
    tables = write_tables(result, folder, budgets)
    drawn = write_figures(result, folder, figures, budgets) if figures else []
    first = _first_picture(result) if pictures else None
    data = {name: _data_url(path.read_bytes()) for name, path in pictures.items()}
    return {
        "trust": trust_of(result),
        "truth": truth_record(result),
        "day": str(result.provenance["time"])[:10],
        "first_says": first[1] if first else "",
        "counts": Counter(check.verdict for check in result.checks).most_common(),
        # The diagnosis has a heading of its own.
        "notes": [note for note in result.notes if not note.startswith("Diagnosis, ")],
        "no_budget": no_budget,
        "citation": citation(result),
        "files": [path.name for path in (*tables, *drawn)],
        "motion_plot": _drawn(motion_svg, result),
        "budgets": budget_rows(budgets, units) if budgets else None,
        "budget_plots": [
            Markup(budget_svg([b for b in budgets if b.quantity == quantity]))
            for quantity in dict.fromkeys(b.quantity for b in budgets)
        ],
        "table": state_table(result),
        "pictures": data | ({"first": first[0]} if first else {}),
        "scene": Markup(viewer_json(result)) if result.states else "",
        "looks": [shown.name(result.states) for shown in comparisons_of(result)],
        "plot": _drawn(checks_svg, result),
        "measured_plot": _drawn(_measured_svg, result) if result.measured else "",
        "time": problem.time,
        "is_motion": problem.time is not None,
        "slider": "fraction of the displacement" if problem.time is None else "time",
        "quality": measure_quality(problem.mesh),
        "material": problem.material,
        "other_law": _other_law(problem.material.law),
        "green": [s for s in result.states if not s.is_reference and s.strain is Strain.GREEN],
        "green_truth": green_truth(result),
        "percents": [percent_off(result, state) for state in result.states],
        "num_supports": len(problem.supports),
        "loads": [
            f"{_in_words(name)}{f' ({count})' if count > 1 else ''}"
            for name, count in Counter(
                type(load).__name__ for load in (*problem.loads, *problem.springs)
            ).items()
        ],
        "tools": tools_in_words(problem, units),
        "inclusions": [
            f"{name}: {one.num_cells} cells, {100.0 * one.part_of(problem.mesh):.2g} % of the "
            f"volume, E = {own(one.material.youngs_modulus, 'stress')}, Poisson's ratio "
            f"{one.material.poissons_ratio:.6g}"
            for one, name in zip(
                inclusions_of(problem),
                inclusion_names(problem, parse_toml(result.case_text)),
                strict=True,
            )
        ],
        "masses": [own(mass.mass, "mass") for mass in problem.masses],
        "credibility": credibility_html(result),
        "provenance": provenance_rows(record),
        "record": record_text(record),
        "own": own,
        "in_own": units.in_case_units,
        "unit_of": {
            dimension: _raised(units.of(dimension)[1]) for dimension in ("length", "area", "volume")
        },
        "lengths": {one: units.of(one)[0] for one in ("length", "area", "volume")},
        "case_lines": case_lines(result.case_text),
    }


def in_own_units(said: Any, units: Units) -> Any:
    """A record, at any depth, with the lengths and stresses of its texts in the case's units."""
    if isinstance(said, str):
        return units.in_case_units(said)
    if isinstance(said, Mapping):
        return {
            key: f"{value / units.metres(1.0):.4g} {units.length}"
            if key == "longest_edge"
            else in_own_units(value, units)
            for key, value in said.items()
        }
    if isinstance(said, list | tuple):
        return [in_own_units(value, units) for value in said]
    return said


def _raised(unit: str) -> str:
    """A unit with its exponent as people write it: mm² and kg/m³."""
    return unit.replace("m2", "m²").replace("m3", "m³")


def _measured_svg(result: CaseResult) -> str:
    figure = measured_figure(result)
    return "" if figure is None else figure.svg


def case_lines(text: str) -> list[tuple[str, bool]]:
    """Lines of a case file, and whether paper has them.

    Keys that are commented out are not on paper, nor is the list of metrics that `init` writes.
    """
    metrics = {f"#   {each.name}: {each.meaning}" for each in CATALOGUE.values()}
    return [
        (line, not _UNUSED_KEY.match(line) and line not in metrics) for line in text.splitlines()
    ]


def _first_picture(result: CaseResult) -> tuple[Markup, str] | None:
    """The picture of the first screen and its words; None where there is none to draw."""
    try:
        found = first_view(result)
        return (
            (_data_url(draw({"first": [found[0]]}, "small")["first"]), found[1]) if found else None
        )
    except Exception:  # a picture that fails must not lose the verdict
        return None


def credibility_html(result: CaseResult) -> Markup:
    """What the report contributes to a credibility file, factor by factor, and what is left."""

    def counted(against: str) -> dict[str, Any]:
        checks = [c for c in result.checks if c.against == against and not c.is_vacuous]
        passed = sum(check.verdict is Verdict.PASSED for check in checks)
        bars = [check.reference_error for check in checks if check.reference_error < math.inf]
        return {
            "checks": checks,
            "total": len(checks),
            "passed": passed,
            "state": _ABSENT if not checks else "given" if passed == len(checks) else "in part",
            "bar": max(bars, default=0.0),
            "largest": max((c.value for c in checks if c.value is not None), default=None),
        }

    # What the case file states beside [evidence]; none where it is not at hand.
    try:
        tables = parse_toml(result.case_text)
    except InputError:
        tables = {}
    stated = {key: len(tables.get(key, ())) for key in ("measurement", "uncertainty")}
    template = report_environment().get_template("credibility.html.j2")
    page = template.render(
        r=result, stated=stated, day=str(result.provenance["time"])[:10],
        truth_found=str(stored_record(result.provenance.get("reference") or {}).get("date", "")),
        same=counted("same_mesh"), truth=counted("truth"), measured=counted(MEASUREMENT),
    )  # fmt: skip
    return Markup(page)  # its texts are escaped


def _small(path: Path) -> str:
    """A picture scaled to the width of a table's column; "" without one."""
    if not path.is_file():
        return ""
    pixels = image.imread(path)[:, :, :3]
    step = -(-pixels.shape[1] // _SMALL)
    high, wide = (side // step for side in pixels.shape[:2])
    cells = pixels[: high * step, : wide * step].reshape(high, step, wide, step, 3)
    data = io.BytesIO()
    image.imsave(data, cells.mean(axis=(1, 3)), format="png")
    return _data_url(data.getvalue())


def _other_law(law: Law) -> str:
    """The name of the law where it is not the usual one."""
    if law.is_linear_in_strain:
        return ""
    words: str = describe_conventions(Strain.GREEN, law)["law"]
    return words


def _drawn(draw: Callable[[CaseResult], str], result: CaseResult) -> Markup:
    """A drawing, whose texts are escaped; a plot that fails must not lose the verdict."""
    try:
        return Markup(draw(result))
    except Exception as error:
        return Markup("<p>The plot could not be drawn ({}).</p>").format(type(error).__name__)


def _budgets(result: CaseResult) -> tuple[list[Budget], str]:
    """Where the candidates' errors come from, or why that cannot be determined.

    For a motion fastsim is run with one thing changed at a time, where that is cheap.
    """
    problem, span = result.problem, result.problem.time
    try:
        if span is None:
            budgets = case_budgets(result)
            return budgets, "" if budgets else "there is no truth to hold the candidate against"
        if span.time_step is None or problem.tools:
            return [], "a motion without a stated step, or with tools"
        cost = problem.mesh.num_cells * span.end_time / span.time_step
        if cost > _CHEAP_MOTION:
            return [], "runs on the finer mesh would take minutes"
        budgets = []
        for state in result.states:
            if not state.is_reference:
                same_mesh = result.state(OF_ELEMENT[state.element], state.strain)
                budgets += motion_budgets(
                    problem, state, same_mesh=same_mesh, diagnoses=result.diagnoses
                )
        return budgets, ""
    except (InputError, FastsimError) as error:
        return [], str(error)


def _closest(result: CaseResult) -> str:
    """The check that uses the largest fraction of its limit, or the first that did not pass."""
    for check in result.checks:
        if check.verdict is not Verdict.PASSED:
            says = check.message if check.value is None else amount_of(check)
            return f"{check_in_words(check)}: {says}"
    parts = [
        ((check.value + check.reference_error) / check.limit, check)
        for check in result.checks
        if check.value is not None and check.limit > 0.0 and check.against != "candidate"
    ]
    if not parts:
        return "–"
    part, check = max(parts, key=lambda pair: pair[0])
    return f"{check_in_words(check)}: {100 * part:.2g} % of its limit"


def _data_url(png: bytes) -> Markup:
    """A picture as an address; markup, as parts of it would be taken for folders in a text."""
    return Markup("data:image/png;base64,{}").format(base64.b64encode(png).decode("ascii"))


def _in_words(name: str) -> str:
    """The name of a class in words: "PointForce" is a point force."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()


def _of_check(value: float | None, check: CheckResult) -> str:
    """A value, limit or bar of a check with its unit; in per cent where the limit is of that size.

    What is left on the same mesh is a fraction of the scale: "1e-10 %" would be harder to read.
    """
    if value is None or not math.isfinite(value):
        return "unknown"
    if check.unit != "-":
        return f"{_number(value)} {check.unit}"
    return f"{_number(100.0 * value)} %" if _is_in_per_cent(check) else _number(value)


def _is_in_per_cent(check: CheckResult) -> bool:
    is_fraction = check.unit == "-" and check.scale not in ("-", "none")
    return is_fraction and check.limit >= _LEAST_PER_CENT


def _number(value: float | None) -> str:
    """Format sizes with six digits, small errors with three, and nothing as a dash."""
    if value is None:
        return "–"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.4g}"
    if 1e4 <= abs(value) < 1e9:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.2e}"
