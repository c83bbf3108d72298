"""Loads and supports of a problem as arrays over its points: for simulators, and to judge them by.

Written apart from every simulator's own, so that a fault in one is not passed on to the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.transforms import rotation


def area_vectors(points: Points, facets: Indices | NDArray[np.int64]) -> Points:
    """Outward, as long as the area [m2], (num_facets, 3)."""
    a, b, c = (points[facets[:, k]] for k in range(3))
    vectors: Points = 0.5 * np.cross(b - a, c - a)
    return vectors


def facet_areas(points: Points, facets: Indices | NDArray[np.int64]) -> Points:
    """Area of each facet [m2], (num_facets,)."""
    areas: Points = np.linalg.norm(area_vectors(points, facets), axis=1)
    return areas


def are_among(facets: Indices, others: Indices) -> NDArray[np.bool_]:
    """Which facets are among others, whatever the order of their corners, (num_facets,)."""
    known = {tuple(row) for row in np.sort(others, axis=1).tolist()}
    rows = np.sort(facets, axis=1).tolist()
    return np.array([tuple(row) in known for row in rows], dtype=bool)


# Singular values of unit normals below which two planes are one.
_ONE_PLANE = 1e-8


def fixed_components(
    problem: Problem, time: float | None = None
) -> tuple[NDArray[np.uint8], Points]:
    """Which components of which points are fixed along x, y, z, and at which displacement.

    Points that slide along slanted planes are in `sliding_points`, but for those that the planes
    leave no freedom.

    Args:
        problem: The problem with its supports.
        time: Time at which amplitudes are taken [s]; full size where None.

    Returns:
        `fixed`, 1 where it is, shape (num_points, 3); `prescribed_displacement` [m], the same
        shape, 0 where free.
    """
    fixed = np.zeros(problem.mesh.points.shape, dtype=np.uint8)
    moved = np.zeros_like(problem.mesh.points)
    for support in problem.supports:
        if support.normal is None:
            placed = moved_by(support, problem.mesh.points[support.points], time)
            for axis in np.flatnonzero(support.components):
                fixed[support.points, axis] = 1
                moved[support.points, axis] = placed[:, axis]
    slopes = _all_slopes(problem, time)
    if slopes is not None:
        whole = slopes.rank == 3
        fixed[slopes.points[whole]] = 1
        moved[slopes.points[whole]] = slopes.displacements[whole]
    return fixed, moved


@dataclass(frozen=True, eq=False)
class SlidingPoints:
    """Points that are fixed along directions that are not x, y or z, or along several.

    Attributes:
        points: Their indices, shape (n,).
        projectors: Projectors onto the fixed directions, shape (n, 3, 3).
        displacements: Their prescribed displacement along these [m], shape (n, 3).
        rank: Number of fixed directions, shape (n,).
    """

    points: NDArray[np.int32]
    projectors: Floats
    displacements: Points
    rank: NDArray[np.int64]

    def fixed_part(self, vectors: Points) -> Points:
        """The part along the fixed directions of these points' vectors, (n, 3), of all vectors."""
        part: Points = np.einsum("nij,nj->ni", self.projectors, vectors[self.points])
        return part

    def without(self, vectors: Points) -> Points:
        """Vectors of all points without their fixed part."""
        free = vectors.copy()
        free[self.points] -= self.fixed_part(vectors)
        return free

    def placed(self, displacement: Points) -> Points:
        """A displacement of all points with its fixed part as the supports prescribe it."""
        moved = self.without(displacement)
        moved[self.points] += self.displacements
        return moved

    def directions(self) -> tuple[Floats, Floats]:
        """Up to two orthonormal directions of each, else 0, (n, 2, 3), and where, (n, 2) [m]."""
        _, axes = np.linalg.eigh(self.projectors)
        found = axes.transpose(0, 2, 1)[:, :0:-1] * (np.arange(2) < self.rank[:, None])[:, :, None]
        return found, np.einsum("nkj,nj->nk", found, self.displacements)


def sliding_points(problem: Problem, time: float | None = None) -> SlidingPoints | None:
    """Points that slide: fixed along one or two directions, none of which need be x, y or z.

    None where there are none. What `fixed_components` has of them is among the directions.
    """
    found = _all_slopes(problem, time)
    if found is None:
        return None
    rows = found.rank < 3
    if not rows.any():
        return None
    return SlidingPoints(
        found.points[rows], found.projectors[rows], found.displacements[rows], found.rank[rows]
    )


def moved_by(support: Support, points: Points, time: float | None = None) -> Points:
    """Displacements by which a support moves points at rest [m], (n, 3); in full without a time."""
    factor = 1.0
    if time is not None and support.amplitude is not None:
        factor = support.amplitude(time)
    moved = np.tile(factor * np.array(support.displacement), (len(points), 1))
    turned = support.rotation
    if turned is not None:
        r = points - np.array(turned.center)
        moved += r @ rotation(turned.axis, np.rad2deg(factor * turned.angle)).T - r
    return moved


