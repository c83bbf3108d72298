"""What of a model was understood, what is left out, and the refusal of all the rest.

A card and a tag are alike: values by name, and more below. Reading one marks what it was asked for.
What nobody asked for is looked up in its format's table of what changes no equilibrium, each row
with the section of the manual that says so; what is not there either is refused with its line.
"""

from __future__ import annotations

import functools
import itertools
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path

from palpate.validation.importing.model import ImportRefusedError, Source

# Of a card or a tag, names that may be there: NAME, or NAME=VALUE for that value alone, `#` for the
# text or the data lines, `#=TEXT` for that text alone, `*` for everything in it.
Harmless = Mapping[str, frozenset[str]]
DATA, ALL = "#", "*"
_NONE: frozenset[str] = frozenset()
# A million tags have few different sets of names between them.
_ALIKE: dict[tuple[str, ...], tuple[str, ...]] = {}


@functools.cache
def harmless(program: str) -> Harmless:
    """The table of a format, by cards, or by tags as parent/tag.

    Raises:
        ValueError: A row without a source, or one thing in two rows.
    """
    file = resources.files("palpate.validation.importing") / "harmless.toml"
    found: dict[str, frozenset[str]] = {}
    for row in tomllib.loads(file.read_text("utf-8"))[program]:
        places = itertools.product(_listed(row.get("of", "")), _listed(row["in"]))
        for place in ("/".join(words).lstrip("/") for words in places):
            if place in found or not row["source"]:
                raise ValueError(f"{file}: {place} is there twice, or without a source")
            found[place] = frozenset(_listed(row["harmless"]))
    return found


def _listed(words: str) -> list[str]:
    return [" ".join(word.split()) for word in words.split(",")]


class Statement(ABC):
    """A card or a tag: values by name, and which of them the reader has asked for.

    `read` is None as long as nobody has looked at it at all.
    """

    __slots__ = ("line", "path", "read", "values")

    def __init__(self, path: Path, line: int, values: dict[str, str]) -> None:
        self.path, self.line, self.values = path, line, values
        self.read: tuple[str, ...] | None = None

    @property
    def source(self) -> Source:
        """Its file and line."""
        return Source(self.path, self.line)

    def refuse(self, reason: str) -> ImportRefusedError:
        """The error that names its line."""
        return ImportRefusedError(self.path, self.line, reason)

    @property
    @abstractmethod
    def name(self) -> str:
        """Its tag or keyword."""

    @abstractmethod
    def shown(self, value: str = "") -> str:
        """How it, or one of its values, stands in the file."""

    def below(self) -> Iterable[Statement]:
        """The tags in a tag."""
        return ()

    @abstractmethod
    def refuse_data(self, known: frozenset[str]) -> None:
        """Refuse text or data lines that are there and not harmless."""

    def mark(self, name: str | None = None) -> None:
        """It is understood; so is the value of that name."""
        seen = self.read or ()
        if name is not None and name not in seen:
            seen = (*seen, name)
        self.read = _ALIKE.setdefault(seen, seen)

    def get(self, name: str, default: str | None = None) -> str | None:
        """A value, which then counts as understood, or else the default."""
        self.mark(name)
        return self.values.get(name, default)

    def word(self, name: str, default: str = "") -> str:
        """The same, where there is a default."""
        self.mark(name)
        return self.values.get(name, default)

    def require(self, name: str) -> str:
        """A value that has to be there."""
        if not self.values.get(name):
            raise self.refuse(f"{self.shown()} needs {name}=...")
        return self.word(name)

    def require_usual(self, name: str, *usual: str, reason: str) -> None:
        """Refuse a value that is there and none of these, in small or capital letters."""
        found = self.word(name, usual[0])
        if found.upper() not in (word.upper() for word in usual):
            raise self.refuse(f"{self.shown(name)} is {found[:40]!r}: {reason}")

    def refuse_rest(self, known: frozenset[str]) -> None:
        """Refuse what nobody asked for and what is not harmless.

        Raises:
            ImportRefusedError: With its line.
        """
        for name, value in self.values.items():
            if name in (self.read or ()) or name in known or f"{name}={value}" in known:
                continue
            raise self.refuse(f"{self.shown(name)} is not known here; it may change the mechanics")


def left_out(statements: Iterable[Statement], known: Harmless, parent: str = "") -> list[str]:
    """Lines of what was left out because no equilibrium depends on it; all the rest is refused.

    Raises:
        ImportRefusedError: What was neither understood nor is in the table, with its line.
    """
    found = []
    for statement in statements:
        place = f"{parent}/{statement.name}" if parent else statement.name
        names = known.get(place, _NONE)
        if statement.read is None:
            if place not in known:
                where = f"{statement.shown()} in <{parent}>" if parent else statement.shown()
                raise statement.refuse(
                    f"{where} is not known here: it may change the mechanics, so nothing is "
                    "imported; take it out if it does not matter"
                )
            found.append(f"line {statement.line} {statement.shown()}")
        if ALL in names:
            continue
        statement.refuse_rest(names)
        if DATA not in names and DATA not in (statement.read or ()):
            statement.refuse_data(names)
        more = left_out(statement.below(), known, statement.name)
        if statement.read is not None:
            found += more
    return found
