"""Cards of Abaqus and CalculiX input files, and the nodes, cells, sets and surfaces in them.

A card is a keyword with parameters, and its data lines. Hexahedra, wedges and pyramids, and their
faces, are cut into tetrahedra and triangles.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import FileFormatError
from palpate.meshes.untrusted import open_plain
from palpate.validation.case.geometry import inside_folder
from palpate.validation.importing.model import (
    FACES,
    Source,
    cut_cell,
    cut_face,
    finite,
    whole,
)
from palpate.validation.importing.understood import DATA, Statement

# Most bytes of all files together.
MOST_BYTES = 256 * 1024**2
_DEEPEST = 8
_MOST_FILES = 100
# Most numbers that all sets, surfaces and loads name together: a gigabyte.
_MOST_NAMED = 10_000_000
# So much does CalculiX read of a number: f20.0 in its sources.
_MOST_DIGITS = 20
_PARTS = re.compile(r'\s*("[^"]*"|[^,]*)\s*(?:,|$)')


class Card(Statement):
    """A keyword in capitals without its star, parameters by capital names, and lines of fields."""

    __slots__ = ("keyword", "lines")

    def __init__(self, keyword: str, parameters: dict[str, str], source: Source) -> None:
        super().__init__(source.path, source.line, parameters)
        self.keyword = keyword
        self.lines: list[tuple[Source, list[str]]] = []

    @property
    def name(self) -> str:
        """Its keyword."""
        return self.keyword

    def shown(self, value: str = "") -> str:
        """*KEYWORD, or one of its parameters."""
        return f"*{self.keyword[:40]}" + (f": parameter {value[:40]}" if value else "")

    def refuse_data(self, known: frozenset[str]) -> None:  # noqa: ARG002 - no data alone is known
        """Refuse data lines that nobody asked for; empty ones say nothing."""
        for source, fields in self.lines:
            if any(fields):
                raise source.refuse(f"*{self.keyword}: data that are not known here")

    def label(self, parameter: str) -> str:
        """A parameter that has to be there, as the name of something."""
        return name_of(self.require(parameter))

    def rows(self, least: int, most: int) -> Iterator[tuple[Source, list[str]]]:
        """Its data lines, each with so many fields; empty ones at the end are left out.

        Raises:
            ImportRefusedError: A line of another length.
        """
        self.mark(DATA)
        for source, fields in self.lines:
            while len(fields) > 1 and not fields[-1]:
                fields = fields[:-1]
            if not least <= len(fields) <= most:
                raise source.refuse(
                    f"*{self.keyword}: {len(fields)} field(s) in a line, needs {least} to {most}"
                )
            yield source, fields

    def numbers(self, least: int, most: int) -> Iterator[tuple[Source, list[float]]]:
        """The same as numbers, none of them left out."""
        for source, fields in self.rows(least, most):
            yield source, [number(text, source, f"*{self.keyword}") for text in fields]


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
        # Nothing else ends a line: Python's splitlines would end a comment at an ellipsis too.
        lines = [line.rstrip("\r") for line in data.decode("latin-1").split("\n")]
        for number, text in enumerate(lines, 1):
            line = text.strip()
            if not line or line.startswith("**"):
                continue
            if not line.startswith("*"):
                self._data(path, number, line)
                continue
            card = _card(line, Source(path, number))
            if line.endswith(","):
                raise card.refuse(
                    f"{card.shown()} ends with a comma: for Abaqus it goes on in the next line, "
                    "for CalculiX it does not; write it in one line"
                )
            if card.keyword != "INCLUDE":
                self.cards.append(card)
                continue
            if depth >= _DEEPEST or self.num_files >= _MOST_FILES:
                raise card.refuse("*INCLUDE: files include files without end")
            included = inside_folder(self.folder, card.require("INPUT").strip('"'))
            card.refuse_rest(frozenset())
            self.read(included, depth + 1)

    def _data(self, path: Path, number: int, line: str) -> None:
        if not self.cards:
            raise Source(path, number).refuse(f"data before any keyword: {line[:40]!r}")
        fields = [text.strip() for text in line.split(",")]
        self.cards[-1].lines.append((Source(path, number), fields))


def _card(line: str, source: Source) -> Card:
    words = [m[1].strip() for m in _PARTS.finditer(line[1:]) if m[0]]
    keyword = " ".join(words[0].upper().split()) if words else ""
    if not keyword:
        raise source.refuse("a star without a keyword")
    parameters = {}
    for word in words[1:]:
        name, _, value = word.partition("=")
        key = " ".join(name.upper().split())
        if key in parameters:
            raise source.refuse(f"*{keyword[:40]}: parameter {key[:40]} is there twice")
        if key:
            parameters[key] = value.strip()
    return Card(keyword, parameters, source)


def name_of(text: str) -> str:
    """A name as the programs compare it: in capitals without spaces, or as it is between quotes."""
    word = text.strip()
    return word.strip('"') if word.startswith('"') else "".join(word.upper().split())


def number(text: str, source: Source, what: str) -> float:
    """A number, also one written by Fortran (1.5D-3).

    Raises:
        ImportRefusedError: No number, or one whose value stands beyond 20 characters, which is as
            far as CalculiX reads ("f20.0" in its sources): 1.2345678901234567890e-3 is 1.23 there.
    """
    word = text.strip().replace("D", "E").replace("d", "e")
    value = finite(word, source, what)
    if len(word) > _MOST_DIGITS:
        try:
            is_same = abs(float(word[:_MOST_DIGITS]) - value) <= 1e-12 * abs(value)
        except ValueError:
            is_same = False
        if not is_same:
            raise source.refuse(
                f"{what}: {word[:40]!r} is longer than the {_MOST_DIGITS} characters that CalculiX "
                "reads, and another number there"
            )
    return value


_Found = TypeVar("_Found")
# Element types by nodes; hybrid and modified ones differ in how they solve, not in what.
_TYPES = {
    "C3D4": 4, "C3D4H": 4, "C3D10": 10, "C3D10H": 10, "C3D10M": 10, "C3D10MH": 10, "C3D10HS": 10,
    "C3D10T": 10,
    "C3D8": 8, "C3D8R": 8, "C3D8I": 8, "C3D8H": 8, "C3D8RH": 8, "C3D8IH": 8, "C3D8T": 8,
    "C3D6": 6, "C3D6H": 6, "C3D5": 5, "C3D5H": 5,
}  # fmt: skip


class AbaqusMesh:
    """By the file's own numbers: nodes, cells and named sets of them; names in capitals.

    Attributes:
        tetrahedra: Rows of nodes, of all cells; `row_of` says of each node which row it is.
        kinds: Of each type of element how many there are.
        blocks: Cards of elements, with their numbers.
    """

    def __init__(self, cards: Sequence[Card]) -> None:
        self.nodes: dict[int, tuple[float, float, float]] = {}
        self.cells: dict[int, list[int]] = {}
        self.node_sets: dict[str, list[int]] = {}
        self.cell_sets: dict[str, list[int]] = {}
        self.surfaces: dict[str, list[tuple[int, int]]] = {}
        self.kinds: dict[str, int] = {}
        self.blocks: list[tuple[Card, list[int]]] = []
        self._num_named = 0
        # Sets that others were made of, and the part's name in its assembly.
        self._taken: set[tuple[str, str]] = set()
        # A node or element that a set names twice, by keyword and set.
        self._repeated: dict[tuple[str, str], int] = {}
        self.instance = next((c.label("NAME") for c in cards if c.keyword == "INSTANCE"), "")
        readers = {
            "NODE": self._node,
            "ELEMENT": self._element,
            "NSET": self._set,
            "ELSET": self._set,
            "SURFACE": self._surface,
        }
        # In CalculiX' order (keystart.f), wherever they stand: all nodes, then all elements, ...
        for keyword, read in readers.items():
            for card in (card for card in cards if card.keyword == keyword):
                read(card)
        self.row_of = {label: row for row, label in enumerate(self.nodes)}
        self._rows_of: dict[int, range] = {}
        self.tetrahedra: list[tuple[int, ...]] = []
        for label, nodes in self.cells.items():
            rows = [self.row_of[node] for node in nodes]
            begin = len(self.tetrahedra)
            self.tetrahedra += [tuple(rows)] if len(rows) in (4, 10) else cut_cell(rows)
            self._rows_of[label] = range(begin, len(self.tetrahedra))

    def rows_of(self, cells: Collection[int]) -> list[int]:
        """Tetrahedra of cells, numbered from 0."""
        return [row for cell in cells for row in self._rows_of[cell]]

    def notes(self) -> list[str]:
        """What was cut, in words."""
        return [
            f"{count} cells of type {kind} are cut into tetrahedra: the same body where faces are "
            "flat, on another mesh"
            for kind, count in self.kinds.items()
            if _TYPES[kind] not in (4, 10)
        ]

    def _node(self, card: Card) -> None:
        card.require_usual(
            "SYSTEM", "R", reason="coordinates in another system; write them in x, y, z"
        )
        new = []
        for source, fields in card.rows(1, 4):
            label = whole(fields[0], source, "*NODE")
            # What is left out is 0.
            given = [*fields[1:4], "", "", ""][:3]
            x, y, z = (number(text or "0", source, "*NODE") for text in given)
            if self.nodes.setdefault(label, (x, y, z)) != (x, y, z):
                raise source.refuse(f"node {label} is there twice, at different positions")
            new.append(label)
        if card.get("NSET") is not None:
            name = card.label("NSET")
            self.node_sets[name] = list(dict.fromkeys([*self.node_sets.get(name, []), *new]))

    def _element(self, card: Card) -> None:
        card.mark(DATA)
        kind = card.label("TYPE")
        if kind not in _TYPES:
            raise card.refuse(
                f"*ELEMENT, TYPE={kind[:20]}: a case has tetrahedra: C3D4 and C3D10, and C3D8, "
                "C3D6 and C3D5, which can be cut into them"
            )
        count, new = _TYPES[kind], []
        # A cell of ten nodes may go on in the next line.
        words: list[str] = []
        for source, fields in card.lines:
            goes_on = not fields[-1]
            words += fields[:-1] if goes_on else fields
            if len(words) < 1 + count and goes_on:
                continue
            if len(words) != 1 + count:
                raise source.refuse(f"an element of type {kind} needs {count} nodes")
            label, *nodes = (whole(text, source, "*ELEMENT") for text in words)
            if label in self.cells:
                raise source.refuse(f"element {label} is there twice")
            self.cells[label] = nodes
            new.append(label)
            for node in nodes:
                if node not in self.nodes:
                    raise source.refuse(f"element {label}: no node {node}")
            words = []
        if words:
            raise card.refuse("an element is cut off")
        self.kinds[kind] = self.kinds.get(kind, 0) + len(new)
        self.blocks.append((card, new))
        if card.get("ELSET") is not None:
            self.cell_sets.setdefault(card.label("ELSET"), []).extend(new)

    def _set(self, card: Card) -> None:
        is_of_nodes = card.keyword == "NSET"
        sets = self.node_sets if is_of_nodes else self.cell_sets
        known: Collection[int] = self.nodes if is_of_nodes else self.cells
        name = card.label(card.keyword)
        if name_of(card.word("INSTANCE", self.instance)) != self.instance:
            raise card.refuse(f"no part {card.word('INSTANCE')[:40]} in the assembly")
        if (card.keyword, name) in self._taken:
            raise card.refuse(
                f"set {name[:40]} grows after another was made of it; programs differ in what that "
                "one has: put this above"
            )
        card.mark(DATA)
        is_range = card.get("GENERATE") is not None
        found = dict.fromkeys(sets.get(name, []))

        def add(labels: Sequence[int], source: Source) -> None:
            twice = next((label for label in self._counted(labels, source) if label in found), None)
            if twice is not None:
                self._repeated[card.keyword, name] = twice
            found.update(dict.fromkeys(labels))

        for source, fields in card.lines:
            if is_range:
                add(_generated(source, fields, f"*{card.keyword}", len(known)), source)
                continue
            for text in fields:
                if not text:
                    continue
                labels = self._labels(text, source, f"*{card.keyword}", sets)
                other = (card.keyword, self._own_name(text))
                self._taken.add(other)
                if other in self._repeated:
                    self._repeated[card.keyword, name] = self._repeated[other]
                add(labels, source)
        for label in found:
            if label not in known:
                raise card.refuse(f"*{card.keyword} names {label}, which is not there")
        sets[name] = list(found)

    def _counted(self, labels: Sequence[int], source: Source) -> Sequence[int]:
        """Numbers that a line names, as long as all lines together do not name too many."""
        self._num_named += len(labels)
        if self._num_named > _MOST_NAMED:
            raise source.refuse(
                f"sets, surfaces and loads name more than {_MOST_NAMED} nodes and elements up to "
                "here; name each set once"
            )
        return labels

    def _surface(self, card: Card) -> None:
        name = card.label("NAME")
        card.require_usual("TYPE", "ELEMENT", reason="points have no area; give faces of elements")
        if name in self.surfaces:
            raise card.refuse(f"surface {name} is there twice")
        faces = []
        for source, fields in card.rows(1, 2):
            if len(fields) < 2 or not fields[1]:
                raise source.refuse("*SURFACE: needs a face, S1 to S6, after the element or set")
            faces += self.faces_of(fields[0], fields[1], "S", source)
        self.surfaces[name] = faces

    def faces_of(self, text: str, face: str, letter: str, source: Source) -> list[tuple[int, int]]:
        """Of a cell or a set of them, with the number of the face: S1 or P1 to 6.

        Raises:
            ImportRefusedError: No face of one of them.
        """
        word, cells = face.strip().upper(), self.cells_of(text, source)
        self.require_once("ELSET", text, source)
        number = int(word[1]) if len(word) == 2 and word[1] in "123456" else 0
        for cell in cells:
            count = len(self.cells[cell])
            most = len(FACES[count])
            if word[:1] != letter or not 1 <= number <= most:
                raise source.refuse(
                    f"{word[:20]!r} is no face of a cell of {count} nodes: {letter}1 to "
                    f"{letter}{most}"
                )
        return [(cell, number) for cell in cells]

    def cells_of(self, text: str, source: Source) -> list[int]:
        """Numbers of a cell or a set of them."""
        labels = self._labels(text, source, "element", self.cell_sets, self.cells)
        return list(self._counted(labels, source))

    def nodes_of(self, text: str, source: Source) -> list[int]:
        """Numbers of a node or a set of them."""
        labels = self._labels(text, source, "node", self.node_sets, self.nodes)
        return list(self._counted(labels, source))

    def require_once(self, keyword: str, text: str, source: Source) -> None:
        """Refuse a load on a set, of the card NSET or ELSET, that names one of its own twice."""
        twice = self._repeated.get((keyword, self._own_name(text)))
        if twice is not None:
            what = "node" if keyword == "NSET" else "element"
            raise source.refuse(
                f"set {text.strip()[:40]} names {what} {twice} twice, and CalculiX loads it twice, "
                "Abaqus once; name it once"
            )

    def _own_name(self, text: str) -> str:
        return name_of(text).removeprefix(f"{self.instance}.")

    def _labels(
        self,
        text: str,
        source: Source,
        what: str,
        sets: dict[str, list[int]],
        known: Collection[int] | None = None,
    ) -> list[int]:
        """One number, which has to be known where that is asked for, or those of a set."""
        word = name_of(text)
        if not word:
            raise source.refuse(f"{what}: an empty field")
        if word.lstrip("+-").isdigit():
            label = whole(word, source, what)
            if known is not None and label not in known:
                raise source.refuse(f"no {what} {label}")
            return [label]
        return self.named(sets, text, source, "set")

    def named(self, among: dict[str, _Found], text: str, source: Source, what: str) -> _Found:
        """A set or a surface by its name, before which its part's may stand.

        Raises:
            ImportRefusedError: There is none.
        """
        name = name_of(text)
        if name not in among and self.instance:
            name = name.removeprefix(f"{self.instance}.")
        if name not in among:
            known = ", ".join(list(among)[:8]) or "none"
            raise source.refuse(f"no {what} {name[:40]!r} (known: {known})")
        return among[name]

    def facets(self, faces: list[tuple[int, int]]) -> NDArray[np.int64]:
        """Faces of cells as rows of corner nodes, seen from outside counter-clockwise."""
        rows: list[tuple[int, ...]] = []
        for cell, number in faces:
            nodes = [self.row_of[node] for node in self.cells[cell]]
            rows += cut_face([nodes[k] for k in FACES[len(nodes)][number - 1]])
        return np.array(rows, dtype=np.int64).reshape(-1, 3)

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        """Nodes, corners and middle nodes; -1 where a cell has none."""
        rows = self.tetrahedra
        middles = [row[4:] or (-1,) * 6 for row in rows]
        return (
            np.array(list(self.nodes.values()), dtype=np.float64).reshape(-1, 3),
            np.array([row[:4] for row in rows], dtype=np.int64).reshape(-1, 4),
            np.array(middles, dtype=np.int64).reshape(-1, 6),
        )


def _generated(source: Source, fields: list[str], what: str, most: int) -> range:
    words = [text for text in fields if text]
    if len(words) not in (2, 3):
        raise source.refuse(f"{what}, GENERATE: needs first, last and step")
    first, last, *rest = (whole(text, source, what) for text in words)
    step = rest[0] if rest else 1
    labels = range(first, last + 1, max(step, 1))
    if step < 1 or not labels:
        raise source.refuse(f"{what}, GENERATE: {first} to {last} by {step} is no range")
    if (last - first) // step >= most:
        raise source.refuse(
            f"{what}, GENERATE: {first} to {last} by {step} names more than the {most} that the "
            "file lists up to here"
        )
    return labels
