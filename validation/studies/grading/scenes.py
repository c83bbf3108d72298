"""The kidney pushed on a small patch, and a sphere pressed into a block."""

from __future__ import annotations

import numpy as np

from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.mesher import mesh_surface
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import held
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem
from palpate.validation.studies.bodies import volume_change
from palpate.validation.studies.closed_forms import contact_radius
from palpate.validation.studies.contact.sphere import RADIUS, quarter_cube, sphere_into_block
from palpate.validation.studies.grading.curves import Scene, Solved

COARSE_EDGE = 12e-3  # [m]
PATCH_RADIUS = 14e-3  # [m]: about a fingertip
FORCE = (-0.15, 0.04, -0.06)  # [N]: 1.6 mm deep; not along an axis, so that faults show
MATERIAL = Material(10e3, 0.3)
DEPTH = 0.05  # radii
# A quarter block of twenty contact radii: the finest uniform mesh has about one edge to a contact
# radius, of the coarsest (each side cut in four) a single point touches.
WIDTH = 20.0 * contact_radius(DEPTH * RADIUS, RADIUS)
_FIRST_BISECTIONS = 6


def push_scene() -> Scene:
    """The kidney, its lower half held, pushed on a patch of the upper half's side."""
    mesh = mesh_surface(shape_kidney(edge_length=COARSE_EDGE))
    facets = mesh.boundary_facets
    corners = mesh.points[facets]
    foot = held(facets[(corners[:, :, 2] <= 0.0).all(axis=1)])
    middle = mesh.points[np.argmax(mesh.points @ np.array([1.0, 0.0, 0.6]))]
    near = np.linalg.norm(corners.mean(axis=1) - middle, axis=1) < PATCH_RADIUS
    a, b, c = corners[near].transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    x, y, z = (np.array(FORCE) / area).tolist()
    problem = Problem(mesh, MATERIAL, (foot,), (Traction(facets[near], (x, y, z)),))

    def solve(problem: Problem) -> Solved:
        displacement = solve_static(problem).displacement
        return displacement, volume_change(problem.mesh, displacement)

    def solve_truth(problem: Problem) -> Solved:
        from palpate.reference.child import solve_static_in_child

        found = solve_static_in_child(problem, degree=2)
        return found.displacement, found.volume / problem.mesh.volume - 1.0

    title = "kidney pushed on a patch"
    return Scene(title, "change of volume", problem, solve, solve_truth, 32_000, 2.2)


def hertz_scene() -> Scene:
    """A sphere pressed into a quarter block."""
    coarse = GradedMesh(quarter_cube(WIDTH))
    for _ in range(_FIRST_BISECTIONS):
        coarse.refine(np.ones(len(coarse.cells), dtype=bool))
    problem = sphere_into_block(coarse.mesh, (0.0, DEPTH))

    def solve(problem: Problem) -> Solved:
        found = solve_contact(problem)
        return found.displacements[-1], float(np.linalg.norm(found.forces[-1, 0]))

    def solve_truth(problem: Problem) -> Solved:
        from palpate.reference.child import solve_static_in_child

        found = solve_static_in_child(problem, degree=2)
        return found.displacement, float(np.linalg.norm(found.tools[0].forces[-1]))

    title = "sphere into a block"
    return Scene(title, "contact force", problem, solve, solve_truth, 4_000, 1.8)
