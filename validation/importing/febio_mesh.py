"""Nodes, cells, node sets and surfaces of FEBio's <Geometry> (2.5) and <Mesh> (3.0, 4.0).

Cells that are no tetrahedra, and their faces, are cut into some.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.importing.model import cut_cells, cut_face
from palpate.validation.importing.xml_tree import Element

Rows = NDArray[np.int64]
# Nodes of each kind of element.
_CELLS = {"tet4": 4, "tet10": 10, "hex8": 8, "penta6": 6, "pyra5": 5}
_FACETS = {"tri3": 3, "tri6": 6, "quad4": 4}


class FebioMesh:
    """Nodes, tetrahedra and named sets as rows of nodes; `notes` say what was cut.

    Args:
        sections: Sections of the file, by tag.
        version: Version of its format.

    Raises:
        ImportRefusedError: Elements that cannot be cut into tetrahedra, or what cannot be read.
    """

    def __init__(self, sections: dict[str, list[Element]], version: str) -> None:
        self.notes: list[str] = []
        self.node_sets: dict[str, Rows] = {}
        self.surfaces: dict[str, Rows] = {}
        parts = [*sections.get("Geometry", []), *sections.get("Mesh", [])]
        listed = ("Nodes", "Elements", "NodeSet", "Surface")
        children = [child for part in parts for child in part.each(*listed)]
        self.labels, self.nodes = self._nodes([c for c in children if c.tag == "Nodes"])
        self._row_of = {label: row for row, label in enumerate(self.labels.tolist())}
        blocks = [child for child in children if child.tag == "Elements"]
        cells = [self._cells(block) for block in blocks]
        self.corners = np.vstack([np.zeros((0, 4), dtype=np.int64), *(c[:, :4] for c in cells)])
        self.middles = np.vstack([np.zeros((0, 6), dtype=np.int64), *(c[:, 4:] for c in cells)])
        # What names the material of each block of cells, and the number of its cells.
        self.material_of = [
            (*named, len(rows))
            for named, rows in zip(_materials_of(sections, blocks, version), cells, strict=True)
        ]
        for child in children:
            if child.tag == "NodeSet":
                _add(child, self.node_sets, self._node_set(child))
            elif child.tag == "Surface":
                _add(child, self.surfaces, self._surface(child))

    def nodes_of(self, element: Element) -> Rows:
        """The nodes that an element's `node_set` names."""
        name = element.get("node_set") or element.get("set")
        if name is None:
            raise element.refuse(f"<{element.tag}> needs the attribute node_set")
        if name in self.node_sets:
            return self.node_sets[name]
        kind, _, rest = name.partition(":")
        if kind == "@surface" and rest in self.surfaces:
            return np.unique(self.surfaces[rest])
        raise element.refuse(f"no node set {name[:60]!r} in the mesh")

    def facets_of(self, element: Element) -> Rows:
        """The facets that an element's `surface` names, by corners."""
        name = element.require("surface")
        if name not in self.surfaces:
            raise element.refuse(f"no surface {name[:60]!r} in the mesh")
        return self.surfaces[name][:, :3]

    def _nodes(self, blocks: list[Element]) -> tuple[Rows, Points]:
        labels: list[int] = []
        points: list[tuple[float, float, float]] = []
        for block in blocks:
            first = len(labels)
            for node in block.each("node"):
                labels.append(node.id())
                points.append(node.vector())
            if block.get("name") is not None:
                _add(block, self.node_sets, np.arange(first, len(labels)))
        if len(set(labels)) < len(labels):
            raise blocks[-1].refuse("a node's id is there twice")
        return np.array(labels, dtype=np.int64), np.array(points, dtype=float).reshape(-1, 3)

    def _rows(self, element: Element, labels: list[int], count: int | None = None) -> list[int]:
        """Rows of nodes by their numbers in the file; so many of them."""
        if count is not None and len(labels) != count:
            raise element.refuse(f"<{element.tag}> needs {count} nodes, has {len(labels)}")
        for label in labels:
            if label not in self._row_of:
                raise element.refuse(f"<{element.tag}>: no node {label}")
        return [self._row_of[label] for label in labels]

    def _cells(self, block: Element) -> Rows:
        """Tetrahedra with their middle nodes, -1 where they have none, (n, 10)."""
        kind = block.require("type")
        if kind not in _CELLS:
            raise block.refuse(
                f"elements of type {kind[:20]!r}; a case has tetrahedra: tet4 and tet10, and hex8, "
                "penta6 and pyra5, which can be cut into them"
            )
        listed = [
            self._rows(element, element.wholes(), _CELLS[kind])
            for element in block.each("elem", "e")
        ]
        cells = np.array(listed, dtype=np.int64).reshape(-1, _CELLS[kind])
        if not kind.startswith("tet"):
            name = block.values.get("name", f"at line {block.line}")
            cells = cut_cells(cells)
            self.notes.append(
                f"{len(listed)} cells of type {kind} ({name}) are cut into {len(cells)} "
                "tetrahedra: the same body where faces are flat, on another mesh"
            )
        return np.pad(cells, ((0, 0), (0, 10 - cells.shape[1])), constant_values=-1)

    def _node_set(self, element: Element) -> Rows:
        """Format 4.0 lists numbers; the others have an element a node."""
        rows = self._rows(element, element.wholes())
        listed: set[str] = set()
        for child in element.each("node", "n"):
            rows += self._rows(child, [child.id()])
        for child in element.each("node_set"):
            name = child.get("node_set") or child.text
            if name not in self.node_sets or name in listed:
                reason = f"lists {name[:60]!r} twice" if name in listed else f"no {name[:60]!r} yet"
                raise child.refuse(f"<NodeSet> {reason}")
            listed.add(name)
            rows += self.node_sets[name].tolist()
        if not rows:
            raise element.refuse("a node set without nodes")
        return np.unique(np.array(rows, dtype=np.int64))

    def _surface(self, element: Element) -> Rows:
        rows: list[list[int]] = []
        for facet in element.each(*_FACETS):
            found = self._rows(facet, facet.wholes(), _FACETS[facet.tag])
            rows += [found] if len(found) == 6 else [[*t, *t] for t in cut_face(found)]
        if not rows:
            raise element.refuse("a surface without facets")
        return np.array(rows, dtype=np.int64)


def _add(element: Element, sets: dict[str, Rows], rows: Rows) -> None:
    name = element.word("name")
    if name in sets:
        raise element.refuse(f"<{element.tag}> {name[:60]!r} is there twice")
    sets[name] = rows


def _materials_of(
    sections: dict[str, list[Element]], blocks: list[Element], version: str
) -> list[tuple[Element, str]]:
    """What names the material of each block of cells: itself, or its domain."""
    if version == "2.5":
        return [(block, block.require("mat")) for block in blocks]
    domains: dict[str, Element] = {}
    for section in sections.get("MeshDomains", []):
        for domain in section.each("SolidDomain"):
            if domains.setdefault(domain.require("name"), domain) is not domain:
                raise domain.refuse(f"a second domain of {domain.word('name')[:60]!r}")
    for block in blocks:
        if block.require("name") not in domains:
            raise block.refuse(f"no <SolidDomain> for the elements {block.word('name')[:60]!r}")
    found = [domains[block.word("name")] for block in blocks]
    return [(domain, domain.require("mat")) for domain in found]
