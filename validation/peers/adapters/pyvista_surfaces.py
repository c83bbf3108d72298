"""Surfaces like those of scans, made by VTK: decimated, or by marching cubes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista


class Surface:
    """A body's surface with fewer triangles; with `voxel` [m], made by marching cubes."""

    version, precision = pyvista.__version__, "float32"

    def __init__(self, job: dict[str, Any]) -> None:
        self._fine = pyvista.PolyData.from_regular_faces(job["points"], job["facets"])
        self._job = job

    def advance(self, _num_steps: int) -> None:
        """Make the surface."""
        drawn = self._flying_edges() if "voxel" in self._job else self._decimated()
        self.result = {"points": np.asarray(drawn.points, float), "facets": drawn.regular_faces}

    def _decimated(self) -> Any:
        return self._fine.decimate(1.0 - int(self._job["size"]) / self._fine.n_cells)

    def _flying_edges(self) -> Any:
        voxel = float(self._job["voxel"])
        low, high = (getattr(self._job["points"], end)(axis=0) for end in ("min", "max"))
        counts = np.ceil((high - low) / voxel).astype(int) + 4
        grid = pyvista.ImageData(
            dimensions=counts.tolist(), spacing=(voxel,) * 3, origin=(low - 1.53 * voxel).tolist()
        )
        distance = grid.compute_implicit_distance(self._fine)
        return distance.contour([0.0], scalars="implicit_distance", method="flying_edges")
