"""A fit as a folder: its page with figures and tables, and the fitted case."""

from __future__ import annotations

import datetime
import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from palpate.meshes.arrays import Points
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case import Case
from palpate.validation.case.measurements import Measured, pins_of
from palpate.validation.case.schema import input_names
from palpate.validation.case.variants import LOAD_SIZES, is_factor, put_value
from palpate.validation.case.writing import case_text
from palpate.validation.judging.measured import Validation
from palpate.validation.report.measured_plots import marker_figure, marker_panel
from palpate.validation.report.plots import BLUE, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, leave
from palpate.validation.states import ExitCode, Verdict, gravest
from palpate.validation.studies.fit_case import CaseFit, LastStep, preferred
from palpate.validation.versions import version_of

_MODELS = {
    LastStep.REFERENCE: "quadratic elements of the reference",
    LastStep.MESH: "cells of two thirds the edge",
    LastStep.NONE: "none: the mesh's error is in the values",
}
_PARTS = ("numerical", "inputs", "data", "u_val", "limit")


def write_fits(fits: Mapping[str, CaseFit], folder: Path, console: Console) -> ExitCode:
    """Write the page of a fit, or of one under each of several laws, and each fitted case.

    Args:
        fits: By law.
        folder: An empty folder.
        console: Gets a line for each finding.

    Returns:
        By the gravest finding.
    """
    first = next(iter(fits.values()))
    several = len(fits) > 1
    findings: list[Finding] = []
    tables: dict[str, Table] = {}
    figures: dict[str, Figure] = {}
    for name, one in fits.items():
        law = f", {name}" if several else ""
        stem = f"-{name}" if several else ""
        findings += _findings(one, law)
        tables |= {f"{key}{stem}": table for key, table in _tables(one, law).items()}
        figures |= {f"{key}{stem}": figure for key, figure in _figures(one, law).items()}
        _write_case(one, folder, f"{first.case.path.stem}-fitted{stem}")
    remarks = [*_remarks(first)]
    if several:
        best = preferred(fits)
        scores = {name: one.score() for name, one in fits.items()}
        shown = "; ".join(f"{n}: {e:.2f} +- {d:.2f}" for n, (e, d) in scores.items())
        findings.append(
            Finding(
                "the data prefer a law, by what was held out",
                f"root mean square error over its limit, and twice u_val: {shown}: "
                + (f"{best}" if best else "none, for the intervals overlap"),
                Verdict.PASSED if best else Verdict.INCONCLUSIVE,
            )
        )
    return leave(
        folder,
        console,
        name="fit",
        title=f"{first.case.title}: fitted to measurements",
        about=[_about(first)],
        findings=findings,
        page=Page(
            figures=figures,
            tables=tables,
            remarks=remarks,
            numbers={"fits": {name: _numbers(one) for name, one in fits.items()}},
        ),
    )


def _about(one: CaseFit) -> str:
    held = ", ".join(one.held_out) or "nothing"
    return (
        f"Least squares of residuals over their standard uncertainties, fitted to "
        f"{', '.join(one.used)}; held out: {held}. Searched with {one.element} tetrahedra of "
        f"{one.case.mesh.mesh.num_cells} cells; last step: {_MODELS[one.last_step]}. Intervals are "
        f"of {one.fit.confidence:.0%}. A value that was held out passes where its error and twice "
        "u_val are within its limit, and fails where the error less twice u_val is above it "
        "(ASME V&V 20)."
    )


def _remarks(one: CaseFit) -> list[str]:
    found = []
    if one.fit.step is not None:
        moved = "; ".join(
            f"{p.name} from {c:.6g} to {v:.6g}"
            for p, c, v in zip(one.fit.parameters, one.coarse, one.fit.values, strict=True)
        )
        found.append(f"The last step took the error of the search's mesh out: {moved}.")
    found.append(
        f"The scatter of the residuals is {one.fit.scatter:.2g} of what the stated uncertainties "
        f"say, with {one.fit.degrees} degrees of freedom: about 1 where model and data agree. The "
        "intervals are made with the scatter that was found."
    )
    return found


