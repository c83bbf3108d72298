"""Bodies that touch each other, or themselves, in explicit motion: a penalty on material depth.

Boundary vertices inside cells, found by the spatial hash, are pushed out by the depth that the
place has at rest (see core/contact/body_touch.hpp); a vertex past the middle of a body goes out
behind. Bodies are the parts of one mesh that share no point. The penalty k A of a vertex acts on
it and on the cell's corners:

    omega^2 <= omega_body^2 + 4 max k A / m

where up to two vertices press on a cell at a time. Momentum and moment are kept to rounding.
"""

from __future__ import annotations

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.collision.detection import VertexCellDetector
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
from palpate.meshes.rigid_modes import connected_parts
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
        critical_time_step: Of the bodies alone [s].
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
            connected_parts(mesh).astype(np.int32),
            self.stiffness * self._areas,
            chosen_instruction_set(),
        )


def overlap_depths(mesh: TetMesh, displacement: Points) -> tuple[Indices, Points]:
    """Boundary vertices inside a cell, and how deep: ascending, shape (n,), and [m], shape (n,)."""
    found = VertexCellDetector(mesh).find(mesh.points + displacement)
    vertices, first = np.unique(found.vertices, return_index=True)
    cells = mesh.cells[found.cells[first]]
    places = (found.weights[first][:, :, None] * mesh.points[cells]).sum(axis=1)
    part, depths = connected_parts(mesh), np.zeros(len(vertices))
    for number in np.unique(part[cells[:, 0]]):
        facets = mesh.boundary_facets[part[mesh.boundary_facets[:, 0]] == number]
        surface = _core.SurfaceDistance(np.array(mesh.points), np.ascontiguousarray(facets))
        here = part[cells[:, 0]] == number
        depths[here] = surface.distances(np.ascontiguousarray(places[here]))
    return vertices.astype(np.int32), depths
