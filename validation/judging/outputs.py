"""Results in formats for machines and people.

results.json, JUnit XML, Markdown, annotations of GitHub, a table on the terminal, a citation.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json as json_format
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from palpate.meshes.own_files import may_replace, own_path
from palpate.validation.judging.expectation import errors_of, named_checks
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.metrics import CATALOGUE
from palpate.validation.quoting import (
    for_json,
    for_markdown,
    for_terminal,
    for_workflow,
    for_workflow_property,
    for_xml,
    in_quotes,
)
from palpate.validation.states import Verdict
from palpate.validation.versions import version_of

if TYPE_CHECKING:
    from palpate.validation.diagnosis.explanation import Diagnosis

_COLOUR = {
    Verdict.PASSED: "green",
    Verdict.FAILED: "red",
    Verdict.INCONCLUSIVE: "yellow",
    Verdict.SKIPPED: "dim",
}
_TONE = {str(verdict): colour for verdict, colour in _COLOUR.items()} | {"narrow": "cyan"}
_SUMMARY = "Judged by palpate"
# How results.json, junit.xml and summary.md begin, in so many bytes.
_BEGINS = re.compile(
    rb'(\{\s*"palpate": "[^"]*",\s*"schema": \d+,\s*"cases":'
    rb'|<\?xml[^>]*\?>\s*<testsuites name="palpate"|%b)' % _SUMMARY.encode()
)
_HEAD = 200
# Attributes of a case in results.json.
_OF_CASE = (
    "name", "title", "verdict", "not_judged", "scope", "metrics", "unseen", "published", "notes",
    "candidate_says", "provenance",
)  # fmt: skip
_GRAVEST_FIRST = (Verdict.FAILED, Verdict.INCONCLUSIVE, Verdict.SKIPPED, Verdict.PASSED)
# Attributes of a check in JUnit.
_PROPERTIES = (
    "value", "limit", "reference_error", "scale", "reason", "is_vacuous", "precision",
)  # fmt: skip
_OUTCOMES = {
    Verdict.FAILED: ("failure", ""),
    Verdict.INCONCLUSIVE: ("error", "inconclusive: "),
    Verdict.SKIPPED: ("skipped", ""),
}
# Job summaries are cut off at 1 MiB; nobody reads more rows than this.
_MOST_ROWS = 200
# GitHub shows at most so many annotations of a kind for each step; the rest is counted.
_MOST_ANNOTATIONS = 10
_ANNOTATIONS = {Verdict.FAILED: "error", Verdict.INCONCLUSIVE: "warning"}
_SI = {"volume": "m3", "surface_area": "m2", "max_displacement": "m"}
# Digits of a hash that distinguish it from any other.
_KEY = 12
# Libraries of the reference whose versions its numbers depend on.
_LIBRARIES = ("dolfinx", "basix", "petsc")


def results_json(results: Sequence[CaseResult], version: str) -> str:
    """The results as strict JSON, no NaN; the unit of each number is in `units`, or beside it."""
    cases = [
        {name: getattr(result, name) for name in _OF_CASE}
        | {
            "units": _units_of(result),
            "citation": citation(result),
            "candidates": [dataclasses.asdict(judged) for judged in result.candidates],
            "checks": [dataclasses.asdict(check) for check in result.checks],
            "diagnosis": [row for found in result.diagnoses for row in _diagnosis_rows(found)],
        }
        for result in results
    ]
    document = {"palpate": version, "schema": 1, "cases": cases}
    return json_format.dumps(for_json(document), indent=2, allow_nan=False) + "\n"


def _units_of(result: CaseResult) -> dict[str, Any]:
    """The unit of every number of a case; those of a check are in its own `unit`."""
    return {
        "metrics": {name: _unit_of(name) for name in result.metrics},
        "provenance": {"mesh.longest_edge": "m", "mesh.smallest_dihedral_deg": "degrees"},
        "published": result.units.model_dump(),
    }


def _unit_of(name: str) -> str:
    """Of a number by its name: sizes are SI, errors fractions of their scale or counts."""
    number = name.rpartition(".")[2]
    if name.startswith("error.") and number in CATALOGUE:
        return CATALOGUE[number].unit
    return _SI.get(number, "-")


def _diagnosis_rows(found: Diagnosis) -> list[dict[str, Any]]:
    """A row for each explanation that fits; one without a name where none of those tried does."""
    rows = [
        {
            "explanation": each.name,
            "cause": each.cause.name.lower(),
            "residual": each.residual,
            "stated": each.stated,
            "of": each.of,
        }
        for each in found.explanations
    ]
    nothing = {"explanation": None, "cause": None, "residual": None}
    rows = rows or [{**nothing, "stated": found.stated, "of": found.of}]
    about = {"strain": found.strain, "element": found.element, "tried": found.tested}
    return [about | row for row in rows]


def junit_xml(results: Sequence[CaseResult]) -> str:
    """One test suite for each case, one test for each check; inconclusive is an error.

    So is a case that nothing but vacuous checks passed: JUnit knows no third colour.
    """
    root = ET.Element("testsuites", name="palpate")
    for result in results:
        counts = [check.verdict for check in result.checks]
        # Inconclusive though no check is: then nothing that was checked says anything.
        is_empty = result.verdict is Verdict.INCONCLUSIVE and result.verdict not in counts
        suite = ET.SubElement(
            root,
            "testsuite",
            name=for_xml(result.name),
            tests=str(len(counts) + is_empty),
            failures=str(counts.count(Verdict.FAILED)),
            errors=str(counts.count(Verdict.INCONCLUSIVE) + is_empty),
            skipped=str(counts.count(Verdict.SKIPPED)),
        )
        if when := _time_of(result):
            suite.set("timestamp", when)
        about = ET.SubElement(suite, "properties")
        ET.SubElement(about, "property", name="scope", value=result.scope)
        for check in result.checks:
            test = ET.SubElement(
                suite,
                "testcase",
                classname=for_xml(f"palpate.{result.name}"),
                name=for_xml(check.name),
            )
            properties = ET.SubElement(test, "properties")
            for name in _PROPERTIES:
                value = for_xml(str(getattr(check, name)))
                ET.SubElement(properties, "property", name=name, value=value)
            if check.verdict in _OUTCOMES:
                tag, words = _OUTCOMES[check.verdict]
                outcome = ET.SubElement(test, tag, message=for_xml(words + check.message))
            if check.verdict is Verdict.FAILED:
                explained = [
                    str(found)
                    for found in result.diagnoses
                    if (found.strain, found.element) == (check.strain, check.element)
                ]
                outcome.text = "\n".join(map(for_xml, explained)) or None
        if is_empty:
            test = ET.SubElement(suite, "testcase", classname="palpate", name=for_xml(result.name))
            ET.SubElement(test, "error", message=for_xml(result.notes[-1]))
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def summary_markdown(results: Sequence[CaseResult]) -> str:
    """A table for a job summary, the checks that did not pass first."""
    rows = [(result, check) for result in results for check in result.checks]
    rows.sort(key=lambda row: _GRAVEST_FIRST.index(row[1].verdict))
    lines = [f"{_SUMMARY}, {_time_of(results[0])}\n"] if results else []
    for r in results:
        outcome = for_markdown(_outcome(r))
        lines.append(f"- **{for_markdown(r.name)}**: {outcome} ({for_markdown(r.title)})")
        if len(r.candidates) > 1:
            lines += [f"  - {for_markdown(one.name)}: {one.verdict}" for one in r.candidates]
        lines += [f"  - diagnosis, {d.title}: {for_markdown(str(d))}" for d in r.diagnoses]
    lines += ["", "| case | check | found | verdict | reason |", "| --- | --- | --- | --- | --- |"]
    lines += [
        f"| {for_markdown(result.name)} | {for_markdown(check.name)} "
        f"| {for_markdown(check.message)} | {check.verdict} | {for_markdown(check.reason)} |"
        for result, check in rows[:_MOST_ROWS]
    ]
    if len(rows) > _MOST_ROWS:
        lines.append(f"\nand {len(rows) - _MOST_ROWS} more")
    return "\n".join(lines) + "\n"


def print_results(results: Sequence[CaseResult], console: Console) -> None:
    """The table a person sees at the end."""
    for result in results:
        # Text, not markup: names come from files.
        table = Table(
            title=Text(for_terminal(f"{result.name}: {result.title}")), title_justify="left"
        )
        # No metric's name is broken: the other columns are made narrower.
        longest = max((len(check.metric) for check in result.checks), default=0)
        table.add_column("check", overflow="fold", min_width=longest)
        for name in ("found", "verdict", "why this limit"):
            table.add_column(name, overflow="fold")
        said: dict[str, str] = {}
        for check in result.checks:
            # One failure of a candidate is the message of all its checks.
            first = said.setdefault(check.message, check.name)
            is_again = check.value is None and first != check.name
            table.add_row(
                Text(for_terminal(check.name)),
                Text(for_terminal(f"as {first}" if is_again else check.message)),
                Text(check.verdict, style=_COLOUR[check.verdict]),
                Text(for_terminal(check.reason), style="dim"),
            )
        if result.checks:
            console.print(table)
        for note in () if result.not_judged else result.notes:
            console.print(Text(for_terminal(note), style="dim"))
        for judged in result.candidates if len(result.candidates) > 1 else ():
            line = f"{result.name}, {judged.name}: {judged.verdict}"
            console.print(Text(for_terminal(line), style=_COLOUR[judged.verdict]))
        line = f"{result.name}: {_outcome(result)}"
        console.print(Text(for_terminal(line), style=_TONE[result.tone]))


def _outcome(result: CaseResult) -> str:
    """The verdict, or why there is none, and beside a "passed" what it does not say."""
    if result.not_judged:
        return f"not judged: {result.not_judged}"
    caution = result.scope.caution if result.verdict is Verdict.PASSED else ""
    return f"{result.verdict}, {caution}" if caution else str(result.verdict)


def side_by_side(results: Sequence[CaseResult]) -> tuple[list[str], list[list[str]]]:
    """Column names, and a row for each error against the truth or a published number.

    Of cases with several candidates; errors, the truth's own bar and limits in per cent.
    """
    several = [result for result in results if len(result.candidates) > 1]
    if not several:
        return [], []
    columns = ["case", "error", *(one.name for one in several[0].candidates), "bar", "limit"]
    rows = []
    for result in several:
        checks = dict(named_checks(result, result.candidates[0]))
        found = [errors_of(result, judged) for judged in result.candidates]
        for name, *values in zip(found[0], *(errors.values() for errors in found), strict=True):
            check = checks.get(name)
            bar_and_limit = [None, None] if check is None else [check.reference_error, check.limit]
            unit = "-" if check is None else check.unit
            shown = (_shown(value, unit) for value in (*values, *bar_and_limit))
            rows.append([result.name, name, *shown])
    return columns, rows


def side_by_side_markdown(results: Sequence[CaseResult]) -> str:
    """The table for a job summary; empty where no case has several candidates."""
    columns, rows = side_by_side(results)
    if not rows:
        return ""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n" + "".join(f"| {' | '.join(map(for_markdown, line))} |\n" for line in lines)


def _shown(value: float | None, unit: str) -> str:
    if value is None or not value < float("inf"):
        return "-"
    return f"{100.0 * value:.2g} %" if unit == "-" else f"{value:.2g} {unit}"


def github_annotations(results: Sequence[CaseResult]) -> list[str]:
    """One line for each check that did not pass, ten of a kind at most, then a count."""
    lines = []
    for verdict, kind in _ANNOTATIONS.items():
        found = [(r, c) for r in results for c in r.checks if c.verdict is verdict]
        lines += [
            _annotation(kind, result, check) for result, check in found[: _MOST_ANNOTATIONS - 1]
        ]
        if len(found) == _MOST_ANNOTATIONS:
            lines.append(_annotation(kind, *found[-1]))
        elif len(found) > _MOST_ANNOTATIONS:
            lines.append(
                f"::{kind} title=palpate::and {len(found) - _MOST_ANNOTATIONS + 1} more checks"
            )
    for result in results:
        verdicts = {check.verdict for check in result.checks}
        if result.verdict is Verdict.INCONCLUSIVE and result.verdict not in verdicts:
            text = for_workflow(f"{result.verdict}; {result.notes[-1] if result.notes else ''}")
            lines.append(f"::warning title={for_workflow_property(result.name)}::{text}")
    return lines


def _annotation(kind: str, result: CaseResult, check: CheckResult) -> str:
    file = str(result.provenance.get("case_file", ""))
    where = f"file={for_workflow_property(file)}," if file else ""
    title = for_workflow_property(f"{result.name}: {check.name}")
    return f"::{kind} {where}title={title}::{for_workflow(f'{check.message}; {check.reason}')}"


def _time_of(result: CaseResult) -> str:
    """When it was judged, in UTC; empty where its record does not say."""
    return str(result.provenance.get("time", ""))


def citation(result: CaseResult) -> str:
    """A line for a paper: palpate, case, simulator, reference with dolfinx, mesh and day.

    The version of an outside simulator is what it says itself, in quotes: nobody checked it.
    """
    about = result.provenance
    mesh: Mapping[str, Any] = about.get("mesh", {})
    reference: Mapping[str, Any] = about.get("reference", {})
    versions: Mapping[str, Any] = reference.get("versions") or {}
    said = result.candidate_says.get("version")
    simulator = result.candidate + (f" (says version {in_quotes(str(said))})" if said else "")
    libraries = ", ".join(f"{name} {versions[name]}" for name in _LIBRARIES if name in versions)
    built = f", built {reference['date']}" if "date" in reference else ""
    parts = [
        f"palpate {about.get('palpate', 'of unknown version')}, the palpate developers",
        f"case {result.name} (problem {_shortened(about, 'case_key')}, all inputs "
        f"{_shortened(about, 'input_key')})",
        f"simulator {simulator}",
        f"reference FEniCSx, {libraries}{built}" if libraries else "",
        f"mesh of {mesh['num_points']} points and {mesh['num_cells']} tetrahedra, {mesh['origin']}"
        if mesh
        else "",
        f"judged {str(about['time'])[:10]}" if "time" in about else "",
    ]
    return "; ".join(filter(None, parts)) + "."


def _shortened(about: Mapping[str, Any], key: str) -> str:
    return str(about.get(key, "unknown"))[:_KEY]


def discard_outputs(*paths: Path | None, of_gates: bool = False) -> None:
    """Remove the outputs of an earlier run: none is taken for this run's, however it ends.

    Args:
        paths: Files that `require_outputs` has let this run replace; None is left out.
        of_gates: Whether nobody has looked at the paths yet, so that only a file goes that begins
            as the outputs of a gate do: not a case, a mesh or a reference that was named by error.
    """
    for path in filter(None, paths):
        real = Path(os.path.realpath(path))
        with contextlib.suppress(OSError) if of_gates else contextlib.nullcontext():
            if not of_gates or (may_replace(real) and _BEGINS.match(real.read_bytes()[:_HEAD])):
                real.unlink(missing_ok=True)


def write_outputs(
    results: Sequence[CaseResult],
    *,
    json: Path | None = None,
    junit: Path | None = None,
    summary: Path | None = None,
) -> None:
    """Write what was asked for: all files or, where one cannot be written, none of them."""
    makers: dict[Path | None, Callable[[], str]] = {
        json: lambda: results_json(results, version_of("palpate")),
        junit: lambda: junit_xml(results),
        summary: lambda: summary_markdown(results) + side_by_side_markdown(results),
    }
    with contextlib.ExitStack() as files:  # they get their names at its end
        for path, text in makers.items():
            if path is not None:
                files.enter_context(own_path(path)).write_text(text(), encoding="utf-8")
