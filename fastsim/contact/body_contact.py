"""Contact of bodies with each other or themselves: detection by a spatial hash, and the penalty.

Boundary vertices inside cells, found by the spatial hash, are pushed out in explicit motion by a
penalty on the depth which that material point has at rest (see core/contact/body_touch.hpp); a
vertex past the middle of a body leaves it on the other side. Bodies are the parts of one mesh that
share no point. The penalty k A of a vertex acts on it and on the cell's corners:

    omega^2 <= omega_body^2 + 4 max k A / m

where up to two vertices press on a cell at a time. Momentum and moment are conserved to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.contact.contact_law import (
    ContactForm,
    ContactLaw,
    critical_with_penalty,
    explicit_stiffness,
    layer_stiffness,
)
from palpate.fastsim.explicit_run import ExplicitRun
from palpate.fastsim.forces import lumped_areas
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_modes import parts_of_mesh
from palpate.meshes.tet_mesh import TetMesh

# Largest omega^2 over k A / m: up to two vertices press on a cell at a time.
_PRESSING = 4.0


class BodyContact:
    """Contact of all parts of a problem's mesh with each other and themselves.

    Args:
        problem: Mesh and material.
        law: A penalty; its stiffness None is the smaller of ten layers of cells and what the time
            step bears.
        mass: Lumped [kg], shape (num_points,).
        critical_time_step: Critical time step of the bodies alone [s].
        time_step: Chosen step [s], or None.

    Attributes:
        stiffness: k [Pa/m].
        critical_time_step: With the penalty [s].

    Raises:
        InputError: The constraint form.
        UnstableStepError: The step leaves no room for any penalty.
    """

    def __init__(
        self,
        problem: Problem,
        law: ContactLaw,
        mass: Floats,
        *,
        critical_time_step: float,
        time_step: float | None,
    ) -> None:
        if law.form is not ContactForm.PENALTY:
            raise InputError("contact between bodies needs the penalty form")
        mesh = problem.mesh
        self._mesh = mesh
        self._vertices = np.unique(mesh.boundary_facets).astype(np.int32)
        self._areas = lumped_areas(mesh, mesh.boundary_facets)[self._vertices]
        lightest = float((mass[self._vertices] / self._areas).min())
        layer = layer_stiffness(problem, mesh.boundary_facets)
        self.stiffness = explicit_stiffness(
            law, layer, lightest, critical_time_step, time_step, pressing=_PRESSING
        )
        self.critical_time_step = critical_with_penalty(
            critical_time_step, _PRESSING * self.stiffness / lightest
        )

    def attach(self, run: ExplicitRun) -> None:
        """Give the contact to a run."""
        mesh = self._mesh
        run.set_self_contact(
            np.ascontiguousarray(mesh.points),
            np.ascontiguousarray(mesh.cells),
            self._vertices,
            np.ascontiguousarray(mesh.boundary_facets),
            parts_of_mesh(mesh).astype(np.int32),
            self.stiffness * self._areas,
            chosen_instruction_set(),
        )


def overlap_depths(mesh: TetMesh, displacement: Points) -> tuple[Indices, Points]:
    """Boundary vertices inside a cell, and how deep: ascending, shape (n,), and [m], shape (n,)."""
    found = VertexCellDetector(mesh).find(mesh.points + displacement)
    vertices, first = np.unique(found.vertices, return_index=True)
    cells = mesh.cells[found.cells[first]]
    positions = (found.weights[first][:, :, None] * mesh.points[cells]).sum(axis=1)
    part, depths = parts_of_mesh(mesh), np.zeros(len(vertices))
    for number in np.unique(part[cells[:, 0]]):
        facets = mesh.boundary_facets[part[mesh.boundary_facets[:, 0]] == number]
        surface = _core.SurfaceDistance(np.array(mesh.points), np.ascontiguousarray(facets))
        here = part[cells[:, 0]] == number
        depths[here] = surface.distances(np.ascontiguousarray(positions[here]))
    return vertices.astype(np.int32), depths


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Vertices found in cells.

    Attributes:
        vertices: Point of the intruding body, ascending, shape (n,).
        cells: Cell that contains it, shape (n,).
        weights: Barycentric weights of the cell's corners [-], >= 0, sum 1, shape (n, 4).
    """

    vertices: Indices
    cells: Indices
    weights: Floats

    def __len__(self) -> int:
        return len(self.vertices)