def _findings(one: CaseFit, law: str) -> list[Finding]:
    found = []
    for name, rows in one.held_out.items():
        measured = one.measured[name]
        size, unit = measured.unit
        worst = max(range(len(rows)), key=lambda k: rows[k].margin)
        row = rows[worst]
        words = (
            f"{measured.labels[worst]}: {row.error / size:+.2g} {unit} off, u_val "
            f"{row.u_val / size:.2g} {unit}"
        )
        if not math.isfinite(row.limit):
            found.append(Finding(f"{name} is predicted{law}", f"{words}; it has no limit",
                                 Verdict.INCONCLUSIVE))  # fmt: skip
            continue
        claim = (
            f"fitted to {', '.join(one.used)}{law}, {name} is predicted to "
            f"{row.limit / size:.3g} {unit}"
        )
        found.append(Finding(claim, words, gravest([each.verdict for each in rows])))
    lost = set(one.fit.undetermined)
    for parameter, value, width in zip(
        one.fit.parameters, one.fit.values, one.fit.half_widths, strict=True
    ):
        known = parameter.name not in lost
        words = f"{value:.6g} +- {width:.3g}" + ("" if known else f"; {one.remedy(parameter.name)}")
        verdict = Verdict.PASSED if known else Verdict.INCONCLUSIVE
        found.append(Finding(f"the data tell {parameter.name}{law}", words, verdict))
    return found


def _tables(one: CaseFit, law: str) -> dict[str, Table]:
    fit = one.fit
    names = [parameter.name for parameter in fit.parameters]
    tables = {
        "parameters": Table(
            f"Fitted numbers{law}, in the case's units, with intervals of {fit.confidence:.0%}",
            {"key": "", "value": ".6g", "half of the interval": ".6g",
             "before the last step": ".6g", "least possible": ".6g", "largest possible": ".6g",
             **{f"correlation with {name}": "+.2f" for name in names if len(names) > 1}},
            [
                [p.name, float(v), float(w), float(c), p.lower, p.upper,
                 *([float(x) for x in row] if len(names) > 1 else [])]
                for p, v, w, c, row in zip(fit.parameters, fit.values, fit.half_widths, one.coarse,
                                           fit.correlation, strict=True)
            ],
        ),
    }  # fmt: skip
    if fit.blind:
        tables["blind"] = Table(
            f"Combinations that the data cannot tell{law}: parts over half the width of the bounds",
            {**dict.fromkeys(names, "+.2f"), "half of its interval": ".2g"},
            [[*(float(x) for x in blind.direction), blind.half_width] for blind in fit.blind],
        )
    if one.by_run:
        tables["runs"] = Table(
            f"Fitted to each run alone{law}",
            {"run": ".0f", **dict.fromkeys(names, ".6g")},
            [[k + 1, *(float(x) for x in values)] for k, values in enumerate(one.by_run)],
        )
    for name, measured in one.measured.items():
        size, unit = measured.unit
        rows = one.held_out.get(name)
        columns = {"value": "", f"measured [{unit}]": ".4g", f"computed [{unit}]": ".4g",
                   f"error [{unit}]": "+.2g"}  # fmt: skip
        values: list[list[Any]] = [
            [label, float(m) / size, float(p) / size, float(p - m) / size]
            for label, m, p in zip(
                measured.labels, measured.values, one.predictions[name], strict=True
            )
        ]
        title = f"{name}{law}, fitted to"
        if rows is not None:
            title = f"{name}{law}, held out"
            columns |= {f"{key} [{unit}]": ".2g" for key in _PARTS} | {"verdict": ""}
            values = [line + _parts(row, size) for line, row in zip(values, rows, strict=True)]
        tables[f"measured-{name}"] = Table(title, columns, values)
    return tables


def _parts(row: Validation, size: float) -> list[Any]:
    numbers = (row.numerical, row.input, row.data, row.u_val)
    limit = row.limit / size if math.isfinite(row.limit) else None
    return [*(x / size for x in numbers), limit, row.verdict.value if limit else "no limit"]


def _figures(one: CaseFit, law: str) -> dict[str, Figure]:
    found = {}
    rest = [m for m in one.measured.values() if m.spec.kind == "rest"]
    if rest:
        panels = [_markers(one, measured) for measured in rest]
        found["markers"] = marker_figure(panels, law)
    for measured in one.measured.values():
        if measured.spec.kind == "tool_force":
            found[f"curve-{measured.spec.name}"] = _curve(one, measured, law)
    return found


