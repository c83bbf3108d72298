"""The page of the paper's equations: formula, file, line, test, and the source itself.

`equations.toml` names files and functions; the lines are found here, so that none is typed.
"""

from __future__ import annotations

import ast
import html
import re
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from making.look_up import table

ROOT = Path(__file__).parents[3]
# Of a definition more lines than these are not shown.
SHOWN = 45


@dataclass(frozen=True)
class Location:
    """A definition: its file, its name, and the lines from first to last, counted from 1."""

    path: str
    name: str
    first: int
    last: int

    @property
    def short(self) -> str:
        """File and line."""
        return f"{Path(self.path).name}:{self.first}"

    def source(self) -> str:
        """Its text; the end is left out where it is long."""
        lines = (ROOT / self.path).read_text("utf-8").splitlines()
        first = self.first - 1
        while first and lines[first - 1].lstrip().startswith("///"):
            first -= 1
        lines = textwrap.dedent("\n".join(lines[first : self.last])).splitlines()
        if len(lines) <= SHOWN:
            return "\n".join(lines)
        comment = "#" if self.path.endswith(".py") else "//"
        left = len(lines) - SHOWN
        return "\n".join([*lines[:SHOWN], f"{comment} ... and {left} lines more"])


def find(words: str) -> Location:
    """The place that "path name" speaks of; LookupError where the file defines no such name."""
    path, name = words.split()
    lines = (ROOT / path).read_text("utf-8").splitlines()
    span = _in_python if path.endswith(".py") else _in_cpp
    for first, last in span(lines, name):
        return Location(path, name, first, last)
    raise LookupError(f"{path} defines no {name}")


def written_out(declared: Location) -> Location | None:
    """Where the function that a C++ header declares is written out, in the .cpp beside it."""
    source = (ROOT / declared.path).with_suffix(".cpp")
    lines = (ROOT / declared.path).read_text("utf-8").splitlines()
    if not lines[declared.last - 1].endswith(";") or not source.is_file():
        return None
    path = str(source.relative_to(ROOT))
    spans = _in_cpp(source.read_text("utf-8").splitlines(), declared.name)
    return next((Location(path, declared.name, *span) for span in spans), None)


def _in_python(lines: list[str], name: str) -> Iterator[tuple[int, int]]:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    for node in ast.walk(ast.parse("\n".join(lines))):
        if isinstance(node, kinds) and node.name == name:
            yield node.lineno, node.end_lineno or node.lineno


def _in_cpp(lines: list[str], name: str) -> Iterator[tuple[int, int]]:
    of_type = rf"(class|struct|enum class) {name}\b"
    of_function = rf"^(inline |\[\[.*\]\] )?[\w:<>,&* ]+[ &*](\w+::)?{name}\("
    defined = re.compile(f"{of_type}|{of_function}")
    for start, line in enumerate(lines):
        if not defined.search(line):
            continue
        depth = 0
        for number in range(start, len(lines)):
            code = lines[number].partition("//")[0]
            depth += code.count("{") - code.count("}")
            if (depth == 0 and ("}" in code or code.rstrip().endswith(";"))) or depth < 0:
                yield start + 1, number + 1
                break


def read_list(path: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Equations and sections of the list."""
    entries = tomllib.loads(path.read_text("utf-8"))
    return entries["equation"], entries["section"]


def equations(path: Path) -> str:
    """The page, in Markdown."""
    of_equations, of_sections = read_list(path)
    parts = [
        "# Where the paper's equations stand\n",
        'Yan, Gu, Huang, Lv, Yu, Kong, "Soft Tissue Deformation Simulation in Virtual Surgery '
        'using Nonlinear Finite Element Method" (2007). fastsim writes every equation by hand; '
        "the reference has its own from UFL and shares no code with it. Files, lines and sources "
        "were read from the code when this page was made.\n",
        table(
            ("eq.", "what", "fastsim", "reference", "held by"),
            [_row(entry, "eq") for entry in of_equations],
        ),
        "\nThe sections beside the equations:\n",
        table(
            ("section", "what", "fastsim", "held by"),
            [_row(entry, "section", reference=False) for entry in of_sections],
        ),
        *(_entry(entry, "eq", "Equation") for entry in of_equations),
        *(_entry(entry, "section", "Section") for entry in of_sections),
    ]
    return "\n".join(parts)


def _anchor(entry: Mapping[str, Any], kind: str) -> str:
    return f"{kind}-{entry['number'].lower()}"


def _row(entry: Mapping[str, Any], kind: str, *, reference: bool = True) -> list[str]:
    def short(words: list[str]) -> str:
        return "<br>".join(f"`{find(one).short}`" for one in words) or "-"

    cells = [entry["number"], f"[{entry['title']}](#{_anchor(entry, kind)})"]
    cells.append(short(entry["fastsim"]))
    if reference:
        cells.append(short(entry["reference"]))
    return [*cells, short([entry["held_by"]])]


def _entry(entry: Mapping[str, Any], kind: str, called: str) -> str:
    parts = [f"({_anchor(entry, kind)})=\n## {called} {entry['number']}: {entry['title']}\n"]
    if "formula" in entry:
        parts.append(f"$$\n{entry['formula']}\n$$\n")
    parts.append(f"{entry['says']}\n")
    for who, words in (
        ("fastsim", entry["fastsim"]),
        ("reference", entry.get("reference", [])),
        ("held by", [entry["held_by"]]),
    ):
        for location in map(find, words):
            body = written_out(location)
            parts += [_folded(who, one) for one in (location, body) if one is not None]
    return "\n".join(parts)


def _folded(who: str, location: Location) -> str:
    language = "python" if location.path.endswith(".py") else "cpp"
    summary = html.escape(f"{location.path}:{location.first}"), html.escape(location.name)
    return (
        f'<details class="source"><summary>{who}: <code>{summary[0]}</code> '
        f"<code>{summary[1]}</code></summary>\n\n"
        f"```{language}\n{location.source()}\n```\n\n</details>\n"
    )
