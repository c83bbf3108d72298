"""Nodes, cells, node sets and surfaces of FEBio's <Geometry> (2.5) and <Mesh> (3.0, 4.0).

Cells that are no tetrahedra, and their faces, are cut into some.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.importing.model import cut_cells, cut_face
from palpate.validation.importing.xml_tree import Element

# Nodes of each kind of element, and its corners among them.
_CELLS = {"tet4": 4, "tet10": 10, "hex8": 8, "penta6": 6, "pyra5": 5}
_FACETS = {"tri3": 3, "tri6": 6, "quad4": 4}
_LISTED = (
    "Nodes",
    "Elements",
    "NodeSet",
    "Surface",
    "ElementSet",
    "PartList",
    "SurfacePair",
    "Part",
)


@dataclass(eq=False)
class FebioMesh:
    """Sets by name as rows of nodes; `material_of` says of each block of cells what it is of."""

    nodes: Points
    labels: NDArray[np.int64]
    corners: NDArray[np.int64]
    middles: NDArray[np.int64]
    node_sets: dict[str, NDArray[np.int64]]
    surfaces: dict[str, NDArray[np.int64]]
    blocks: dict[str, int]
    material_of: list[tuple[Element, str, int]]
    notes: list[str] = field(default_factory=list)

    def nodes_of(self, element: Element) -> NDArray[np.int64]:
        """The nodes that an element's `node_set` names."""
        name = element.attributes.get("node_set", element.attributes.get("set"))
        if name is None:
            raise element.refuse(f"<{element.tag}> needs the attribute node_set")
        if name in self.node_sets:
            return self.node_sets[name]
        kind, _, rest = name.partition(":")
        if kind == "@surface" and rest in self.surfaces:
            return np.unique(self.surfaces[rest])
        raise element.refuse(f"no node set {name[:60]!r} in the mesh")

    def facets_of(self, element: Element) -> NDArray[np.int64]:
        """The facets that an element's `surface` names, by corners."""
        name = element.require("surface")
        if name not in self.surfaces:
            raise element.refuse(f"no surface {name[:60]!r} in the mesh")
        return self.surfaces[name][:, :3]


def read_mesh_sections(sections: dict[str, list[Element]], version: str) -> FebioMesh:
    """Read the mesh.

    Raises:
        ImportRefusedError: Elements that cannot be cut into tetrahedra, or what cannot be read.
    """
    parts = [*sections.get("Geometry", []), *sections.get("Mesh", [])]
    for part in parts:
        part.only(*_LISTED)
        for child in part:
            if child.tag == "Part":
                raise child.refuse("<Part>: a mesh of instances; write it out as one mesh")
    labels, nodes, node_sets = _nodes([c for part in parts for c in part if c.tag == "Nodes"])
    row_of = {label: row for row, label in enumerate(labels)}
    corners, middles, blocks, counts, notes = [], [], {}, [], []
    elements = [c for part in parts for c in part if c.tag == "Elements"]
    for block in elements:
        rows = _rows(block, _CELLS, "elem", row_of)
        name, kind = block.attributes.get("name", f"at line {block.line}"), block.require("type")
        if not kind.startswith("tet"):
            given, rows = len(rows), cut_cells(rows)
            notes.append(
                f"{given} cells of type {kind} ({name}) are cut into {len(rows)} tetrahedra: the "
                "same body where faces are flat, on another mesh"
            )
        corners.append(rows[:, :4])
        middles.append(rows[:, 4:] if rows.shape[1] == 10 else np.full((len(rows), 6), -1))
        blocks[name] = len(rows)
        counts.append(len(rows))
    mesh = FebioMesh(
        nodes,
        np.array(labels, dtype=np.int64),
        np.vstack(corners) if corners else np.zeros((0, 4), dtype=np.int64),
        np.vstack(middles) if middles else np.zeros((0, 6), dtype=np.int64),
        node_sets,
        {},
        blocks,
        _materials_of(sections, elements, counts, version),
        notes,
    )
    for part in parts:
        for child in part:
            name = child.attributes.get("name", "")
            if child.tag == "NodeSet":
                _add(child, mesh.node_sets, name, _node_set(child, row_of, mesh.node_sets))
            elif child.tag == "Surface":
                _add(child, mesh.surfaces, name, _surface(child, row_of))
    return mesh


