"""Delaunay tetrahedra by CGAL, through its Python module."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np
from CGAL.CGAL_Kernel import Point_3
from CGAL.CGAL_Triangulation_3 import Delaunay_triangulation_3


class Delaunay:
    """CGAL gets the points beforehand, as its own objects."""

    version, precision = version("cgal"), "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._points = [Point_3(*row) for row in job["points"].tolist()]

    def advance(self, _num_steps: int) -> None:
        """From points to cells."""
        self._cells = Delaunay_triangulation_3(self._points)

    @property
    def result(self) -> dict[str, Any]:
        """The number of cells; CGAL goes through all of them to count."""
        return {"num_cells": np.array(self._cells.number_of_finite_cells())}
