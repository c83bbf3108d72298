"""gmsh on one thread: triangles on a body, tetrahedra in a surface, Delaunay of points."""

from __future__ import annotations

import math
from typing import Any

import gmsh
import numpy as np


class _Gmsh:
    version, precision = gmsh.__version__, "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        gmsh.initialize([], interruptible=False)
        for name, value in (("Verbosity", 1), ("NumThreads", 1)):
            gmsh.option.setNumber(f"General.{name}", value)
        self._job = job

    def _add_surface(self) -> None:
        points, facets = self._job["points"], self._job["facets"]
        gmsh.model.addDiscreteEntity(2, 1)
        tags = np.arange(1, len(points) + 1)
        gmsh.model.mesh.addNodes(2, 1, tags.tolist(), points.ravel().tolist())
        gmsh.model.mesh.addElementsByType(1, 2, [], (facets + 1).ravel().tolist())

    def _elements(self, kind: int, num_corners: int) -> tuple[Any, Any]:
        """Points and corners of all elements of a type: 2 triangles, 4 tetrahedra."""
        numbers, coordinates, _ = gmsh.model.mesh.getNodes()
        _, connectivity = gmsh.model.mesh.getElementsByType(kind)
        order = np.argsort(numbers)
        corners = np.searchsorted(numbers[order], connectivity).reshape(-1, num_corners)
        return coordinates.reshape(-1, 3)[order], corners.astype(np.int32)


class Surface(_Gmsh):
    """A surface that is remeshed with triangles of one size."""

    def advance(self, _num_steps: int) -> None:
        """Cut it into patches, and mesh those."""
        self._add_surface()
        gmsh.model.mesh.classifySurfaces(math.pi, True, True, math.pi)
        gmsh.model.mesh.createGeometry()
        for name in ("MeshSizeMin", "MeshSizeMax"):
            gmsh.option.setNumber(f"Mesh.{name}", float(self._job["edge_length"]))
        gmsh.model.mesh.generate(2)
        self.result = dict(zip(("points", "facets"), self._elements(2, 3), strict=True))


class Mesh(_Gmsh):
    """A surface filled with tetrahedra."""

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job)
        gmsh.option.setNumber("Mesh.Algorithm3D", int(job["algorithm"]))
        gmsh.option.setNumber("Mesh.Optimize", 1)
        gmsh.option.setNumber("Mesh.OptimizeNetgen", int(job["netgen"]))
        self._add_surface()
        gmsh.model.geo.addSurfaceLoop([1], 1)
        gmsh.model.geo.addVolume([1], 1)
        gmsh.model.geo.synchronize()

    def advance(self, _num_steps: int) -> None:
        """Mesh from the surface in gmsh's memory to the mesh there."""
        gmsh.model.mesh.generate(3)

    @property
    def result(self) -> dict[str, Any]:
        """Points and cells."""
        return dict(zip(("points", "cells"), self._elements(4, 4), strict=True))


class Delaunay(_Gmsh):
    """Its Delaunay tetrahedra of points."""

    def advance(self, _num_steps: int) -> None:
        """From points to cells."""
        cells, *_ = gmsh.algorithm.tetrahedralize(self._job["points"].ravel())
        self.result = {"num_cells": np.array(len(cells) // 4)}