def _markers(one: CaseFit, measured: Measured) -> Panel:
    size, unit = measured.unit
    name = measured.spec.name
    pins = pins_of(one.case, measured.spec.markers)
    return marker_panel(
        one.case.problem.mesh,
        size,
        unit,
        np.array([pin.position for pin in pins.values()]) / size,
        measured.values.reshape(-1, 3) / size,
        {"": one.predictions[name].reshape(-1, 3) / size},
        f"{name}, {'held out' if name in one.held_out else 'fitted to'}",
    )


def _curve(one: CaseFit, measured: Measured, law: str) -> Figure:
    size, unit = measured.unit
    length, name = measured.case.spec.units.of("length")
    depth, computed = measured.depths / length, one.predictions[measured.spec.name] / size
    values, band = measured.values / size, 2.0 * measured.uncertainty / size
    bars = [
        Line([d, d], [v - b, v + b], "", "-", RED)
        for d, v, b in zip(depth, values, band, strict=True)
    ]
    return line_figure(
        [[Panel(
            [Line(depth, values, "measured, with two standard uncertainties", "o", RED), *bars,
             Line(depth, computed, "computed", "-", BLUE)],
            x=f"depth of the tool [{name}]", y=f"force on the tool [{unit}]",
            title=f"{measured.spec.name}{law}",
        )]],
        "Force on the tool over its depth.", shares_legend=False,
    )  # fmt: skip


def _numbers(one: CaseFit) -> dict[str, Any]:
    error, doubt = one.score()
    return {
        "values": one.values,
        "half_widths": dict(zip(one.values, map(float, one.fit.half_widths), strict=True)),
        "undetermined": list(one.fit.undetermined),
        "fitted_to": list(one.used),
        "last_step": one.last_step.value,
        "held_out_error": error if math.isfinite(error) else None,
        "held_out_twice_u_val": doubt if math.isfinite(doubt) else None,
    }


def fitted_text(one: CaseFit) -> str:
    """The case with the fitted numbers and their uncertainty, as the text of a case file."""
    values = parse_toml(one.case.text)
    for key, value in one.values.items():
        put_value(values, key, float(f"{value:.8g}"))
    if one.case.other_law is not None:
        values["material"]["law"] = str(one.case.other_law)
    evidence = values.setdefault("evidence", {})
    inputs = [_input_of(one.case, key) for key in one.values]
    evidence["fitted"] = list(dict.fromkeys([*evidence.get("fitted", []), *inputs]))
    left = [
        table
        for table in values.get("uncertainty", [])
        if not set(table["inputs"]) & set(one.values)
    ]
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    source = f"palpate {version_of('palpate')} fit to {', '.join(one.used)}, {today}"
    # A factor is 1 in the fitted case, whose load has its size.
    sizes = [v if is_factor(key) else 1.0 for key, v in one.values.items()]
    spread = np.sqrt(np.diag(one.fit.covariance)) / np.array(sizes)
    left.append({
        "inputs": list(one.values),
        "standard": [float(f"{u:.3g}") for u in spread],
        **({"correlation": _rounded(one.fit.correlation)} if len(spread) > 1 else {}),
        "source": source,
    })  # fmt: skip
    values["uncertainty"] = left
    return f"# Fitted: {source}.\n" + case_text(values)


def _input_of(case: Case, key: str) -> str:
    """The input of a case that a key is of: the whole row of a component, the size of a load."""
    names = input_names(case.spec)
    if is_factor(key):
        load = key.removesuffix("factor")
        return next(load + size for size in LOAD_SIZES if load + size in names)
    return key if key in names else key[: key.rindex("[")]


def _rounded(correlation: Points) -> list[list[float]]:
    """Symmetric to the last digit, with 1 in the diagonal."""
    table = np.round(np.clip(0.5 * (correlation + correlation.T), -1.0, 1.0), 4)
    np.fill_diagonal(table, 1.0)
    return [[float(x) for x in row] for row in table]


def _write_case(one: CaseFit, folder: Path, stem: str) -> None:
    """The fitted case, with every file that it names beside it."""
    _copy_files(one.case, one.case.files, folder)
    (folder / f"{stem}.toml").write_text(fitted_text(one), encoding="utf-8")


def _copy_files(case: Case, files: Sequence[Path], folder: Path) -> None:
    for path in files:
        if path == case.path:
            continue
        target = folder / path.relative_to(case.folder)
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
