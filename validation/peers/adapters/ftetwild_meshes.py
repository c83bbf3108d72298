"""fTetWild: tetrahedra near a surface, by pytetwild, on one thread; facets are not kept."""

from __future__ import annotations

import contextlib
import tempfile
from typing import Any

import numpy as np
from pytetwild import __version__, tetrahedralize


class Mesh:
    """A surface filled with tetrahedra within an envelope around it."""

    version, precision = __version__, "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._points, self._facets = job["points"], job["facets"].astype(np.int32)
        corners = self._points[self._facets]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        self._edge_length = float(edges.mean() * job["edges"])
        self._epsilon = float(job["epsilon"])

    def advance(self, _num_steps: int) -> None:
        """Mesh from the surface in memory to the cells there."""
        # It writes a file, __tracked_surface.stl, where it is.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            points, cells = tetrahedralize(
                self._points,
                self._facets,
                edge_length_abs=self._edge_length,
                epsilon=self._epsilon,
                num_threads=1,
                vtk_ordering=True,  # its own turns cells the other way round
            )
        self.result = {"points": points, "cells": cells}
