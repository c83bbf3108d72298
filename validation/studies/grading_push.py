"""The kidney pushed on a small patch: the scene of the study of graded meshes."""

from __future__ import annotations

import numpy as np

from palpate.fastsim.mesher import mesh_surface
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.studies.grading_curves import Scene, Solved

COARSE_EDGE = 12e-3  # [m]
PATCH_RADIUS = 14e-3  # [m]: about a fingertip
FORCE = (-0.15, 0.04, -0.06)  # [N]: 1.6 mm deep; not along an axis, so that faults show
MATERIAL = Material(10e3, 0.3)


def push_scene() -> Scene:
    """Judged by displacement and change of volume."""
    return Scene(
        title="kidney pushed on a patch",
        quantity="change of volume",
        problem=make_problem(),
        solve=_solve,
        solve_truth=_solve_truth,
        most_cells={"uniform": 150_000, "graded": 45_000},
        truth_cells=32_000,
        truth_ratio=2.2,
    )


def make_problem() -> Problem:
    """The kidney, its lower half held, pushed on a patch of the upper half's side."""
    mesh = mesh_surface(shape_kidney(edge_length=COARSE_EDGE))
    facets = mesh.boundary_facets
    corners = mesh.points[facets]
    held = facets[(corners[:, :, 2] <= 0.0).all(axis=1)]
    middle = mesh.points[np.argmax(mesh.points @ np.array([1.0, 0.0, 0.6]))]
    near = np.linalg.norm(corners.mean(axis=1) - middle, axis=1) < PATCH_RADIUS
    edges = corners[near]
    area = 0.5 * np.linalg.norm(
        np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1
    )
    x, y, z = np.array(FORCE) / area.sum()
    return Problem(
        mesh,
        MATERIAL,
        (Support(np.unique(held), held),),
        (Traction(facets[near], (float(x), float(y), float(z))),),
    )


def _solve(problem: Problem) -> Solved:
    displacement = solve_static(problem).displacement
    mesh = problem.mesh
    return displacement, mesh.surface(displacement).volume / mesh.volume - 1.0


def _solve_truth(problem: Problem) -> Solved:
    from palpate.reference.child import solve_static_in_child

    found = solve_static_in_child(problem, strain=Strain.GREEN, degree=2)
    return found.displacement, found.volume / problem.mesh.volume - 1.0
