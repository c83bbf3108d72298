"""TetGen: tetrahedra in a surface, and Delaunay of points."""

from __future__ import annotations

from typing import Any

import numpy as np
from tetgen import __version__, _tetgen


class _TetGen:
    version, precision = __version__, "float64"
    switches = ""

    def __init__(self, job: dict[str, Any]) -> None:
        self._mesher = _tetgen.PyTetgen()
        facets = job.get("facets", np.empty((0, 3), dtype=np.int32))
        self._mesher.load_mesh(job["points"], facets)

    def advance(self, _num_steps: int) -> None:
        """Mesh from the input in TetGen's memory to the cells there."""
        self._mesher.tetrahedralize(switches_str=self.switches)


class Mesh(_TetGen):
    """A surface filled with tetrahedra of bounded radius-edge ratio."""

    switches = "pq1.2YQ"

    @property
    def result(self) -> dict[str, Any]:
        """Points and cells."""
        return {"points": self._mesher.return_nodes(), "cells": self._mesher.return_tets()}


class Delaunay(_TetGen):
    """Delaunay tetrahedra of points."""

    switches = "Q"

    @property
    def result(self) -> dict[str, Any]:
        """The number of cells."""
        return {"num_cells": np.array(self._mesher.n_cells)}
