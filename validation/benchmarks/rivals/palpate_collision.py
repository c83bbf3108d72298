"""Our own detection: hashed voxels, filled anew in every step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.collision.detection import VertexCellDetector
from palpate.fastsim.collision.surface_detection import EdgeEdgeDetector, VertexFacetDetector
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

# Looks at one frame; what it finds is (intruder's body, looked-at body, pairs).
Look = Callable[[int], tuple[int, int, Any]]


class Rival:
    """One frame a step, both bodies as intruder in turn, and against themselves where asked."""

    tool, version, precision = "palpate", _core.__version__, "float64"

    def __init__(self, body: dict[str, Any]) -> None:
        self._frames = [np.ascontiguousarray(body[f"frames_{k}"]) for k in range(2)]
        self._step = 0
        self._offsets = np.array([[0, 0], [body["frames_0"].shape[1], len(body["elements"])]])
        pairs = [(1, 0), (0, 1)] if str(body["query"]) != "edges near edges" else [(0, 1)]
        if bool(body["with_self"]):
            pairs += [(0, 0), (1, 1)]
        self._looks = [_make_look(body, self._frames, a, b) for a, b in pairs]
        self._counts_edges = str(body["query"]) == "edges near edges"
        self.force = self._answer()

    def advance(self, num_steps: int) -> dict[str, Any]:
        """Everything anew in each step."""
        for _ in range(num_steps):
            self._step += 1
            for look in self._looks:
                look(self._step % len(self._frames[0]))
        return {}

    def _answer(self) -> Any:
        found = []
        for intruder, body, pairs in (look(0) for look in self._looks):
            columns = [1, 1] if self._counts_edges else [0, 1]
            add = [self._offsets[intruder, columns[0]], self._offsets[body, columns[1]]]
            found.append(np.asarray(pairs, dtype=np.int64) + add)
        return np.concatenate(found).astype(np.float64)


def _make_look(body: dict[str, Any], frames: list[Any], intruder: int, looked_at: int) -> Look:
    distance = float(body["distance"])
    is_same = intruder == looked_at
    here, there = frames[looked_at], frames[intruder]
    query = str(body["query"])
    if query == "vertices in cells":
        mesh = TetMesh(here[0], body["elements"])
        detector = VertexCellDetector(mesh, None if is_same else TetMesh(there[0], mesh.cells))

        def overlaps(k: int) -> tuple[int, int, Any]:
            found = detector.find(here[k], None if is_same else there[k])
            return intruder, looked_at, np.column_stack([found.vertices, found.cells])

        return overlaps
    surface = TriSurface(here[0], body["facets"])
    other = None if is_same else TriSurface(there[0], body["facets"])
    kind = EdgeEdgeDetector if query == "edges near edges" else VertexFacetDetector
    surfaces = kind(surface, other)

    def near(k: int) -> tuple[int, int, Any]:
        points = None if is_same else there[k]
        if not bool(body["only_candidates"]):
            found = surfaces.find(distance, here[k], points)
            names = ("first", "second") if query == "edges near edges" else ("vertices", "facets")
            return intruder, looked_at, np.column_stack([getattr(found, n) for n in names])
        return intruder, looked_at, surfaces.find_candidates(distance, here[k], points)

    return near


def prepare(body: dict[str, Any]) -> Rival:
    """Sizes are sorted and memory is taken here."""
    return Rival(body)
