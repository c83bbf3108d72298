"""Nodes of linear or quadratic tetrahedra on a case's mesh, for adapters of tools that have both.

Middle nodes lie halfway along straight edges. The data of a case's points is transferred to the
nodes: a middle node is fixed where it lies on the boundary between fixed points, a traction goes to
the middle nodes of its facets, and a body force to nodes as quadratic shape functions distribute
it. The result is given on the cells cut in eight, whose points are all of the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

# Ends of the middle nodes 4 to 9, in the order of Abaqus and VTK.
EDGES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])
_FACETS = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
# The eight parts of a cell: four at corners, four around the line between nodes 4 and 9.
_PARTS = np.array(
    [
        [0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3],
        [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5],
    ]
)  # fmt: skip
# A traction that varies over its facets by more than this fraction is refused here.
_SAME = 1e-9


def nodes_of(job: dict[str, Any]) -> Points | Quadratic:
    """A job by its points, or with `degree` 2 by the nodes of quadratic tetrahedra."""
    return Quadratic.of(job) if int(job.get("degree", 1)) == 2 else Points(job)


class Points:
    """A job given at its points, unchanged."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.arrays = job

    def result(self, displacement: Any) -> dict[str, Any]:
        """The arrays of a result file for the points' displacement [m]."""
        return {"displacement": displacement}


@dataclass(frozen=True, eq=False)
class Quadratic:
    """A job by its nodes: the case's points, then the middles of edges, (num_nodes, 3) each.

    `cells` have four corners and six middle nodes; `parts` are linear tetrahedra between the nodes,
    (8 num_cells, 4).
    """

    points: Any
    cells: Any
    fixed: Any
    prescribed: Any
    force: Any
    parts: Any

    @property
    def arrays(self) -> dict[str, Any]:
        """The arrays under the job's names."""
        return {
            "points": self.points,
            "cells": self.cells,
            "fixed": self.fixed,
            "prescribed_displacement": self.prescribed,
            "external_force": self.force,
        }

    def result(self, displacement: Any) -> dict[str, Any]:
        """The arrays of a result file for the nodes' displacement [m]."""
        return {"displacement": displacement, "points": self.points, "cells": self.parts}

    @classmethod
    def of(cls, job: dict[str, Any]) -> Quadratic:
        """Make nodes from arrays as in `rest.npz`, with `load_kinds`.

        Raises ValueError for loads of more than one kind, whose parts at the points cannot be
        separated, or a traction that varies.
        """
        points, cells = job["points"], job["cells"].astype(np.int64)
        ends = np.sort(cells[:, EDGES], axis=2)
        edges, middles = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
        middles = len(points) + middles.reshape(-1, 6)
        facets = _boundary(cells)
        fixed, moved = job["fixed"], job["prescribed_displacement"]
        fixed = np.vstack([fixed, _fixed_middles(edges, facets, fixed)])
        moved = np.vstack([moved, moved[edges].mean(axis=1)])
        nodes = np.vstack([points, points[edges].mean(axis=1)])
        all_cells = np.column_stack([cells, middles])
        parts = all_cells[:, _PARTS].reshape(-1, 4)
        sides = nodes[parts[:, 1:]] - nodes[parts[:, :1]]
        turned = np.linalg.det(sides) < 0.0
        parts[turned] = parts[turned][:, [0, 2, 1, 3]]
        force = _force(job, len(nodes), all_cells, facets, edges)
        return cls(nodes, all_cells, fixed, np.where(fixed, moved, 0.0), force, parts)


def _boundary(cells: Any) -> Any:
    """Facets that belong to one cell only, (num_facets, 3)."""
    facets = np.sort(cells[:, _FACETS].reshape(-1, 3), axis=1)
    found, counts = np.unique(facets, axis=0, return_counts=True)
    return found[counts == 1]


def _edges_of(facets: Any, edges: Any) -> Any:
    """Numbers of the three edges of each facet, (num_facets, 3)."""
    stride = int(edges.max()) + 1
    ends = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    return np.searchsorted(edges[:, 0] * stride + edges[:, 1], ends[..., 0] * stride + ends[..., 1])


def _fixed_middles(edges: Any, facets: Any, fixed: Any) -> Any:
    """Middle nodes are fixed where a boundary facet's three corners are, (num_edges, 3)."""
    middles = np.zeros((len(edges), 3), dtype=fixed.dtype)
    of_facets = _edges_of(facets, edges)
    for axis in range(3):
        whole = fixed[:, axis][facets].all(axis=1)
        middles[of_facets[whole], axis] = 1
    return middles


def _force(job: dict[str, Any], num_nodes: int, cells: Any, facets: Any, edges: Any) -> Any:
    """Forces of the nodes, with the same sum as those of the points [N]."""
    given, points = job["external_force"], job["points"]
    kinds = set(np.asarray(job["load_kinds"]).tolist())
    force = np.zeros((num_nodes, 3))
    if len(kinds) > 1:
        raise ValueError(f"loads of more than one kind ({', '.join(sorted(kinds))})")
    if kinds == {"PointForce"} or not kinds:
        force[: len(points)] = given
    elif kinds == {"BodyForce"}:
        # Of a cell's force each middle node gets a fifth, and each corner minus a twentieth.
        sides = points[cells[:, 1:4]] - points[cells[:, :1]]
        volumes = np.linalg.det(sides) / 6.0
        total = given.sum(axis=0) / volumes.sum()
        fractions = np.repeat([[-0.05] * 4 + [0.2] * 6], len(cells), axis=0) * volumes[:, None]
        force += np.bincount(cells.ravel(), fractions.ravel(), num_nodes)[:, None] * total
    elif kinds == {"Traction"}:
        is_pushed = given.any(axis=1)
        pushed = facets[is_pushed[facets].all(axis=1)]
        a, b, c = (points[pushed[:, k]] for k in range(3))
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        traction = given.sum(axis=0) / areas.sum()
        thirds = np.repeat(areas / 3.0, 3)
        alike = np.bincount(pushed.ravel(), thirds, len(points))[:, None] * traction
        if np.abs(alike - given).max() > _SAME * np.abs(given).max():
            raise ValueError("a traction that is not the same everywhere on its facets")
        middles = len(points) + _edges_of(pushed, edges)
        force += np.bincount(middles.ravel(), thirds, num_nodes)[:, None] * traction
    else:
        raise ValueError(f"loads of kind {', '.join(sorted(kinds))}")
    return force
