"""Vertices in a closed surface by rays of trimesh and Embree; each step makes a new scene."""

from __future__ import annotations

from typing import Any

import embreex  # noqa: F401  without it trimesh casts rays by itself
import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector


class Collision:
    """Finds which vertices lie in the other body, but not in which cell."""

    version, precision = str(trimesh.__version__), "float32"

    def __init__(self, job: dict[str, Any]) -> None:
        if bool(job["with_self"]):
            raise ValueError("it tells inside from outside, of another body")
        vertices, rows = np.unique(job["facets"], return_inverse=True)
        self._facets = rows.reshape(-1, 3)
        self._frames = np.ascontiguousarray(job["frames"][:, :, vertices])
        count = job["frames"].shape[2]
        found = [vertices[flags] + k * count for k, flags in enumerate(self._look(0))]
        self.result = {"pairs": np.concatenate(found)[:, None]}

    def _look(self, k: int) -> list[Any]:
        inside = []
        for there, points in ((self._frames[0, k], self._frames[1, k]),
                              (self._frames[1, k], self._frames[0, k])):  # fmt: skip
            solid = trimesh.Trimesh(points, self._facets, process=False, validate=False)
            # Only vertices in the box of the solid get a ray.
            near = np.all((there >= points.min(axis=0)) & (there <= points.max(axis=0)), axis=1)
            flags = np.zeros(len(there), dtype=bool)
            if near.any():
                flags[near] = RayMeshIntersector(solid).contains_points(there[near])
            inside.append(flags)
        return inside

    def advance(self, num_steps: int) -> None:
        """Make a new scene, and query it."""
        for step in range(num_steps):
            self._look(step % self._frames.shape[1])
