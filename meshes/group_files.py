"""Named groups of facets, points and cells in files: physical groups of MSH, fields in VTU, VTK."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, unquote

import meshio
import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import TetMesh

# meshio's name of the cells of each kind of group, and their dimension in gmsh.
_KINDS = {"facet": ("triangle", 2), "point": ("vertex", 0), "cell": ("tetra", 3)}
_Rows = NDArray[Any]


@dataclass(frozen=True)
class Groups:
    """Groups by name: facets (n, 3), points (n,) as in the file, cells (n,) of its tetrahedra."""

    facets: dict[str, _Rows]
    points: dict[str, _Rows]
    cells: dict[str, _Rows]


def groups_in(data: Any) -> Groups:
    """Groups in a mesh that meshio has read."""
    found = {kind: _named(data, kind) for kind in _KINDS}
    points = [block.data for block in data.cells]
    sizes = [len(block.data) if block.type == "tetra" else 0 for block in data.cells]
    starts = np.cumsum([0, *sizes])
    facets = {
        name: np.vstack([points[k][rows] for k, rows in parts])
        for name, parts in found["facet"].items()
    }
    single = {
        name: np.concatenate([points[k][rows, 0] for k, rows in parts])
        for name, parts in found["point"].items()
    }
    cells = {
        name: np.concatenate([starts[k] + rows for k, rows in parts])
        for name, parts in found["cell"].items()
    }
    return Groups(facets, single, cells)


def _named(data: Any, kind: str) -> dict[str, list[tuple[int, _Rows]]]:
    """Of each group of a kind, the blocks of cells and the rows in them."""
    cells, dimension = _KINDS[kind]
    blocks = [(k, block) for k, block in enumerate(data.cells) if block.type == cells]
    rows: dict[str, list[tuple[int, _Rows]]] = {}

    def add(name: str, block: int, chosen: _Rows) -> None:
        if len(chosen):
            rows.setdefault(name, []).append((block, chosen))

    for name, sets in data.cell_sets.items():
        # meshio adds the bounding entities of gmsh to the names.
        for k, _ in () if name.startswith("gmsh:") else blocks:
            add(name, k, np.asarray([] if sets[k] is None else sets[k], dtype=np.int64))
    physical = data.cell_data.get("gmsh:physical")
    for name, (tag, of) in data.field_data.items() if physical is not None else ():
        for k, _ in blocks if of == dimension and name not in data.cell_sets else ():
            add(name, k, np.flatnonzero(np.asarray(physical[k]) == tag))
    mark = f"{kind}_group:"
    for field, values in data.cell_data.items():
        for k, block in blocks if field.startswith(mark) else ():
            flags = np.asarray(values[k]).reshape(len(block.data), -1)[:, 0]
            add(unquote(field.removeprefix(mark)), k, np.flatnonzero(flags))
    return rows


def without_lower_points(data: Any, cells: _Rows, groups: Groups) -> tuple[Points, _Rows, Groups]:
    """Drop points only used by cells of lower dimension (gmsh keeps its geometry's points)."""
    points: Points = np.asarray(data.points, dtype=np.float64)
    lower = [np.ravel(block.data) for block in data.cells if block.type in ("vertex", "line")]
    if not lower:
        return points, cells, groups
    if min(int(cells.min()), 0) < 0 or int(cells.max()) >= len(points):
        return points, cells, groups  # TetMesh refuses it, with the guilty rows
    loose = np.setdiff1d(np.concatenate(lower), cells)
    if loose.size == 0:
        return points, cells, groups
    keep = np.setdiff1d(np.arange(len(points)), loose)
    renumber = np.full(len(points), -1)
    renumber[keep] = np.arange(len(keep))
    single = {name: renumber[rows] for name, rows in groups.points.items()}
    kept = {name: rows[rows >= 0] for name, rows in single.items()}
    return (
        points[keep],
        renumber[cells],
        Groups(
            {name: renumber[rows] for name, rows in groups.facets.items()},
            {name: rows for name, rows in kept.items() if len(rows)},
            groups.cells,
        ),
    )


def with_groups(mesh: Any, body: TetMesh, *, suffix: str) -> Any:
    """A mesh for meshio with triangles and vertices for groups; an item in two groups twice.

    MSH has physical groups, files of other suffixes have fields.

    Raises:
        InputError: Two groups of one name, which readers do not distinguish, or in MSH a cell in
            two groups.
    """
    groups: dict[str, Mapping[str, _Rows]] = {
        "facet": body.facet_groups,
        "point": body.point_groups,
        "cell": body.cell_groups,
    }
    names = [name for of_kind in groups.values() for name in of_kind]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"group {twice!r} is there twice; names of all groups differ in files")
    number = {name: k for k, name in enumerate(names, start=1)}
    blocks = [("tetra", np.array(body.cells))]
    marks: list[dict[str, _Rows]] = [dict(body.cell_groups)]
    for kind in ("facet", "point"):
        rows = [np.array(found) for found in groups[kind].values()]
        if rows:
            ends = np.cumsum([0, *map(len, rows)])
            items = np.vstack(rows) if kind == "facet" else np.concatenate(rows)[:, None]
            blocks.append((_KINDS[kind][0], items))
            spans = itertools.pairwise(ends.tolist())
            marks.append(
                {n: np.arange(a, b) for n, (a, b) in zip(groups[kind], spans, strict=True)}
            )
    if suffix == ".msh":
        tags = [_tags(len(items), of, number) for (_, items), of in zip(blocks, marks, strict=True)]
        fields = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        about = {
            name: np.array([number[name], _KINDS[kind][1]])
            for kind, of_kind in groups.items()
            for name in of_kind
        }
        return meshio.Mesh(mesh.points, blocks, cell_data=fields, field_data=about)
    # VTU and VTK have no named groups: a field of ones and zeros stands for each. VTK's old format
    # allows no space in a name.
    safe = "" if suffix == ".vtk" else " "
    fields = {}
    for kind, of_kind in groups.items():
        for name in of_kind:
            flags = [np.zeros(len(items), dtype=np.int32) for _, items in blocks]
            for flag, of in zip(flags, marks, strict=True):
                flag[of.get(name, [])] = 1
            fields[f"{kind}_group:{quote(name, safe)}"] = flags
    return meshio.Mesh(mesh.points, blocks, cell_data=fields)


def _tags(count: int, groups: Mapping[str, _Rows], number: Mapping[str, int]) -> _Rows:
    """Number of the group of each item, 0 without a group."""
    tags = np.zeros(count, dtype=np.int32)
    for name, rows in groups.items():
        if tags[rows].any():
            raise InputError(f"group {name!r} has cells of another group; MSH gives each one name")
        tags[rows] = number[name]
    return tags
