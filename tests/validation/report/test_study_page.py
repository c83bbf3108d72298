"""Tables, lines and the page of a study: one source for page, CSV and JSON."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest

from palpate.validation.report.plots import Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Page, Table, judged, study_page
from palpate.validation.versions import version_of

TABLE = Table(
    "A <table>",
    {"name": "", "error [%]": ".2f", "cells": "d"},
    [("=1+1", 1.0 / 3.0, 8), ("b", None, 64)],
)


def test_a_cell_is_shown_by_the_format_of_its_column_and_nothing_by_a_dash() -> None:
    assert TABLE.texts == [["=1+1", "0.33", "8"], ["b", "-", "64"]]
    assert Table("t", {"x": "+.1f"}, [(-0.0,)]).texts == [["+0.0"]]


def test_a_column_of_words_that_says_nothing_is_in_the_files_alone() -> None:
    table = Table("t", {"x": "d", "why not": ""}, [(1, ""), (2, "")])
    assert (list(table.shown), table.texts) == (["x"], [["1"], ["2"]])
    assert table.csv.startswith("x,why not")
    assert list(Table("t", {"x": "d", "why not": ""}, [(1, ""), (2, "lost")]).shown) == [
        "x", "why not",
    ]  # fmt: skip
    assert list(Table("t", {"x": "d", "why not": ""}, []).shown) == ["x", "why not"]


def test_csv_and_json_have_the_numbers_themselves() -> None:
    rows = list(csv.DictReader(io.StringIO(TABLE.csv)))
    assert float(rows[0]["error [%]"]) == pytest.approx(1.0 / 3.0, rel=1e-9)
    assert rows[1]["error [%]"] == ""
    # What a spreadsheet would run is only text.
    assert rows[0]["name"] == "'=1+1"
    assert TABLE.records[0] == {"name": "=1+1", "error [%]": 1.0 / 3.0, "cells": 8}


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="2 cells, 3 columns"):
        Table("t", {"a": "", "b": "", "c": ""}, [(1, 2)])


def test_the_page_escapes_words_shows_verdicts_and_leaves_out_what_is_for_files() -> None:
    hidden = Table("For files", {"x": ""}, [("secret",)], is_shown=False)
    page = study_page(
        "T<i>tle",
        ["Why <b>."],
        [judged("a claim", "this", True), judged("another", "that", False)],
        Page({"f": Figure("<svg></svg>", "a & b")}, {"t": TABLE, "h": hidden}, ["Left out: <x>"]),
    )
    assert '<div class="verdict failed">' in page
    assert "T&lt;i&gt;tle" in page
    assert re.search(rf"palpate {version_of('palpate')} · 20\d\d-\d\d-\d\d<", page)
    assert "Left out: &lt;x&gt;" in page
    assert "<svg></svg>" in page
    assert "A &lt;table&gt;" in page
    assert '<td class="n">0.33</td>' in page
    assert "<td>b</td>" in page
    assert "secret" not in page


def test_lines_are_drawn_with_their_labels_notes_and_levels(tmp_path: Path) -> None:
    lines = [
        Line((1.0, 10.0, 100.0), (1e-2, 1e-3, 1e-4), label="errors"),
        Line((1.0,), (1e-3,), style="x", colour="#123456"),
    ]
    panel = Panel(
        lines, x="cells", y="error", title="A panel", log="xy", levels=(2e-4,),
        positions={5.0: "the end"}, band=(1e-4, 2e-4), notes=[(10.0, 1e-3, "here")],
        ticks={1.0: "one", 100.0: "hundred"}, y_range=(1e-5, None),
    )  # fmt: skip
    other = Panel([Line((0.0, 1.0), (0.0, 1.0), label="errors")], x="time")
    pdf = tmp_path / "own.pdf"
    own = line_figure([[panel, other]], "caption", shares_legend=False, pdf=pdf)
    assert pdf.read_bytes().startswith(b"%PDF")
    shared = line_figure([[panel], [other]], "caption", shares_legend=True)
    assert own.caption == "caption"
    for words in (
        "errors",
        "cells",
        "error",
        "A panel",
        "here",
        "the end",
        "one",
        "hundred",
        "#123456",
    ):
        assert words in own.svg
    # A label in each panel, or once below them all.
    assert len(re.findall(">errors<", own.svg)) == 2
    assert len(re.findall(">errors<", shared.svg)) == 1


def test_short_logarithmic_axes_have_plain_numbers_and_long_ones_powers() -> None:
    short = Panel([Line((1.0, 2.0), (2.3, 5.5))], x="x", log="y")
    long = Panel([Line((1.0, 2.0), (1e-12, 1.0))], x="x", log="y")
    assert ">4<" in line_figure([[short]], "", shares_legend=False).svg
    # The exponent stands above the line, in a text of its own.
    assert "1e-" not in line_figure([[long]], "", shares_legend=False).svg
