"""Quotes texts of others in what palpate writes: one function for each kind of output.

Titles, reasons and names come from case files, last lines and `about` from simulators. None of them
may move a cursor, start a workflow command, turn the reading direction, end a table cell, break
XML or be run by a spreadsheet. Invisible characters are shown as escapes, so that nothing is lost.
What is passed on (everything but a terminal) names files without the folders of this machine.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import os
import re
import sys
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

# Controls, formats (reading direction among them), surrogates, line separators.
_HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
# Joiners, without which Persian, Hindi and others cannot be written.
_NEEDED = "\u200c\u200d"
# An absolute path of two names or more, or with a drive; no part of an address (https://...).
_ABSOLUTE = re.compile(
    r"""(?<![\w.:/~\\-])(?:[A-Za-z]:(?=[\\/]))?(?:[\\/][^\s\\/'"`<>|,;:()\[\]{}=]+)+[\\/]"""
    r"""(?=[^\s\\/'"`<>|,;:()\[\]{}=])"""
)
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


def without_folders(text: str) -> str:
    """Text in which files are named as seen from the working folder, or by their names alone."""
    if "/" not in text and "\\" not in text:
        return text
    home = os.path.expanduser("~")  # noqa: PTH111
    here = {os.environ.get("PWD", ""), str(Path(sys.executable).parent)}
    with contextlib.suppress(OSError):  # it was removed
        here.add(str(Path.cwd()))
    known = [*((folder, "", ".") for folder in here), (home, "~/", "~")]
    for folder, inside, alone in sorted(known, key=lambda each: -len(each[0])):
        if os.path.isabs(folder) and len(folder) > 1:  # noqa: PTH117
            named = re.escape(folder.rstrip("\\/"))
            text = re.sub(named + r"[\\/]+(?=[^\s\\/'\"])", inside, text)
            text = re.sub(named + r"[\\/]*(?![\w.-])", alone, text)
    return _ABSOLUTE.sub("", text)


def for_terminal(text: str) -> str:
    """One line for a terminal and the log of a CI: no escapes, no workflow commands.

    GitHub reads `::name::` at the start of a line, where a narrow table may put any word, and
    `##[name]` anywhere; other systems read `##name[`.
    """
    return re.sub(r"##(?=\w*\[)", "# #", visible(text).replace("::", ": :"))


def for_terminal_lines(text: str) -> str:
    """Text in which line breaks are wanted, each line as in `for_terminal`."""
    return "\n".join(for_terminal(line) for line in text.split("\n"))


def for_html(value: Any) -> Any:
    """Text for a template, which escapes it; line breaks stay. Other values are unchanged."""
    if type(value) is not str:
        return value
    return "\n".join(map(visible, without_folders(value).split("\n")))


def for_markdown(text: str) -> str:
    """Text for a cell of a Markdown table: without HTML, cell ends, links or pictures."""
    return re.sub(r"[&<>|`\\\[\]]", lambda c: f"&#{ord(c[0])};", visible(without_folders(text)))


def for_xml(text: str) -> str:
    """Text that XML allows; whoever writes it has to escape it."""
    return visible(without_folders(text))


def for_workflow(text: str) -> str:
    """Text for the message of a GitHub workflow command."""
    text = without_folders(text).replace("%", "%25")
    return "%0A".join(visible(line) for line in text.splitlines())


def for_workflow_property(text: str) -> str:
    """Text for a property of a GitHub workflow command, such as its file or title."""
    return for_workflow(text).replace(":", "%3A").replace(",", "%2C")


def for_csv(value: Any) -> Any:
    """A cell of a CSV table: text that a spreadsheet would run gets an apostrophe."""
    if not isinstance(value, str):
        return value
    text = visible(without_folders(value))
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
    """Plain data for strict JSON: None for NaN and infinities, and no surrogates."""

    def plain(single: Any) -> Any:
        if isinstance(single, str):
            text = single.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
            return without_folders(text)
        return None if isinstance(single, float) and not math.isfinite(single) else single

    return _each(value, plain)


def texts_for_json(value: Any) -> Any:
    """Plain data for JSON, in which numbers that are none stay an error."""
    return _each(value, lambda single: for_json(single) if isinstance(single, str) else single)


def _each(value: Any, change: Callable[[Any], Any]) -> Any:
    """Plain data with each single value and key changed."""
    if isinstance(value, Mapping):
        return {str(change(str(key))): _each(item, change) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_each(item, change) for item in value]
    return change(value)


def in_quotes(text: str) -> str:
    """Put somebody else's words in quotation marks, for a sentence of palpate's."""
    cut = text if len(text) <= _MOST_WORDS else text[:_MOST_WORDS] + "..."
    return '"' + visible(cut.replace("\\", "\\\\").replace('"', '\\"')) + '"'


def own_words(name: str, said: Mapping[str, Any]) -> str:
    """A sentence that quotes what a candidate says of itself; "" where it says nothing."""
    parts = [f"{in_quotes(key)}: {in_quotes(str(value))}" for key, value in said.items()]
    if len(parts) > _MOST_KEYS:
        parts = [*parts[:_MOST_KEYS], f"and {len(parts) - _MOST_KEYS} more"]
    return f"{visible(name)} says of itself, unchecked: {', '.join(parts)}." if parts else ""


def listed(title: str, lines: Iterable[tuple[str, str]]) -> str:
    """A list for --help, in which each entry stays on its own line."""
    rows = [(name, about) for name, about in lines]
    width = max(len(name) for name, _ in rows)
    return "\n".join([f"\b\n{title}", *(f"  {name:{width}}  {about}" for name, about in rows)])
