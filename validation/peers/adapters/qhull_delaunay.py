"""Qhull's Delaunay tetrahedra, through SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
import scipy.spatial


class Delaunay:
    """From points to cells."""

    version, precision = scipy.__version__, "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._points = job["points"]

    def advance(self, _num_steps: int) -> None:
        """Hull of the points lifted to a paraboloid."""
        cells = scipy.spatial.Delaunay(self._points).simplices
        self.answer = {"num_cells": np.array(len(cells))}