def pushes_of_supports(problem: Problem, forces: Points) -> Points:
    """Total force that each support exerts [N], (num_supports, 3), of nodal forces where fixed.

    What several fix along x, y, z counts for each; on slanted planes each pushes along its
    normal, as far as the normals are independent.
    """
    totals = np.zeros((len(problem.supports), 3))
    slopes = _all_slopes(problem, None)
    slanted = np.zeros(problem.mesh.num_points, dtype=bool)
    if slopes is not None:
        slanted[slopes.points] = True
        for point, fixed_by in _holders(problem).items():
            directions = np.array([direction for _, direction in fixed_by])
            sizes = np.linalg.pinv(directions.T, rcond=_ONE_PLANE) @ forces[point]
            for (number, direction), size in zip(fixed_by, sizes, strict=True):
                totals[number] += size * direction
    fixed = fixed_components(problem)[0]
    for number, support in enumerate(problem.supports):
        if support.normal is None:
            mine = support.points[~slanted[support.points]]
            along = np.where(fixed[mine] > 0, forces[mine], 0.0)
            totals[number] += along.sum(axis=0) * np.array(support.components)
    return totals


def _holders(problem: Problem) -> dict[int, list[tuple[int, Floats]]]:
    """The supports that fix each point on a slanted plane, with the directions they fix."""
    found: dict[int, list[tuple[int, Floats]]] = {}
    for support in problem.supports:
        if support.normal is not None:
            found.update({point: [] for point in np.asarray(support.points).tolist()})
    if not found:
        return found
    for number, support in enumerate(problem.supports):
        for point in np.asarray(support.points).tolist():
            if point in found:
                found[point] += [(number, direction) for direction in support.directions]
    return found


def _all_slopes(problem: Problem, time: float | None) -> SlidingPoints | None:
    holders = _holders(problem)
    if not holders:
        return None
    points = np.array(sorted(holders), dtype=np.int32)
    projectors, displacements, ranks = [], [], []
    for point in points.tolist():
        fixed_by = holders[point]
        directions = np.array([direction for _, direction in fixed_by])
        asked = [
            direction @ moved_by(problem.supports[k], problem.mesh.points[[point]], time)[0]
            for k, direction in fixed_by
        ]
        back = np.linalg.pinv(directions, rcond=_ONE_PLANE)
        projectors.append(back @ directions)
        displacements.append(back @ np.array(asked))
        ranks.append(np.linalg.matrix_rank(directions, tol=_ONE_PLANE))
    return SlidingPoints(points, np.array(projectors), np.array(displacements), np.array(ranks))


def rest_arrays(problem: Problem) -> dict[str, NDArray[Any]]:
    """All that a simulator of a linear law needs by point and by cell, under the exchange's names.

    Dead loads are in `external_force`; follower pressure and tools are not there.
    """
    fixed, moved = fixed_components(problem)
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
        **(
            {"c01": cell_values(problem, attrgetter("c01"))} if problem.material.law.has_c01 else {}
        ),
    }


def nodal_force(mesh: TetMesh, load: Load) -> Points:
    """Force of a dead load at each point for linear tetrahedra [N], shape (num_points, 3).

    A constant density gives every corner a quarter of its cell's force, a constant traction a
    third of its facet's; one that varies is integrated exactly. Pressure follows the surface and
    is not a dead load: it gives zero.
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


# Quadrature of degree 3 on a triangle (Strang and Fix 1973): barycentric coordinates, weights.
FACET_POINTS = np.array([[1, 1, 1], [1.8, 0.6, 0.6], [0.6, 1.8, 0.6], [0.6, 0.6, 1.8]]) / 3.0
FACET_WEIGHTS = np.array([-27.0, 25.0, 25.0, 25.0]) / 48.0


def _add_varying(force: Points, points: Points, areas: Points, load: Traction) -> None:
    corners = points[load.facets]
    for point, weight in zip(FACET_POINTS, FACET_WEIGHTS, strict=True):
        found = (weight * areas)[:, None] * load.at(np.einsum("k,mkj->mj", point, corners))
        for corner, weight_there in enumerate(point):
            np.add.at(force, load.facets[:, corner], weight_there * found)


def touchable_points(problem: Problem) -> NDArray[np.bool_]:
    """Which points a tool may touch, (num_points,)."""
    may_touch = np.zeros(problem.mesh.num_points, dtype=bool)
    for tool in problem.tools:
        # None named: all of the boundary may touch.
        facets = tool.contact_facets if len(tool.contact_facets) else problem.mesh.boundary_facets
        may_touch[facets] = True
    return may_touch


def lumped_mass(problem: Problem) -> Points:
    """A quarter of each cell's mass, and a third of masses' on a facet [kg], (num_points,)."""
    mesh = problem.mesh
    mass = signed_volumes(mesh.points, mesh.cells) * cell_materials(problem)[:, 2]
    lumped: Points = np.zeros(mesh.num_points)
    lumped += np.bincount(mesh.cells.ravel(), np.repeat(mass / 4.0, 4), mesh.num_points)
    for one in problem.masses:
        areas = facet_areas(mesh.points, one.facets)
        thirds = np.repeat(one.mass / areas.sum() * areas / 3.0, 3)
        lumped += np.bincount(one.facets.ravel(), thirds, mesh.num_points)
    return lumped


def cell_values(problem: Problem, value: Callable[[Material], float]) -> Points:
    """A number of the material in each cell, (num_cells,)."""
    values: Points = np.full(problem.mesh.num_cells, value(problem.material))
    for inclusion in problem.inclusions:
        values[inclusion.cells] = value(inclusion.material)
    return values


def cell_materials(problem: Problem) -> Points:
    """Young's modulus [Pa], Poisson's ratio [-] and density [kg/m3] by cell, (num_cells, 3)."""
    names = ("youngs_modulus", "poissons_ratio", "density")
    return np.column_stack([cell_values(problem, attrgetter(name)) for name in names])