def _nodes(
    blocks: list[Element],
) -> tuple[list[int], Points, dict[str, NDArray[np.int64]]]:
    labels: list[int] = []
    places: list[tuple[float, float, float]] = []
    sets: dict[str, NDArray[np.int64]] = {}
    for block in blocks:
        first = len(labels)
        block.only("node")
        for node in block:
            labels += node.wholes(node.require("id"))[:1]
            places.append(node.vector())
        if "name" in block.attributes:
            _add(block, sets, block.attributes["name"], np.arange(first, len(labels)))
    if len(set(labels)) < len(labels):
        raise blocks[-1].refuse("a node's id is there twice")
    return labels, np.array(places, dtype=np.float64).reshape(-1, 3), sets


def _add(
    element: Element, sets: dict[str, NDArray[np.int64]], name: str, rows: NDArray[np.int64]
) -> None:
    if name in sets:
        raise element.refuse(f"<{element.tag}> {name[:60]!r} is there twice")
    sets[name] = rows


def _rows(
    block: Element, kinds: dict[str, int], tag: str, row_of: dict[int, int]
) -> NDArray[np.int64]:
    kind = block.require("type")
    if kind not in kinds:
        raise block.refuse(
            f"elements of type {kind[:20]!r}; a case has tetrahedra: tet4 and tet10, and hex8, "
            "penta6 and pyra5, which can be cut into them"
        )
    block.only(tag, "e")
    rows = [_found(element, element.wholes(), kinds[kind], row_of) for element in block]
    return np.array(rows, dtype=np.int64).reshape(-1, kinds[kind])


def _found(element: Element, labels: list[int], count: int, row_of: dict[int, int]) -> list[int]:
    if len(labels) != count:
        raise element.refuse(f"<{element.tag}> needs {count} nodes, has {len(labels)}")
    return [_row(element, label, row_of) for label in labels]


def _row(element: Element, label: int, row_of: dict[int, int]) -> int:
    if label not in row_of:
        raise element.refuse(f"<{element.tag}>: no node {label}")
    return row_of[label]


def _node_set(
    element: Element, row_of: dict[int, int], known: dict[str, NDArray[np.int64]]
) -> NDArray[np.int64]:
    """Format 4.0 lists numbers; the others have an element a node."""
    labels = element.wholes()
    rows: list[int] = [_row(element, label, row_of) for label in labels]
    for child in element:
        match child.tag:
            case "node" | "n":
                rows.append(_row(child, child.wholes(child.require("id"))[0], row_of))
            case "node_set" if (name := child.attributes.get("node_set", child.text)) in known:
                rows += known[name].tolist()
            case _:
                raise child.refuse(f"<{child.tag}> in <NodeSet> is not known here")
    if not rows:
        raise element.refuse("a node set without nodes")
    return np.unique(np.array(rows, dtype=np.int64))


def _surface(element: Element, row_of: dict[int, int]) -> NDArray[np.int64]:
    rows = []
    for facet in element:
        if facet.tag not in _FACETS:
            raise facet.refuse(f"<{facet.tag}> in <Surface>; known are {', '.join(_FACETS)}")
        found = _found(facet, facet.wholes(), _FACETS[facet.tag], row_of)
        cut = [found] if len(found) == 6 else [[*t, *t] for t in cut_face(found)]
        rows += cut
    if not rows:
        raise element.refuse("a surface without facets")
    return np.array(rows, dtype=np.int64)


def _materials_of(
    sections: dict[str, list[Element]], elements: list[Element], counts: list[int], version: str
) -> list[tuple[Element, str, int]]:
    """Of each block of cells what names its material, and how many they are."""
    if version == "2.5":
        return [(block, block.require("mat"), n) for block, n in zip(elements, counts, strict=True)]
    domains: dict[str, Element] = {}
    for section in sections.get("MeshDomains", []):
        for domain in section:
            if domain.tag != "SolidDomain":
                raise domain.refuse(f"<{domain.tag}> in <MeshDomains>; a case is of solids")
            domains[domain.require("name")] = domain
    found = []
    for block, count in zip(elements, counts, strict=True):
        name = block.require("name")
        if name not in domains:
            raise block.refuse(f"no <SolidDomain> for the elements {name[:60]!r}")
        found.append((domains[name], domains[name].require("mat"), count))
    return found
