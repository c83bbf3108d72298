"""Saint-Venant-Kirchhoff with the displacement gradient transposed: a slip that is easily made.

Small strains do not show it, nor does a stretch along the axes: shear and rotation do. The wrong
force R'(u) is solved by deferred correction: each time the right problem, with the difference of
the two forces as an extra load.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.exchange.nodal_loads import cell_materials
from palpate.validation.metrics.elasticity import (
    displacement_gradients,
    internal_force,
    shape_gradients,
)

_MOST_CORRECTIONS = 60
_TOLERANCE = 1e-9


def transposed_force(problem: Problem, displacement: Points) -> Points:
    """Nodal force with H^T in the place of H = grad u [N], (num_points, 3)."""
    mesh = problem.mesh
    E, nu = cell_materials(problem)[:, :2].T
    lmbda, mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
    F = np.eye(3) + displacement_gradients(mesh, displacement).transpose(0, 2, 1)
    green = 0.5 * (np.einsum("cki,ckj->cij", F, F) - np.eye(3))
    S = 2.0 * mu[:, None, None] * green
    S += (lmbda * np.einsum("cii->c", green))[:, None, None] * np.eye(3)
    volumes = signed_volumes(mesh.points, mesh.cells)
    force = np.zeros_like(mesh.points)
    np.add.at(force, mesh.cells, np.einsum("c,cij,caj->cai", volumes, F @ S, shape_gradients(mesh)))
    return force


def solve_transposed(problem: Problem) -> tuple[Points, int]:
    """Displacement [m] of the wrong equilibrium, and how many corrections it took.

    Raises:
        FastsimError: A corrected problem has no equilibrium.
        RuntimeError: The corrections do not converge.
    """
    from palpate.fastsim.statics import solve_static

    everywhere = np.arange(problem.mesh.num_points, dtype=np.int32)
    u = solve_static(problem, strain=Strain.GREEN).displacement
    for correction in range(1, _MOST_CORRECTIONS + 1):
        extra = internal_force(problem, u, Strain.GREEN) - transposed_force(problem, u)
        loads = (*problem.loads, PointForce(everywhere, extra))
        corrected = dataclasses.replace(problem, loads=loads)
        new = solve_static(corrected, strain=Strain.GREEN, start=u).displacement
        change = float(np.abs(new - u).max() / np.abs(new).max())
        u = new
        if change <= _TOLERANCE:
            return u, correction
    raise RuntimeError(f"the corrections do not converge: {change:.2g} in the last")
