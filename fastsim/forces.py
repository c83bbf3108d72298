"""Loads as nodal forces (the F of eq. 1)."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.triangles import facet_areas, facet_normals


def external_force(problem: Problem, displacement: Points | None = None) -> Points:
    """Consistent nodal forces of all loads [N], shape (num_points, 3).

    A uniform traction gives a third of its facet's force to each corner, a body force a quarter of
    its cell's; of a traction that varies, up to quadratically, the corners' parts are exact.
    Pressure acts on the facets as displaced, so it needs the displacement.

    Args:
        problem: Mesh and loads.
        displacement: Where the pressure acts [m]; None is the rest state.

    Raises:
        InputError: A load that is not finite.
    """
    mesh = problem.mesh
    force = np.zeros_like(mesh.points)
    for number, load in enumerate(problem.loads, start=1):
        match load:
            case Traction():
                areas = facet_areas(mesh.points[load.facets])
                if load.is_uniform:
                    parts = np.broadcast_to(np.asarray(load.traction) / 3.0, (len(areas), 3, 3))
                else:
                    parts = _mean_with_corners(mesh.points[load.facets], load)
                for k in range(3):
                    np.add.at(force, load.facets[:, k], areas[:, None] * parts[:, k])
            case Pressure():
                points = mesh.points if displacement is None else mesh.points + displacement
                corner = -load.pressure * (0.5 * facet_normals(points[load.facets])) / 3.0
                for k in range(3):
                    np.add.at(force, load.facets[:, k], corner)
            case PointForce():
                np.add.at(force, load.points, load.forces)
            case BodyForce():
                quarter = mesh.cell_volumes[:, None] / 4.0
                corner = quarter * np.asarray(load.force_density)
                for axis in range(3):
                    force[:, axis] += sum_at_points(corner[:, axis], mesh.cells, mesh.num_points)
        if not np.isfinite(force).all():
            raise InputError(f"load {number} ({type(load).__name__}) is NaN or infinite")
    return force


def sum_at_points(values: Floats, rows: Indices, num_points: int) -> Floats:
    """Sum at each point of the values of the cells or facets that contain it, (num_points,)."""
    sums = np.bincount(rows.T.ravel(), np.tile(values, rows.shape[1]), minlength=num_points)
    return np.asarray(sums, dtype=np.float64)


def lumped_areas(mesh: TetMesh, facets: Indices) -> Floats:
    """Rest area of these facets at points, a third for each corner [m2], shape (num_points,)."""
    third = facet_areas(mesh.points[facets]) / 3.0
    return sum_at_points(third, facets, mesh.num_points)


def _mean_with_corners(corners: Floats, load: Traction) -> Floats:
    """Mean over each facet of a corner's shape function times the traction [Pa], (m, 3, 3).

    A quadratic t is its six values at corners and middles of edges in the quadratic basis; with
    int L1^a L2^b L3^c dA = 2 A a! b! c! / (2 + a + b + c)! the means of L_a times the basis are
    1/30 at the own corner, -1/60 at others, 2/15 on edges that meet there, 1/15 on the one across.
    """
    t = load.at(corners)
    m = load.at(0.5 * (corners + np.roll(corners, -1, axis=1)))  # of the edges 01, 12, 20
    parts: Floats = np.empty_like(t)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        parts[:, a] = t[:, a] / 30.0 - (t[:, b] + t[:, c]) / 60.0
        parts[:, a] += 2.0 / 15.0 * (m[:, a] + m[:, c]) + m[:, b] / 15.0
    return parts
