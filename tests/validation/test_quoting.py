"""Words of others cannot act: in a terminal, a CI log, XML, Markdown, HTML or a spreadsheet."""

import csv
import dataclasses
import io
import json
import re
import unicodedata
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from palpate.validation import quoting
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.case import load_case
from palpate.validation.commands.options import progress_lines
from palpate.validation.judging import outputs
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.outputs import github_annotations
from palpate.validation.judging.results import Judged
from palpate.validation.report.html import report_environment
from palpate.validation.report.tables import state_table_csv
from palpate.validation.states import Verdict

ESCAPE, RIGHT_TO_LEFT, HALF, NONE = "\x1b[2J", "\u202e", "\ud800", "\ufffe"
# What a hostile title, reason, name or last line may hold, all at once.
HOSTILE = (
    f"=1+1 {ESCAPE}\x07\x00\x9b31m{RIGHT_TO_LEFT}\u2066{HALF}{NONE}\uffff\u2028\r\n"
    "::error title=x::y\n##[error]z\n##vso[task]w\n| cell <script>alert(1)</script> "
    "![x](http://x.example/y) `code`\tend]]>&"
)
ALLOWED_HIDDEN = {"\u200c", "\u200d"}
any_text = st.text(st.characters(codec=None, exclude_categories=()), max_size=60)


def hidden(text):
    """What a reader cannot see, line ends aside."""
    return [
        c for c in text
        if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")
        and c != "\n" and c not in ALLOWED_HIDDEN
    ]  # fmt: skip


