"""Nodes, tetrahedra, sets and surfaces of Abaqus and CalculiX input files."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.tet_mesh import CELL_FACETS
from palpate.validation.importing.abaqus_cards import Card, label_of
from palpate.validation.importing.model import Place, finite, whole

# Element types by nodes; hybrid and modified ones differ in how they solve, not in what.
_TYPES = {
    "C3D4": 4, "C3D4H": 4, "C3D10": 10, "C3D10H": 10, "C3D10M": 10, "C3D10MH": 10, "C3D10HS": 10,
    "C3D10T": 10,
}  # fmt: skip
# The corner opposite each face: Abaqus Analysis User's Guide, "Three-dimensional solid element
# library"; CalculiX's manual, "Four-node tetrahedral element": 1-2-3, 1-4-2, 2-4-3, 3-4-1.
OPPOSITE = {1: 3, 2: 2, 3: 0, 4: 1}


@dataclass(eq=False)
class AbaqusMesh:
    """By the file's own numbers: nodes, cells and named sets of them; names in capitals."""

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    cells: dict[int, list[int]] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    cell_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[tuple[int, int]]] = field(default_factory=dict)

    def take(self, card: Card) -> bool:
        """Read a card of the mesh; False where it is none."""
        match card.keyword:
            case "NODE":
                self._node(card)
            case "ELEMENT":
                self._element(card)
            case "NSET":
                self._set(card, "NSET", self.node_sets, self.nodes)
            case "ELSET":
                self._set(card, "ELSET", self.cell_sets, self.cells)
            case "SURFACE":
                self._surface(card)
            case _:
                return False
        return True

    def finish(self) -> None:
        """Number rows; after all cards of the mesh."""
        self.row_of = {label: row for row, label in enumerate(self.nodes)}
        self.cell_row_of = {label: row for row, label in enumerate(self.cells)}

    def _node(self, card: Card) -> None:
        card.only("NSET", "SYSTEM")
        if card.parameters.get("SYSTEM", "R").upper() != "R":
            raise card.refuse("*NODE, SYSTEM: coordinates in another system; write them in x, y, z")
        new = []
        for place, fields in card.rows(1, 7):
            label = whole(fields[0], place, "*NODE")
            # What is left out is 0.
            given = [*fields[1:4], "", "", ""][:3]
            x, y, z = (finite(text or "0", place, "*NODE") for text in given)
            if self.nodes.setdefault(label, (x, y, z)) != (x, y, z):
                raise place.refuse(f"node {label} is there twice, at different places")
            new.append(label)
        if "NSET" in card.parameters:
            self.node_sets.setdefault(card.require("NSET"), []).extend(new)

    def _element(self, card: Card) -> None:
        card.only("TYPE", "ELSET")
        kind = card.require("TYPE")
        if kind not in _TYPES:
            raise card.refuse(f"*ELEMENT, TYPE={kind[:20]}: a case has tetrahedra: C3D4, C3D10")
        count, new = _TYPES[kind], []
        # A cell of ten nodes may go on in the next line.
        words: list[str] = []
        for place, fields in card.lines:
            words += [text for text in fields if text]
            if len(words) < 1 + count:
                if fields[-1]:
                    raise place.refuse(f"an element of type {kind} needs {count} nodes")
                continue
            if len(words) > 1 + count:
                raise place.refuse(f"an element of type {kind} needs {count} nodes")
            label, *nodes = (whole(text, place, "*ELEMENT") for text in words)
            if label in self.cells:
                raise place.refuse(f"element {label} is there twice")
            self.cells[label] = nodes
            new.append(label)
            for node in nodes:
                if node not in self.nodes:
                    raise place.refuse(f"element {label}: no node {node}")
            words = []
        if words:
            raise card.refuse("an element is cut off")
        if "ELSET" in card.parameters:
            self.cell_sets.setdefault(card.require("ELSET"), []).extend(new)

    def _set(
        self, card: Card, name: str, sets: dict[str, list[int]], known: Collection[int]
    ) -> None:
        card.only(name, "GENERATE", "UNSORTED", "INSTANCE", "INTERNAL")
        found: list[int] = []
        for place, fields in card.lines:
            if "GENERATE" in card.parameters:
                found += _generated(place, fields, f"*{card.keyword}")
                continue
            for text in fields:
                if not text:
                    continue
                label = label_of(text, place, f"*{card.keyword}")
                found += [label] if isinstance(label, int) else _of(sets, label, place)
        for label in found:
            if label not in known:
                raise card.refuse(f"*{card.keyword} names {label}, which is not there")
        sets.setdefault(card.require(name), []).extend(found)

    def _surface(self, card: Card) -> None:
        card.only("NAME", "TYPE", "INTERNAL")
        name = card.require("NAME")
        if card.parameters.get("TYPE", "ELEMENT").upper() != "ELEMENT":
            raise card.refuse("*SURFACE, TYPE=NODE has no area; give faces of elements")
        if name in self.surfaces:
            raise card.refuse(f"surface {name} is there twice")
        faces = []
        for place, fields in card.rows(1, 2):
            if len(fields) < 2 or not fields[1]:
                raise place.refuse("*SURFACE: needs a face, S1 to S4, after the element or set")
            faces += [(c, face_of(fields[1], "S", place)) for c in self.cells_of(fields[0], place)]
        self.surfaces[name] = faces

    def cells_of(self, text: str, place: Place) -> list[int]:
        """Numbers of a cell or a set of them."""
        label = label_of(text, place, "an element or a set")
        if isinstance(label, str):
            return _of(self.cell_sets, label, place)
        if label not in self.cells:
            raise place.refuse(f"no element {label}")
        return [label]

    def nodes_of(self, text: str, place: Place) -> list[int]:
        """Numbers of a node or a set of them."""
        label = label_of(text, place, "a node or a set")
        if isinstance(label, str):
            return _of(self.node_sets, label, place)
        if label not in self.nodes:
            raise place.refuse(f"no node {label}")
        return [label]

    def facets(self, faces: list[tuple[int, int]]) -> NDArray[np.int64]:
        """Faces of cells as rows of corner nodes, seen from outside counter-clockwise."""
        rows = [[self.row_of[self.cells[c][k]] for k in CELL_FACETS[OPPOSITE[f]]] for c, f in faces]
        return np.array(rows, dtype=np.int64).reshape(-1, 3)

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        """Nodes, corners and middle nodes; -1 where a cell has none."""
        rows = [[self.row_of[node] for node in nodes] for nodes in self.cells.values()]
        middles = [row[4:] or [-1] * 6 for row in rows]
        return (
            np.array(list(self.nodes.values()), dtype=np.float64).reshape(-1, 3),
            np.array([row[:4] for row in rows], dtype=np.int64).reshape(-1, 4),
            np.array(middles, dtype=np.int64).reshape(-1, 6),
        )


def face_of(text: str, letter: str, place: Place) -> int:
    """The number of a face: S1 or P1 to 4.

    Raises:
        ImportRefusedError: No face of a tetrahedron.
    """
    word = text.strip().upper()
    if len(word) != 2 or word[0] != letter or word[1] not in "1234":
        raise place.refuse(f"{word[:20]!r} is no face of a tetrahedron: {letter}1 to {letter}4")
    return int(word[1])


def _of(sets: dict[str, list[int]], name: str, place: Place) -> list[int]:
    if name not in sets:
        known = ", ".join(list(sets)[:8]) or "none"
        raise place.refuse(f"no set {name[:40]!r} (known: {known})")
    return sets[name]


def _generated(place: Place, fields: list[str], what: str) -> list[int]:
    words = [text for text in fields if text]
    if len(words) not in (2, 3):
        raise place.refuse(f"{what}, GENERATE: needs first, last and step")
    first, last, *rest = (whole(text, place, what) for text in words)
    step = rest[0] if rest else 1
    if step < 1 or last < first or (last - first) // step > 10_000_000:
        raise place.refuse(f"{what}, GENERATE: {first} to {last} by {step} is no range")
    return list(range(first, last + 1, step))
