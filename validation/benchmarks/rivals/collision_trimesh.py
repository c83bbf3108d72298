"""Vertices in a closed surface by trimesh and Embree: rays, on a scene made anew in every step."""

from __future__ import annotations

from typing import Any

import embreex  # noqa: F401  without it trimesh casts rays by itself
import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector


class Rival:
    """Tells which vertices lie in the other body, not in which cell."""

    tool, version, precision = "trimesh embree", str(trimesh.__version__), "float32"

    def __init__(self, body: dict[str, Any]) -> None:
        if bool(body["with_self"]):
            raise ValueError("it tells inside from outside, of another body")
        self._vertices, rows = np.unique(body["facets"], return_inverse=True)
        self._facets = rows.reshape(-1, 3)
        self._frames = [
            np.ascontiguousarray(body[f"frames_{k}"][:, self._vertices]) for k in range(2)
        ]
        self._step = 0
        count = body["frames_0"].shape[1]
        inside = self._look(0)
        found = [self._vertices[inside[k]] + k * count for k in range(2)]
        self.force = np.concatenate(found).astype(np.float64)[:, None]

    def _look(self, k: int) -> list[Any]:
        inside = []
        for intruder in range(2):
            points = self._frames[1 - intruder][k]
            solid = trimesh.Trimesh(points, self._facets, process=False, validate=False)
            # Only what lies in the box of the solid is worth a ray.
            there = self._frames[intruder][k]
            near = np.all((there >= points.min(axis=0)) & (there <= points.max(axis=0)), axis=1)
            flags = np.zeros(len(there), dtype=bool)
            if near.any():
                flags[near] = RayMeshIntersector(solid).contains_points(there[near])
            inside.append(flags)
        return inside

    def advance(self, num_steps: int) -> None:
        """New scene and query."""
        for _ in range(num_steps):
            self._step += 1
            self._look(self._step % len(self._frames[0]))


def prepare(body: dict[str, Any]) -> Rival:
    """Nothing but the arrays is kept."""
    return Rival(body)