def commands(text):
    """Lines that the runner of GitHub or Azure would take for a command."""
    return [
        line for line in text.splitlines()
        if line.lstrip().startswith("::") or re.search(r"##\w*\[", line)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def judged():
    return judge_case(load_case("block"))


@pytest.fixture(scope="module")
def hostile(judged):
    """Every text that a case or a candidate chooses is hostile, under each verdict."""
    checks = tuple(
        dataclasses.replace(
            judged.checks[0], verdict=verdict, reason=HOSTILE, message=HOSTILE, scale=HOSTILE
        )
        for verdict in Verdict
    )
    states = tuple(
        dataclasses.replace(s, label=HOSTILE) if s.simulator == "fastsim" else s
        for s in judged.states
    )
    return dataclasses.replace(
        judged, name=HOSTILE, title=HOSTILE, checks=checks, states=states,
        candidates=(Judged(HOSTILE, Verdict.FAILED),) * 2,
        notes=(HOSTILE, f"Since the accepted result: {HOSTILE}."), published={HOSTILE: HOSTILE},
        provenance={"case_file": HOSTILE}, candidate_says={HOSTILE: [HOSTILE, float("nan")]},
    )  # fmt: skip


@pytest.mark.parametrize("width", [20, 80, 300])
def test_nothing_acts_in_a_terminal_however_narrow(hostile, width):
    stream = io.StringIO()
    outputs.print_results([hostile], Console(file=stream, width=width, highlight=False))
    text = stream.getvalue()
    text.encode("utf-8")
    assert hidden(text) == []
    assert commands(text) == []
    assert "\\x1b" in text.replace("\n", "") or width == 20


def test_nothing_acts_in_progress_lines(capsys):
    progress_lines()(HOSTILE)
    said = capsys.readouterr().err
    assert hidden(said) == []
    assert commands(said) == []


def test_junit_is_xml_whatever_the_texts_hold(hostile):
    root = ET.fromstring(outputs.junit_xml([hostile]).encode("utf-8"))
    assert len(root.findall(".//testcase")) >= len(Verdict)
    for element in root.iter():
        for value in element.attrib.values():
            assert hidden(value) == []


def test_a_markdown_row_keeps_its_cells_and_holds_no_html(hostile):
    text = outputs.summary_markdown([hostile])
    text.encode("utf-8")
    assert hidden(text) == []
    rows = [line for line in text.splitlines() if line.startswith("| ") and "---" not in line]
    assert len(rows) == 1 + len(Verdict)
    # Five cells have six bars around them.
    assert {row.count("|") for row in rows} == {6}
    assert "<" not in text
    assert "](" not in text


def test_an_annotation_is_one_command_of_ours(hostile):
    for line in github_annotations([hostile]):
        assert hidden(line) == []
        assert "\n" not in line
        assert re.match(r"::(error|warning) (file=[^,:]*,)?title=[^:,]*::", line)


def test_json_is_strict_and_the_candidates_words_have_a_key_of_their_own(hostile):
    text = outputs.results_json([hostile], "1")
    text.encode("ascii")

    def refuse(word):
        raise AssertionError(word)

    case = json.loads(text, parse_constant=refuse)["cases"][0]
    json.dumps(case, ensure_ascii=False).encode("utf-8")
    (said,) = case["candidate_says"].values()
    assert said[1] is None


def test_a_spreadsheet_runs_nothing(hostile):
    rows = list(csv.reader(io.StringIO(state_table_csv(hostile))))
    assert len({len(row) for row in rows}) == 1
    for row in rows:
        for cell in row:
            assert hidden(cell) == []
            if cell.startswith(("=", "+", "-", "@", "\t", "\r")):
                float(cell)


@pytest.mark.parametrize(
    "text",
    ["=1+1", "+1+1", "-1+1", "@SUM(A1)", "\t=1", "\r=1", "=cmd|'/C calc'!A0", " =1", "-", "+x"],
)
def test_text_that_a_spreadsheet_would_run_gets_an_apostrophe(text):
    assert str(quoting.for_csv(text)).startswith("'")


@pytest.mark.parametrize("value", [1.5, -2, "-1.5", "+3e-4", "plain", "a=b", "", None, True])
def test_other_cells_of_a_spreadsheet_stay(value):
    assert quoting.for_csv(value) == value


@settings(max_examples=300, derandomize=True, deadline=None)
@given(any_text)
def test_any_text_is_safe_in_every_output(text):
    terminal = quoting.for_terminal(text)
    assert hidden(terminal) == []
    assert commands(terminal) == []
    assert "\n" not in terminal
    assert hidden(quoting.for_html(text)) == []
    element = ET.Element("a", value=quoting.for_xml(text))
    assert ET.fromstring(ET.tostring(element)).get("value") == quoting.for_xml(text)
    assert not set("|<>[]`") & set(quoting.for_markdown(text))
    assert not set(":,\n") & set(quoting.for_workflow_property(text))
    json.dumps(quoting.for_json({text: text}), ensure_ascii=False).encode("utf-8")
    for safe in (terminal, quoting.for_html(text), quoting.for_csv(text)):
        str(safe).encode("utf-8")
    quoted = quoting.in_quotes(text)
    assert re.fullmatch(r'"(?:[^"\\]|\\.)*"', quoted)


def test_ordinary_words_stay_as_they_are():
    for text in ("Leber, rechts: 3 % (μ = 0.4)", "肝臓", "می\u200cخواهم", "a|b", "don't", "x < y"):
        assert quoting.visible(text) == text
        assert quoting.for_terminal(text) == text


def test_what_a_candidate_says_is_quoted_as_its_words(tmp_path, judged):
    claim = "independent audit passed"
    about = {"remark": claim, "Reference": "a\n::error::b", "verdict": 'passed" by "all'}
    displacement = next(s for s in judged.states if s.label == "fastsim").displacement
    np.savez(tmp_path / "mine.npz", displacement=displacement, about=json.dumps(about))
    result = judge_case(load_case("block"), candidate=result_candidate(tmp_path / "mine.npz"))
    said = [note for note in result.notes if claim in note]
    assert len(said) == 1
    assert said[0].startswith("mine says of itself, unchecked: ")
    assert f'"remark": "{claim}"' in said[0]
    assert '"passed\\" by \\"all"' in said[0]
    document = json.loads(outputs.results_json([result], "1"))["cases"][0]
    assert document["candidate_says"] == about
    others = {k: v for k, v in document.items() if k not in ("candidate_says", "notes")}
    assert claim not in json.dumps(others)


def test_a_report_escapes_every_text_and_shows_what_is_hidden():
    page = report_environment().from_string("<p>{{ text }}</p>").render(text=HOSTILE)
    page.encode("utf-8")
    assert hidden(page) == []
    assert "<script>" not in page
    assert "\\u202e" in page
