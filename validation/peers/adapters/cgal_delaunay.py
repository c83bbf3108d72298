"""CGAL's Delaunay tetrahedra, through its Python bindings."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np
from CGAL.CGAL_Kernel import Point_3
from CGAL.CGAL_Triangulation_3 import Delaunay_triangulation_3


class Delaunay:
    """Its points are made beforehand."""

    version, precision = version("cgal"), "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._points = [Point_3(*row) for row in job["points"].tolist()]

    def advance(self, _num_steps: int) -> None:
        """From points to cells."""
        self._cells = Delaunay_triangulation_3(self._points)

    @property
    def answer(self) -> dict[str, Any]:
        """How many cells; it goes through all of them for that."""
        return {"num_cells": np.array(self._cells.number_of_finite_cells())}
