"""Figures and tables for a paper: text as text, a column wide, whole; a line to cite."""

from __future__ import annotations

import csv
import dataclasses
import json
import re
from pathlib import Path

import pytest

from palpate.validation.judging.error_budget import case_budgets
from palpate.validation.judging.outputs import citation, results_json
from palpate.validation.judging.results import CaseResult
from palpate.validation.report import FigureForm
from palpate.validation.report.case_plots import write_figures
from palpate.validation.report.tables import write_tables

MILLIMETRE = 72.0 / 25.4  # points


def width(path: Path) -> float:
    """Of a figure [mm]."""
    text = path.read_bytes().decode("latin-1")
    pattern = r'width="([\d.]+)pt"' if path.suffix == ".svg" else r"/MediaBox \[ ?0 0 ([\d.]+)"
    found = re.search(pattern, text)
    assert found is not None, path
    return float(found[1]) / MILLIMETRE


@pytest.mark.parametrize("form", list(FigureForm))
@pytest.mark.long
def test_figures_have_text_and_the_width_of_columns(
    form: FigureForm, both: CaseResult, tmp_path: Path
) -> None:
    made = {p.stem: p for p in write_figures(both, tmp_path, form, case_budgets(both))}
    plots = ["block-checks", "block-budget-1", "block-budget-2"]
    bodies = ["block-errors", "block-states"]
    assert sorted(made) == sorted([*plots, *bodies])
    assert {round(width(made[name])) for name in plots} == {88}
    assert {round(width(made[name])) for name in bodies} == {180}
    for name, path in made.items():
        content = path.read_bytes()
        if form is FigureForm.SVG:
            words = re.findall(rb"<text[^>]*>([^<]+)</text>", content)
            expected = {"checks": b"Green strain", "states": b"displacement [mm]"}
            word = expected.get(name.rpartition("-")[2], b"")
            assert any(word in found for found in words), name
            assert b"<image" not in content, name
        else:
            assert b"/FontFile2" in content, name  # embedded, and no drawn letters
            assert b"/Type3" not in content, name
            assert b"/Subtype /Image" not in content, name
    if form is FigureForm.PDF:
        return
    again = tmp_path / "again"
    again.mkdir()
    for path in write_figures(both, again, form, case_budgets(both)):
        assert path.read_bytes() == made[path.stem].read_bytes(), path.name


def test_tables_carry_every_check_and_solution(both: CaseResult, tmp_path: Path) -> None:
    made = {p.stem: p for p in write_tables(both, tmp_path, case_budgets(both))}
    rows = {
        name.rpartition("-")[2]: list(csv.DictReader(path.read_text("utf-8").splitlines()))
        for name, path in made.items()
    }
    assert sorted(rows) == ["budget", "checks", "solutions", "states"]
    assert len(rows["checks"]) == len(both.checks)
    for row, check in zip(rows["checks"], both.checks, strict=True):
        assert row["verdict"] == check.verdict
        assert float(row["value"]) == pytest.approx(check.value, rel=1e-9)
        assert float(row["limit"]) == check.limit
    for row, state in zip(rows["solutions"], both.states, strict=True):
        # In the case's units, as the figures are.
        assert float(row["volume [mm3]"]) == pytest.approx(1e9 * state.volume, rel=1e-9)
        length = float(row["largest displacement [mm]"])
        assert length == pytest.approx(1e3 * state.max_displacement, rel=1e-9)
    # Parts of an error are numbers, which a program reads; one that is not there is empty.
    columns = ["error", "model", "discretisation", "time"]
    budgets = [[row[f"{name} [%]"] for name in columns] for row in rows["budget"]]
    for cells, budget in zip(budgets, case_budgets(both), strict=True):
        assert float(cells[0]) == pytest.approx(100.0 * budget.total / budget.scale, rel=6e-3)
        assert cells[3] == ""


def test_a_line_to_cite_names_every_version(both: CaseResult) -> None:
    line = citation(both)
    versions = both.provenance["reference"]["versions"]
    for word in (
        f"palpate {both.provenance['palpate']}", "case block", "fastsim (smoothed)",
        f"dolfinx {versions['dolfinx']}", f"{both.problem.mesh.num_cells} tetrahedra",
        str(both.provenance["case_key"])[:12],
    ):  # fmt: skip
        assert word in line
    assert json.loads(results_json([both], "1"))["cases"][0]["citation"] == line
    said = dataclasses.replace(both, candidate_says={"version": "9\n::error::"})
    assert '(says version "9 ::error::")' in citation(said)
    assert citation(dataclasses.replace(both, provenance={})).startswith("palpate of unknown")
