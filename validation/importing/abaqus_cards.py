"""The cards of an Abaqus or CalculiX input file: a keyword with parameters, and its data lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from palpate.meshes.errors import FileFormatError
from palpate.meshes.untrusted_text import open_plain
from palpate.validation.case.geometry import inside_folder
from palpate.validation.importing.model import ImportRefusedError, Place, finite, whole

# Of all files together.
MOST_BYTES = 256 * 1024**2
_DEEPEST = 8
_MOST_FILES = 100
_PARTS = re.compile(r'\s*("[^"]*"|[^,]*)\s*(?:,|$)')


@dataclass(eq=False)
class Card:
    """A keyword in capitals without its star, parameters by capital names, and lines of fields."""

    keyword: str
    parameters: dict[str, str]
    place: Place
    lines: list[tuple[Place, list[str]]] = field(default_factory=list)

    def refuse(self, reason: str) -> ImportRefusedError:
        """The error that names its line."""
        return self.place.refuse(reason)

    def only(self, *names: str) -> None:
        """Refuse parameters beside these."""
        for name in self.parameters:
            if name not in names:
                known = ", ".join(names) or "none"
                raise self.refuse(
                    f"*{self.keyword}: parameter {name[:40]} is not known here (known: {known})"
                )

    def require(self, name: str) -> str:
        """A parameter that has to be there, in capitals."""
        if not self.parameters.get(name):
            raise self.refuse(f"*{self.keyword} needs the parameter {name}=...")
        return self.parameters[name].upper()

    def numbers(self) -> list[float]:
        """All fields of its data lines as numbers; empty ones are left out."""
        return [
            finite(text, place, f"*{self.keyword}")
            for place, fields in self.lines
            for text in fields
            if text
        ]

    def rows(self, least: int, most: int) -> Iterator[tuple[Place, list[str]]]:
        """Its data lines, each with so many fields; empty ones at the end are left out.

        Raises:
            ImportRefusedError: A line of another length.
        """
        for place, fields in self.lines:
            while len(fields) > 1 and not fields[-1]:
                fields = fields[:-1]
            if not least <= len(fields) <= most:
                raise place.refuse(
                    f"*{self.keyword}: {len(fields)} field(s) in a line, needs {least} to {most}"
                )
            yield place, fields


def read_cards(path: Path) -> list[Card]:
    """The cards of a file and of those it includes, which lie in its folder.

    Raises:
        FileFormatError: A file that cannot be opened, or is not text.
        ImportRefusedError: A data line without a keyword, or files that include each other.
    """
    cards: list[Card] = []
    _Reader(path.parent, cards).read(path, 0)
    return cards


class _Reader:
    def __init__(self, folder: Path, cards: list[Card]) -> None:
        self.folder, self.cards, self.left, self.num_files = folder, cards, MOST_BYTES, 0

    def read(self, path: Path, depth: int) -> None:
        self.num_files += 1
        with open_plain(path, most_bytes=self.left) as stream:
            data = stream.read()
        self.left -= len(data)
        if b"\x00" in data:
            raise FileFormatError(path, "is no text (it holds a zero byte)")
        lines = data.decode("latin-1").splitlines()
        number = 0
        while number < len(lines):
            start = number + 1
            line = lines[number].strip()
            number += 1
            if not line or line.startswith("**"):
                continue
            if not line.startswith("*"):
                self._data(path, start, line)
                continue
            while line.endswith(",") and number < len(lines):
                line += lines[number].strip()
                number += 1
            card = _card(line, Place(path, start))
            if card.keyword != "INCLUDE":
                self.cards.append(card)
                continue
            if depth >= _DEEPEST or self.num_files >= _MOST_FILES:
                raise card.refuse("*INCLUDE: files include files without end")
            card.only("INPUT")
            if not card.parameters.get("INPUT"):
                raise card.refuse("*INCLUDE needs the parameter INPUT=...")
            self.read(inside_folder(self.folder, card.parameters["INPUT"]), depth + 1)

    def _data(self, path: Path, number: int, line: str) -> None:
        if not self.cards:
            raise Place(path, number).refuse(f"data before any keyword: {line[:40]!r}")
        fields = [text.strip() for text in line.split(",")]
        self.cards[-1].lines.append((Place(path, number), fields))


def _card(line: str, place: Place) -> Card:
    words = [m[1].strip() for m in _PARTS.finditer(line[1:]) if m[0]]
    keyword = " ".join(words[0].upper().split()) if words else ""
    if not keyword:
        raise place.refuse("a star without a keyword")
    parameters = {}
    for word in words[1:]:
        name, _, value = word.partition("=")
        if name.strip():
            parameters[name.strip().upper()] = value.strip().strip('"')
    return Card(keyword, parameters, place)


def label_of(text: str, place: Place, what: str) -> int | str:
    """A number of a node or cell, or the name of a set in capitals, without its instance."""
    word = text.strip().strip('"')
    if not word:
        raise place.refuse(f"{what}: an empty field")
    if word.lstrip("+-").isdigit():
        return whole(word, place, what)
    return word.upper().rpartition(".")[2] or word.upper()
