"""Our own detection: hashed voxels, filled anew in every step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.collision.detection import VertexCellDetector
from palpate.meshes.tet_mesh import TetMesh

# Looks at one frame; what it finds is (intruder's body, looked-at body, pairs).
Look = Callable[[int], tuple[int, int, Any]]


class Rival:
    """One frame a step, both bodies as intruder in turn, and against themselves where asked."""

    tool, version, precision = "palpate", _core.__version__, "float64"

    def __init__(self, body: dict[str, Any]) -> None:
        self._frames = [np.ascontiguousarray(body[f"frames_{k}"]) for k in range(2)]
        self._step = 0
        self._offsets = np.array([[0, 0], [body["frames_0"].shape[1], len(body["elements"])]])
        pairs = [(1, 0), (0, 1)] + ([(0, 0), (1, 1)] if bool(body["with_self"]) else [])
        self._looks = [_make_look(body, self._frames, a, b) for a, b in pairs]
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
            add = [self._offsets[intruder, 0], self._offsets[body, 1]]
            found.append(np.asarray(pairs, dtype=np.int64) + add)
        return np.concatenate(found).astype(np.float64)


def _make_look(body: dict[str, Any], frames: list[Any], intruder: int, looked_at: int) -> Look:
    is_same = intruder == looked_at
    here, there = frames[looked_at], frames[intruder]
    mesh = TetMesh(here[0], body["elements"])
    detector = VertexCellDetector(mesh, None if is_same else TetMesh(there[0], mesh.cells))

    def look(k: int) -> tuple[int, int, Any]:
        found = detector.find(here[k], None if is_same else there[k])
        return intruder, looked_at, np.column_stack([found.vertices, found.cells])

    return look


def prepare(body: dict[str, Any]) -> Rival:
    """Sizes are sorted and memory is taken here."""
    return Rival(body)
