"""Loads and supports of a problem as arrays over its points, for simulators that want just that.

Written apart from every simulator's own, so that a fault in one is not handed to the others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.facets import facet_areas
from palpate.validation.exchange.supports import held_components


def rest_arrays(problem: Problem) -> dict[str, NDArray[Any]]:
    """All that a simulator of a linear law needs by point and by cell, under the exchange's names.

    Dead loads are in `external_force`; follower pressure and tools are not there.
    """
    fixed, moved = held_components(problem)
    materials = cell_materials(problem)
    return {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
        "fixed": fixed,
        "prescribed_displacement": moved,
        "external_force": sum(
            (nodal_force(problem.mesh, load) for load in problem.loads),
            np.zeros_like(problem.mesh.points),
        ),
        "lumped_mass": lumped_mass(problem),
        "youngs_modulus": materials[:, 0],
        "poissons_ratio": materials[:, 1],
        "density": materials[:, 2],
        **({"c01": cell_values(problem, lambda m: m.c01)} if has_c01(problem) else {}),
    }


def has_c01(problem: Problem) -> bool:
    """Whether the law has a constant beside Young's modulus and Poisson's ratio."""
    return problem.material.law.has_c01


def nodal_force(mesh: TetMesh, load: Load) -> Points:
    """Force of a dead load at each point for linear tetrahedra [N], shape (num_points, 3).

    A constant density gives every corner a quarter of its cell's force, a constant traction a
    third of its facet's; one that varies is integrated exactly. Pressure follows the surface and
    has no place here: it gives zero.
    """
    force = np.zeros_like(mesh.points)
    match load:
        case BodyForce():
            quarters = signed_volumes(mesh.points, mesh.cells) / 4.0
            by_point = np.bincount(mesh.cells.ravel(), np.repeat(quarters, 4), mesh.num_points)
            force += by_point[:, None] * np.array(load.force_density)
        case Traction():
            areas = facet_areas(mesh.points, load.facets)
            if not load.is_uniform:
                _add_varying(force, mesh.points, areas, load)
                return force
            thirds = areas / 3.0
            by_point = np.bincount(load.facets.ravel(), np.repeat(thirds, 3), mesh.num_points)
            force += by_point[:, None] * np.array(load.traction)
        case PointForce():
            np.add.at(force, load.points, load.forces)
        case Pressure():
            pass
    return force


# Of degree 3 on a triangle (Strang and Fix 1973): barycentric coordinates and weights.
FACET_PLACES = np.array([[1, 1, 1], [1.8, 0.6, 0.6], [0.6, 1.8, 0.6], [0.6, 0.6, 1.8]]) / 3.0
FACET_WEIGHTS = np.array([-27.0, 25.0, 25.0, 25.0]) / 48.0


def _add_varying(force: Points, points: Points, areas: Points, load: Traction) -> None:
    corners = points[load.facets]
    for place, weight in zip(FACET_PLACES, FACET_WEIGHTS, strict=True):
        found = (weight * areas)[:, None] * load.at(np.einsum("k,mkj->mj", place, corners))
        for corner, share in enumerate(place):
            np.add.at(force, load.facets[:, corner], share * found)


def touchable_points(problem: Problem) -> NDArray[np.bool_]:
    """Which points a tool may touch, (num_points,)."""
    may_touch = np.zeros(problem.mesh.num_points, dtype=bool)
    for tool in problem.tools:
        # None named: all of the boundary may touch.
        facets = tool.contact_facets if len(tool.contact_facets) else problem.mesh.boundary_facets
        may_touch[facets] = True
    return may_touch


def lumped_mass(problem: Problem) -> Points:
    """A quarter of each cell's mass to each of its corners [kg], shape (num_points,)."""
    mesh = problem.mesh
    mass = signed_volumes(mesh.points, mesh.cells) * cell_materials(problem)[:, 2]
    lumped: Points = np.zeros(mesh.num_points)
    lumped += np.bincount(mesh.cells.ravel(), np.repeat(mass / 4.0, 4), mesh.num_points)
    return lumped


def cell_values(problem: Problem, value: Callable[[Material], float]) -> Points:
    """A number of the material in each cell, (num_cells,)."""
    values: Points = np.full(problem.mesh.num_cells, value(problem.material))
    for inclusion in problem.inclusions:
        values[inclusion.cells] = value(inclusion.material)
    return values


def cell_materials(problem: Problem) -> Points:
    """Young's modulus [Pa], Poisson's ratio [-] and density [kg/m3] by cell, (num_cells, 3)."""
    body = problem.material
    rows = np.tile(
        [body.youngs_modulus, body.poissons_ratio, body.density], (problem.mesh.num_cells, 1)
    )
    for inclusion in problem.inclusions:
        part = inclusion.material
        rows[inclusion.cells] = (part.youngs_modulus, part.poissons_ratio, part.density)
    return rows
