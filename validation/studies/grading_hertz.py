"""A sphere pressed into a block: the scene with contact of the study of graded meshes."""

from __future__ import annotations

import numpy as np

from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.problem import Problem, Strain
from palpate.validation.studies.contact_hertz import (
    RADIUS,
    contact_radius,
    kuhn_cube,
    sphere_into_block,
)
from palpate.validation.studies.grading_curves import Scene, Solved

DEPTH = 0.05 * RADIUS
# A quarter block of twenty contact radii: the finest uniform mesh has about one edge to a contact
# radius, of the coarsest (each side cut in four) a single point touches.
SIDE = 20.0 * contact_radius(DEPTH)
_FIRST_BISECTIONS = 6


def hertz_scene() -> Scene:
    """Judged by displacement and contact force."""
    coarse = GradedMesh(kuhn_cube(SIDE))
    for _ in range(_FIRST_BISECTIONS):
        coarse.refine(np.ones(len(coarse.cells), dtype=bool))
    return Scene(
        title="sphere into a block",
        quantity="contact force",
        problem=sphere_into_block(coarse.mesh, np.array([0.0, DEPTH])),
        solve=_solve,
        solve_truth=_solve_truth,
        most_cells={"uniform": 150_000, "graded": 45_000},
        truth_cells=4_000,
        truth_ratio=1.8,
    )


def _solve(problem: Problem) -> Solved:
    found = solve_contact(problem)
    return found.displacements[-1], float(np.linalg.norm(found.forces[-1, 0]))


def _solve_truth(problem: Problem) -> Solved:
    from palpate.reference.child import solve_static_in_child

    found = solve_static_in_child(problem, strain=Strain.GREEN, degree=2)
    return found.displacement, float(np.linalg.norm(found.tools[0].forces[-1]))
