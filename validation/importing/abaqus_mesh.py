"""Cards of Abaqus and CalculiX input files, and the nodes, cells, sets and surfaces in them.

A card is a keyword with parameters, and its data lines. Hexahedra, wedges and pyramids, and their
faces, are cut into tetrahedra and triangles.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import FileFormatError
from palpate.meshes.untrusted import open_plain
from palpate.validation.case.geometry import inside_folder
from palpate.validation.importing.model import (
    FACES,
    ImportRefusedError,
    Source,
    cut_cell,
    cut_face,
    finite,
    whole,
)

# Most bytes of all files together.
MOST_BYTES = 256 * 1024**2
_DEEPEST = 8
_MOST_FILES = 100
# Most numbers that all sets, surfaces and loads name together: a gigabyte.
_MOST_NAMED = 10_000_000
_PARTS = re.compile(r'\s*("[^"]*"|[^,]*)\s*(?:,|$)')
# The parameters of each keyword that are read, or that change no mechanics.
_PARAMETERS = {
    "INCLUDE": ("INPUT",),
    "NODE": ("NSET", "SYSTEM"),
    "ELEMENT": ("TYPE", "ELSET"),
    "NSET": ("NSET", "GENERATE", "UNSORTED", "INSTANCE", "INTERNAL"),
    "ELSET": ("ELSET", "GENERATE", "UNSORTED", "INSTANCE", "INTERNAL"),
    "SURFACE": ("NAME", "TYPE", "INTERNAL"),
    "MATERIAL": ("NAME",),
    "ELASTIC": ("TYPE",),
    "DENSITY": (),
    "SOLID SECTION": ("ELSET", "MATERIAL", "CONTROLS"),
    "AMPLITUDE": ("NAME", "TIME", "VALUE", "DEFINITION", "SMOOTH"),
    "STEP": (
        "NLGEOM", "INC", "INCF", "NAME", "AMPLITUDE", "UNSYMM", "EXTRAPOLATION", "SOLVER",
        "CONVERT SDI",
    ),
    "STATIC": ("SOLVER", "DIRECT", "TIME RESET", "TOTAL TIME AT START"),
    "BOUNDARY": ("OP", "AMPLITUDE", "TYPE", "FIXED", "LOAD CASE"),
    "CLOAD": ("OP", "AMPLITUDE", "LOAD CASE"),
    "DLOAD": ("OP", "AMPLITUDE", "LOAD CASE"),
    "DSLOAD": ("OP", "AMPLITUDE"),
}  # fmt: skip


@dataclass(eq=False)
class Card:
    """A keyword in capitals without its star, parameters by capital names, and lines of fields."""

    keyword: str
    parameters: dict[str, str]
    source: Source
    lines: list[tuple[Source, list[str]]] = field(default_factory=list)

    def refuse(self, reason: str) -> ImportRefusedError:
        """The error that names its line."""
        return self.source.refuse(reason)

    def require(self, name: str) -> str:
        """A parameter that has to be there, in capitals."""
        if not self.parameters.get(name):
            raise self.refuse(f"*{self.keyword} needs the parameter {name}=...")
        return self.parameters[name].upper()

    def require_usual(self, name: str, *usual: str, reason: str) -> None:
        """Refuse a parameter that is there with another value than these."""
        if self.parameters.get(name, usual[0]).upper() not in usual:
            raise self.refuse(f"*{self.keyword}, {name}: {reason}")

    def numbers(self) -> list[float]:
        """All fields of its data lines as numbers; empty ones are left out."""
        return [
            finite(text, source, f"*{self.keyword}")
            for source, fields in self.lines
            for text in fields
            if text
        ]

    def rows(self, least: int, most: int) -> Iterator[tuple[Source, list[str]]]:
        """Its data lines, each with so many fields; empty ones at the end are left out.

        Raises:
            ImportRefusedError: A line of another length.
        """
        for source, fields in self.lines:
            while len(fields) > 1 and not fields[-1]:
                fields = fields[:-1]
            if not least <= len(fields) <= most:
                raise source.refuse(
                    f"*{self.keyword}: {len(fields)} field(s) in a line, needs {least} to {most}"
                )
            yield source, fields


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
            card = _card(line, Source(path, start))
            if card.keyword != "INCLUDE":
                self.cards.append(card)
                continue
            if depth >= _DEEPEST or self.num_files >= _MOST_FILES:
                raise card.refuse("*INCLUDE: files include files without end")
            card.require("INPUT")
            self.read(inside_folder(self.folder, card.parameters["INPUT"]), depth + 1)

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
        if name.strip():
            parameters[name.strip().upper()] = value.strip().strip('"')
    known = _PARAMETERS.get(keyword, parameters)
    for name in parameters:
        if name not in known:
            raise source.refuse(
                f"*{keyword}: parameter {name[:40]} is not known here (known: "
                f"{', '.join(known) or 'none'})"
            )
    return Card(keyword, parameters, source)


def label_of(text: str, source: Source, what: str) -> int | str:
    """A number of a node or cell, or the name of a set in capitals, without its instance."""
    word = text.strip().strip('"')
    if not word:
        raise source.refuse(f"{what}: an empty field")
    if word.lstrip("+-").isdigit():
        return whole(word, source, what)
    return word.upper().rpartition(".")[2] or word.upper()


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
    """

    def __init__(self, cards: Iterable[Card]) -> None:
        self.nodes: dict[int, tuple[float, float, float]] = {}
        self.cells: dict[int, list[int]] = {}
        self.node_sets: dict[str, list[int]] = {}
        self.cell_sets: dict[str, list[int]] = {}
        self.surfaces: dict[str, list[tuple[int, int]]] = {}
        self.kinds: dict[str, int] = {}
        self._num_named = 0
        readers = {
            "NODE": self._node,
            "ELEMENT": self._element,
            "NSET": self._set,
            "ELSET": self._set,
            "SURFACE": self._surface,
        }
        for card in cards:
            if card.keyword in readers:
                readers[card.keyword](card)
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
        for source, fields in card.rows(1, 7):
            label = whole(fields[0], source, "*NODE")
            # What is left out is 0.
            given = [*fields[1:4], "", "", ""][:3]
            x, y, z = (finite(text or "0", source, "*NODE") for text in given)
            if self.nodes.setdefault(label, (x, y, z)) != (x, y, z):
                raise source.refuse(f"node {label} is there twice, at different positions")
            new.append(label)
        if "NSET" in card.parameters:
            name = card.require("NSET")
            self.node_sets[name] = list(dict.fromkeys([*self.node_sets.get(name, []), *new]))

    def _element(self, card: Card) -> None:
        kind = card.require("TYPE")
        if kind not in _TYPES:
            raise card.refuse(
                f"*ELEMENT, TYPE={kind[:20]}: a case has tetrahedra: C3D4 and C3D10, and C3D8, "
                "C3D6 and C3D5, which can be cut into them"
            )
        count, new = _TYPES[kind], []
        # A cell of ten nodes may go on in the next line.
        words: list[str] = []
        for source, fields in card.lines:
            words += [text for text in fields if text]
            if len(words) < 1 + count and not fields[-1]:
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
        if "ELSET" in card.parameters:
            self.cell_sets.setdefault(card.require("ELSET"), []).extend(new)

    def _set(self, card: Card) -> None:
        is_of_nodes = card.keyword == "NSET"
        sets = self.node_sets if is_of_nodes else self.cell_sets
        known: Collection[int] = self.nodes if is_of_nodes else self.cells
        name = card.require(card.keyword)
        found = dict.fromkeys(sets.get(name, []))
        for source, fields in card.lines:
            if "GENERATE" in card.parameters:
                all_of = _generated(source, fields, f"*{card.keyword}", len(known))
                found.update(dict.fromkeys(self._counted(all_of, source)))
                continue
            for text in fields:
                if not text:
                    continue
                label = label_of(text, source, f"*{card.keyword}")
                labels = [label] if isinstance(label, int) else _of(sets, label, source)
                found.update(dict.fromkeys(self._counted(labels, source)))
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
        name = card.require("NAME")
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
        labels = _named(text, source, "element", self.cells, self.cell_sets)
        return list(self._counted(labels, source))

    def nodes_of(self, text: str, source: Source) -> list[int]:
        """Numbers of a node or a set of them."""
        labels = _named(text, source, "node", self.nodes, self.node_sets)
        return list(self._counted(labels, source))

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


def _named(
    text: str, source: Source, what: str, known: Collection[int], sets: dict[str, list[int]]
) -> list[int]:
    label = label_of(text, source, f"{what} or set")
    if isinstance(label, str):
        return _of(sets, label, source)
    if label not in known:
        raise source.refuse(f"no {what} {label}")
    return [label]


def _of(sets: dict[str, list[int]], name: str, source: Source) -> list[int]:
    if name not in sets:
        known = ", ".join(list(sets)[:8]) or "none"
        raise source.refuse(f"no set {name[:40]!r} (known: {known})")
    return sets[name]


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