class VertexCellDetector:
    """Finds boundary vertices of one body in the cells of another, step after step (section IV).

    Boundary vertices are hashed into voxels (after Teschner et al. 2003) that fit the cells; a mesh
    with cells of several sizes has several voxel sizes, a factor of two or more apart. Cells lie in
    compact blocks; in each step only blocks near vertices of the other body are searched.

    A vertex is in a cell when it is in the cell's box and no barycentric weight, as computed, is
    negative; a cell that is inverted at the time contains nothing. A vertex on the side between two
    cells is found in either or both. Nothing is assumed of how far points move in a step.

    Args:
        mesh: Body whose cells are searched.
        intruder: Body whose boundary vertices are sought; None is the same body, whose own
            corners do not count.
        num_threads: At least 1; they wait between calls. What is found does not depend on it.
    """

    def __init__(
        self, mesh: TetMesh, intruder: TetMesh | None = None, *, num_threads: int = 1
    ) -> None:
        self._mesh = mesh
        self._intruder = mesh if intruder is None else intruder
        self._vertices = np.unique(self._intruder.boundary_facets).astype(np.int32)
        self._core = _core.VerticesInCells(
            mesh.points,
            mesh.cells,
            self._vertices,
            intruder is None,
            at_least_one(num_threads),
            chosen_instruction_set(),
        )

    @property
    def voxel_sizes(self) -> list[float]:
        """Sides of the voxels used [m], ascending."""
        return list(self._core.voxel_sizes())

    @property
    def work(self) -> dict[str, int]:
        """Counts of the last step: vertices hashed, cells near vertices, and pairs tested."""
        names = ("hashed", "cells_near", "pairs_tested")
        return dict(zip(names, map(int, self._core.work()), strict=True))

    def find(self, points: Points, intruder_points: Points | None = None) -> Overlaps:
        """Find all overlaps where the bodies are now.

        Args:
            points: Points of the body with the cells [m], shape (num_points, 3).
            intruder_points: Intruder points of the other body [m]; None for the same body.

        Raises:
            InputError: Wrong shape.
            NonFiniteError: A point of the cells or a boundary vertex is NaN or infinite.
        """
        here, there = self._arrays(points, intruder_points)
        pairs, weights = self._core.find(there, here)
        return Overlaps(pairs[:, 0], pairs[:, 1], weights)

    def find_by_brute_force(
        self, points: Points, intruder_points: Points | None = None
    ) -> Overlaps:
        """Test every vertex against every cell, to verify `find`, whose arguments it takes."""
        here, there = self._arrays(points, intruder_points)
        pairs, weights = _core.find_vertices_in_cells_brute_force(
            there, self._vertices, here, self._mesh.cells, self._intruder is self._mesh
        )
        return Overlaps(pairs[:, 0], pairs[:, 1], weights)

    def _arrays(self, points: Points, intruder_points: Points | None) -> tuple[Points, Points]:
        here = shaped_as(self._mesh.points, points)
        if intruder_points is None:
            if self._intruder is not self._mesh:
                raise InputError("two bodies: give the points of the intruder as well")
            return here, here
        return here, shaped_as(self._intruder.points, intruder_points)


def at_least_one(num_threads: int) -> int:
    """The number of threads; less than one is refused."""
    if num_threads < 1:
        raise InputError(f"num_threads = {num_threads}; it must be at least 1")
    return num_threads


def shaped_as(rest: Points, points: Points) -> Points:
    """Points as the core needs them; a shape other than that at rest is refused."""
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.shape != rest.shape:
        raise InputError(f"points need shape {rest.shape}, got {array.shape}")
    return array
