"""Supports and loads of a problem on a refined mesh."""

from __future__ import annotations

import dataclasses

import numpy as np

from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.arrays import Indices
from palpate.meshes.boundary_conditions import Load, Pressure, Support, Traction
from palpate.meshes.problem import Problem


def carry_problem(problem: Problem, graded: GradedMesh) -> Problem:
    """The same problem on the refined mesh: the same regions are held and pushed.

    Forces on single points stay on their points, which keep their numbers.

    Args:
        problem: On the mesh that `graded` began with.
        graded: That mesh, refined.
    """

    def carried_support(support: Support) -> Support:
        facets = graded.carry_facets(support.facets) if len(support.facets) else support.facets
        points: Indices = np.union1d(graded.carry_points(support.points), facets).astype(np.int32)
        return dataclasses.replace(support, points=points, facets=facets)

    def carried_load(load: Load) -> Load:
        if isinstance(load, Traction | Pressure):
            return dataclasses.replace(load, facets=graded.carry_facets(load.facets))
        return load

    return dataclasses.replace(
        problem,
        mesh=graded.mesh,
        supports=tuple(carried_support(s) for s in problem.supports),
        loads=tuple(carried_load(load) for load in problem.loads),
    )
