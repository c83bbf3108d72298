"""Words of others in what palpate writes: one function for each kind of output.

Titles, reasons and names come from case files, last lines and `about` from simulators. None of it
may move a cursor, start a workflow command, turn the reading direction, end a table cell, break
XML or be run by a spreadsheet. What cannot be seen is shown as an escape, so that nothing is lost.
"""

from __future__ import annotations

import csv
import io
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

# Controls, formats (reading direction among them), halves of characters, line separators.
_HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
# Joiners that Persian, Hindi and others cannot be written without.
_NEEDED = "\u200c\u200d"
_MOST_WORDS = 200
_MOST_KEYS = 12


def visible(text: str) -> str:
    """One line in which every character can be seen: hidden ones as escapes."""
    return "".join(_shown(c) for c in re.sub(r"[\t\n\r]+", " ", text))


def _shown(character: str) -> str:
    number = ord(character)
    is_none = number & 0xFFFE == 0xFFFE or 0xFDD0 <= number <= 0xFDEF
    if character in _NEEDED or not (is_none or unicodedata.category(character) in _HIDDEN):
        return character
    return f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}"


def for_terminal(text: str) -> str:
    """One line for a terminal and the log of a CI: no escapes, no workflow commands.

    GitHub takes `::name::` at the start of a line, which a narrow table may make of any place, and
    `##[name]` anywhere; others `##name[`.
    """
    return re.sub(r"##(?=\w*\[)", "# #", visible(text).replace("::", ": :"))


def for_terminal_lines(text: str) -> str:
    """Lines that are meant as such, each as in `for_terminal`."""
    return "\n".join(for_terminal(line) for line in text.split("\n"))


def for_html(value: Any) -> Any:
    """Text for a template, which escapes it; its lines stay. Everything else as it is."""
    return "\n".join(map(visible, value.split("\n"))) if type(value) is str else value


def for_markdown(text: str) -> str:
    """Text for a cell of a Markdown table: no HTML, no end of the cell, no links or pictures."""
    return re.sub(r"[&<>|`\\\[\]]", lambda c: f"&#{ord(c[0])};", visible(text))


def for_xml(text: str) -> str:
    """Text that XML allows, to be escaped by whoever writes it."""
    return visible(text)


def for_workflow(text: str) -> str:
    """Message of a GitHub workflow command."""
    return "%0A".join(visible(line) for line in text.replace("%", "%25").splitlines())


def for_workflow_property(text: str) -> str:
    """Property of a GitHub workflow command: its file, its title."""
    return for_workflow(text).replace(":", "%3A").replace(",", "%2C")


def for_csv(value: Any) -> Any:
    """A cell of a table: text that a spreadsheet would run gets an apostrophe; numbers stay."""
    if not isinstance(value, str):
        return value
    text = visible(value)
    if not text.lstrip().startswith(("=", "+", "-", "@")) and not value.startswith(("\t", "\r")):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def csv_text(columns: Sequence[str], rows: Iterable[Iterable[Any]]) -> str:
    """A table as CSV, each cell as in `for_csv`."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([for_csv(cell) for cell in row] for row in (columns, *rows))
    return stream.getvalue()


def for_json(value: Any) -> Any:
    """Plain data for strict JSON: None for numbers that are none, no halves of characters."""
    if isinstance(value, Mapping):
        return {str(for_json(str(key))): for_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [for_json(item) for item in value]
    if isinstance(value, str):
        return value.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    return None if isinstance(value, float) and not math.isfinite(value) else value


def in_quotes(text: str) -> str:
    """The words of somebody else within a sentence of ours."""
    cut = text if len(text) <= _MOST_WORDS else text[:_MOST_WORDS] + "..."
    return '"' + visible(cut.replace("\\", "\\\\").replace('"', '\\"')) + '"'


def own_words(name: str, said: Mapping[str, Any]) -> str:
    """What a candidate says of itself, as its words, in a sentence; empty where that is nothing."""
    parts = [f"{in_quotes(key)}: {in_quotes(str(value))}" for key, value in said.items()]
    if len(parts) > _MOST_KEYS:
        parts = [*parts[:_MOST_KEYS], f"and {len(parts) - _MOST_KEYS} more"]
    return f"{visible(name)} says of itself, unchecked: {', '.join(parts)}." if parts else ""
