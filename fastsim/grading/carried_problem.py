"""Supports, loads, tools, springs and inclusions of a problem on a refined mesh."""

from __future__ import annotations

import dataclasses

import numpy as np

from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.boundary_conditions import Load, Pressure, Support, Traction
from palpate.meshes.problem import Inclusion, Problem
from palpate.meshes.rigid_tool import RigidTool


def carry_problem(problem: Problem, graded: GradedMesh) -> Problem:
    """The same problem on the refined mesh: the same regions are held, pushed and touched.

    Forces on single points stay on their points, which keep their numbers.

    Args:
        problem: On the mesh that `graded` began with.
        graded: That mesh, refined.
    """

    def carried_support(support: Support) -> Support:
        facets = graded.carry_facets(support.facets) if len(support.facets) else support.facets
        points = graded.carry_points(support.points)
        return dataclasses.replace(support, points=points, facets=facets)

    def carried_load(load: Load) -> Load:
        if isinstance(load, Traction | Pressure):
            return dataclasses.replace(load, facets=graded.carry_facets(load.facets))
        return load

    def carried_tool(tool: RigidTool) -> RigidTool:
        facets = tool.contact_facets
        carried = graded.carry_facets(facets) if len(facets) else facets
        return dataclasses.replace(tool, contact_facets=carried)

    def carried_inclusion(inclusion: Inclusion) -> Inclusion:
        inside = np.isin(graded.given_cell, inclusion.cells)
        return dataclasses.replace(inclusion, cells=np.flatnonzero(inside).astype(np.int32))

    return dataclasses.replace(
        problem,
        mesh=graded.mesh,
        supports=tuple(carried_support(s) for s in problem.supports),
        loads=tuple(carried_load(load) for load in problem.loads),
        tools=tuple(carried_tool(tool) for tool in problem.tools),
        springs=tuple(
            dataclasses.replace(spring, facets=graded.carry_facets(spring.facets))
            for spring in problem.springs
        ),
        inclusions=tuple(carried_inclusion(one) for one in problem.inclusions),
    )
