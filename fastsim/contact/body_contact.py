"""Bodies that touch each other, or themselves, in explicit motion: a penalty on material depth.

Boundary vertices inside cells, found by the spatial hash, are pushed out along the gradient of the
depth that the cell's points have at rest (see core/contact/body_touch.hpp). Bodies are the parts of
one mesh that share no point. The penalty k A of a vertex acts on it and on the cell's corners:

    omega^2 <= omega_body^2 + 4 max k A / m

where up to two vertices press on a cell at a time. Momentum and moment are kept to rounding.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.errors import UnstableStepError
from palpate.fastsim.forces import lame_parameters
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh

# Cells' layers as stiff as the default penalty, and what the step may shrink by: see contact_law.
_LAYERS = 0.1
_SHARE_OF_SQUARED_FREQUENCY = 0.5625
_SHARE_OF_BOUND = 0.9
_PRESSING = 4.0


class BodyContact:
    """Contact of all parts of a problem's mesh with each other and themselves.

    Args:
        problem: Its mesh needs points inside: a body of one layer of cells has no depth.
        law: A penalty; its stiffness None is the smaller of ten layers of cells and what the time
            step bears.
        mass: Lumped [kg], shape (num_points,).
        critical_time_step: Of the bodies alone [s].
        time_step: Chosen step [s], or None.

    Attributes:
        stiffness: k [Pa/m].
        critical_time_step: With the penalty [s].

    Raises:
        InputError: The constraint form, or a mesh without a point inside.
        UnstableStepError: The step leaves no room for any penalty.
    """

    def __init__(
        self,
        problem: Problem,
        law: ContactLaw,
        mass: Points,
        *,
        critical_time_step: float,
        time_step: float | None,
    ) -> None:
        if law.form is not ContactForm.PENALTY:
            raise InputError("contact between bodies needs the penalty form")
        mesh = problem.mesh
        self._mesh = mesh
        self._depths = material_depths(mesh)
        if not self._depths.any():
            raise InputError(
                "contact between bodies needs points inside them; the mesh has none: refine it"
            )
        corners = mesh.points[mesh.boundary_facets]
        area = 0.5 * np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        lumped = np.zeros(mesh.num_points)
        for k in range(3):
            np.add.at(lumped, mesh.boundary_facets[:, k], area / 3.0)
        self._vertices = np.unique(mesh.boundary_facets).astype(np.int32)
        self._areas = lumped[self._vertices]
        lightest = float((mass[self._vertices] / self._areas).min())
        squared = (2.0 / critical_time_step) ** 2
        if law.stiffness is not None:
            self.stiffness = law.stiffness
        else:
            room = _SHARE_OF_SQUARED_FREQUENCY * squared
            if time_step is not None:
                room = _SHARE_OF_BOUND * (2.0 / time_step) ** 2 - squared
                if room <= 0.0:
                    raise UnstableStepError(
                        time_step, float(np.sqrt(_SHARE_OF_BOUND)) * critical_time_step
                    )
            lmbda, mu = lame_parameters(problem.material)
            edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
            layer = (lmbda + 2.0 * mu) / float(edges.mean())
            self.stiffness = min(layer / _LAYERS, room * lightest / _PRESSING)
        added = _PRESSING * self.stiffness / lightest
        self.critical_time_step = float(2.0 / np.sqrt(squared + added))

    def attach(self, run: _core.ExplicitRun32 | _core.ExplicitRun64) -> None:
        """Give the contact to a run."""
        mesh = self._mesh
        run.set_body_touch(
            np.ascontiguousarray(mesh.points),
            np.ascontiguousarray(mesh.cells),
            self._vertices,
            self._depths,
            self.stiffness * self._areas,
            chosen_instruction_set(),
        )


def material_depths(mesh: TetMesh) -> NDArray[np.float64]:
    """Distance of each point at rest to the boundary of its own body [m], shape (num_points,)."""
    part = parts(mesh)
    depths = np.zeros(mesh.num_points)
    facets = mesh.boundary_facets
    inside = np.setdiff1d(np.arange(mesh.num_points), facets)
    for number in np.unique(part):
        own = np.ascontiguousarray(facets[part[facets[:, 0]] == number])
        here = inside[part[inside] == number]
        if len(here):
            searched = _core.SurfaceDistance(np.array(mesh.points), own)
            depths[here] = searched.closest(np.ascontiguousarray(mesh.points[here]))[1]
    return depths


def parts(mesh: TetMesh) -> NDArray[np.int64]:
    """Number of the body each point belongs to: its smallest point."""
    number = np.arange(mesh.num_points)
    while True:
        least = number[mesh.cells].min(axis=1)
        after = number.copy()
        for k in range(4):
            np.minimum.at(after, mesh.cells[:, k], least)
        # Each point also takes the number of the one it is called after.
        after = after[after]
        if np.array_equal(after, number):
            return number
        number = after
