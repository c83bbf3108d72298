"""Parts of the body that a goal is about: stress in some cells, force through a support or a cut.

However fine the mesh that was solved on, stress is told by the means of Cauchy's over the cells of
the case's mesh, and a force through a cut by those of the first Piola-Kirchhoff stress P, whose
nodal forces are V P grad N with the linear shape functions N of the case's points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference.result import ReferenceResult

# Largest force of a support over the sum of all nodal forces' sizes, below which it is none.
_NO_FORCE = 1e-4


@dataclass(frozen=True, eq=False)
class Part:
    """Where on the case's mesh a goal looks.

    Attributes:
        cells: Whose stress counts, (n,); none for a force.
        weights: Of a cut, how much of each component of a nodal force counts [-], (num_points, 3).
        support: Number of the support whose force counts; None for a cut.
    """

    cells: Indices
    weights: Points
    support: int | None = None

    def is_inside(self, mesh: TetMesh) -> Floats:
        """1 in the cells whose stress counts, 0 in the others, (num_cells,)."""
        inside = np.zeros(mesh.num_cells)
        inside[self.cells] = 1.0
        return inside


def stress_apart(
    mesh: TetMesh, fine: ReferenceResult, coarse: ReferenceResult, part: Part
) -> tuple[float, float]:
    """L2 norms [Pa m^(3/2)] of two states' difference in Cauchy's stress, and of the finer's.

    Along the axes of space, so that a difference in how far a cell is turned counts too.
    """
    volumes = signed_volumes(mesh.points, mesh.cells)[part.cells]

    def norm(stress: Floats) -> float:
        return math.sqrt(float(volumes @ np.einsum("cij,cij->c", stress, stress)))

    own, other = (state.cauchy_stress[part.cells] for state in (fine, coarse))
    return norm(own - other), norm(own)


def force_apart(
    mesh: TetMesh, fine: ReferenceResult, coarse: ReferenceResult, part: Part
) -> tuple[float, float]:
    """Size of two states' difference in force [N], and the largest force of a support.

    1 N where every support is balanced in itself.
    """
    own, other = (_nodal_forces(mesh, state) for state in (fine, coarse))
    apart = (part.weights * (own - other)).sum(axis=0)
    if part.support is not None:
        apart = fine.support_forces[part.support] - coarse.support_forces[part.support]
    largest = float(np.linalg.norm(fine.support_forces, axis=1).max(initial=0.0))
    is_force = largest > _NO_FORCE * float(np.linalg.norm(own, axis=1).sum())
    return float(np.linalg.norm(apart)), largest if is_force else 1.0


def _nodal_forces(mesh: TetMesh, state: ReferenceResult) -> Points:
    volumes = signed_volumes(mesh.points, mesh.cells)
    P = state.first_piola_kirchhoff_stress
    by_corner = volumes[:, None, None] * _shape_gradients(mesh) @ P.transpose(0, 2, 1)
    forces = np.zeros_like(mesh.points)
    np.add.at(forces, mesh.cells, by_corner)
    return forces


def _shape_gradients(mesh: TetMesh) -> Floats:
    """Gradients of the corners' linear shape functions [1/m], (num_cells, 4, 3)."""
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    gradients: Floats = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    return gradients
