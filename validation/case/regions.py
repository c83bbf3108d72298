"""Choosing parts of the body: a facet or cell is chosen when its centroid lies in the region.

A check looks at the cells of a region, at a support, or at the cut that bounds a region.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh
from palpate.validation.case.body_schema import RegionSpec, Vector
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.exchange.nodal_arrays import are_among, area_vectors
from palpate.validation.metrics import Part

# A point is there within this part of the body's size.
SAME_POSITION = 1e-6
# Facets whose normals differ by no more lie in one plane: what files in single precision leave.
_FLAT_DEG = 0.01


class EmptyRegionError(InputError):
    """A region that selects nothing."""


def select_facets(mesh: TetMesh, region: RegionSpec, units: Units, what: str) -> Indices:
    """Boundary facets whose centroid lies in the region, shape (n, 3); `what` names it in messages.

    Raises:
        EmptyRegionError: Nothing is selected; the message gives the body's extent.
        InputError: An unknown group, or a region for single points.
    """
    if region.nearest is not None:
        raise InputError(f"{what}: `nearest` selects a point, not facets; use a ball or a box")
    facets = mesh.boundary_facets
    if region.group is not None:
        inside = are_among(facets, _group(mesh, region.group, what))
    else:
        inside = np.ones(len(facets), dtype=bool)
    inside &= _contains(mesh.points[facets].mean(axis=1), region, units)
    chosen: Indices = facets[_some(inside, mesh, units, what, "boundary facet")]
    return chosen


def select_cells(mesh: TetMesh, region: RegionSpec, units: Units, what: str) -> Indices:
    """Cells whose centroid lies in a box, ball or half space, and that are in a group, (n,).

    Of a group of facets, the cells that have one of them. Raises as `select_facets`.
    """
    inside = _contains(mesh.points[mesh.cells].mean(axis=1), region, units)
    if region.group is not None and region.group in mesh.cell_groups:
        is_named = np.zeros(mesh.num_cells, dtype=bool)
        is_named[mesh.cell_groups[region.group]] = True
        inside &= is_named
    elif region.group is not None:
        named = _group(mesh, region.group, what)
        behind = are_among(mesh.cells[:, CELL_FACETS].reshape(-1, 3), named)
        inside &= behind.reshape(-1, 4).any(axis=1)
    return _some(inside, mesh, units, what, "cell")


def select_points(mesh: TetMesh, region: RegionSpec, units: Units, what: str) -> Indices:
    """Points in a box, ball or half space, and of a group of facets or points, shape (n,).

    Raises as `select_facets`.
    """
    inside = _contains(mesh.points, region, units)
    if region.group is not None:
        is_named = np.zeros(mesh.num_points, dtype=bool)
        if region.group in mesh.point_groups:
            is_named[mesh.point_groups[region.group]] = True
        else:
            is_named[_group(mesh, region.group, what)] = True
        inside &= is_named
    return _some(inside, mesh, units, what, "point")


def _group(mesh: TetMesh, name: str, what: str) -> Indices:
    """The facets of a group by its name, (n, 3)."""
    if name not in mesh.facet_groups:
        known = ", ".join(sorted(mesh.facet_groups)) or "none"
        kind = {
            **dict.fromkeys(mesh.point_groups, "points"),
            **dict.fromkeys(mesh.cell_groups, "cells"),
        }
        hint = f"; {name!r} is a group of {kind[name]}" if name in kind else ""
        raise InputError(f"{what}: no facet group {name!r} in the mesh (known: {known}){hint}")
    return mesh.facet_groups[name]


def chooses_points(mesh: TetMesh, region: RegionSpec) -> bool:
    """Whether a region is one point or a group of single points, and no part of the boundary."""
    return region.nearest is not None or (
        region.group in mesh.point_groups and region.group not in mesh.facet_groups
    )


def single_points(mesh: TetMesh, region: RegionSpec, units: Units, what: str) -> Indices:
    """The boundary point nearest to the region's position, or its group of single points, (n,)."""
    if region.group is not None and chooses_points(mesh, region):
        return select_points(mesh, region, units, what)
    if region.nearest is None:
        raise InputError(
            f"{what}: needs region = {{ nearest = [x, y, z] }}, or a group of points of the mesh"
        )
    position = np.array(units.lengths(region.nearest))
    boundary = np.unique(mesh.boundary_facets)
    distance = np.linalg.norm(mesh.points[boundary] - position, axis=1)
    return boundary[[int(np.argmin(distance))]].astype(np.int32)


def flat_normal(mesh: TetMesh, facets: Indices, what: str) -> tuple[float, float, float]:
    """The normal of facets that lie in one plane or in parallel ones, shape (3,).

    Two sides of a slab have the same, so that sliding along both is plane strain. Raises InputError
    with the angle where they are not flat.
    """
    vectors = area_vectors(mesh.points, facets)
    normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    normals *= np.where(normals @ normals[0] < 0.0, -1.0, 1.0)[:, None]
    mean = normals.mean(axis=0)
    mean /= np.linalg.norm(mean)
    angle = float(np.rad2deg(np.linalg.norm(np.cross(normals, mean), axis=1).max()))
    if angle > _FLAT_DEG:
        raise InputError(
            f"{what}: sliding needs a flat face, this one's normals differ by {angle:.3g} degrees; "
            "choose one face for each support, or give its `normal`"
        )
    # A face along an axis that is read with rounding is one along that axis.
    mean[np.abs(mean) < 1e-9] = 0.0
    if np.count_nonzero(mean) == 1:
        mean = np.sign(mean)
    x, y, z = mean.tolist()
    return x, y, z


def point_at(mesh: TetMesh, position: Vector, units: Units, what: str) -> int:
    """Index of the mesh's point at a position in the case's units.

    Raises:
        InputError: None lies there; the message names the nearest.
    """
    wanted = np.array(units.lengths(position))
    apart = np.linalg.norm(mesh.points - wanted, axis=1)
    point = int(apart.argmin())
    if not apart[point] <= SAME_POSITION * float(np.ptp(mesh.points, axis=0).max()):
        raise InputError(
            f"{what} at {list(position)} {units.length}: no point of the mesh lies there, the "
            f"nearest at {_shown(mesh.points[point], units)} {units.length}; mesh it in, or take "
            "that one"
        )
    return point


def _contains(points: NDArray[np.float64], region: RegionSpec, units: Units) -> NDArray[np.bool_]:
    inside = np.ones(len(points), dtype=bool)
    if region.box is not None:
        low, high = (np.array(units.lengths(c)) for c in (region.box.min, region.box.max))
        inside &= np.all((points >= low) & (points <= high), axis=1)
    if region.ball is not None:
        apart = np.linalg.norm(points - np.array(units.lengths(region.ball.center)), axis=1)
        inside &= apart <= units.metres(region.ball.radius)
    if region.half_space is not None:
        point = np.array(units.lengths(region.half_space.point))
        inside &= (points - point) @ np.array(region.half_space.normal) >= 0.0
    return inside


def _shown(position: NDArray[np.float64], units: Units) -> list[float]:
    """A position in the case's unit, with the digits that a person types."""
    return [float(f"{float(x) / units.metres(1.0):.6g}") for x in position]


def _some(inside: NDArray[np.bool_], mesh: TetMesh, units: Units, what: str, part: str) -> Indices:
    """The numbers of what is chosen, of which there has to be some."""
    if not inside.any():
        low, high = (_shown(c, units) for c in (mesh.points.min(axis=0), mesh.points.max(axis=0)))
        raise EmptyRegionError(
            f"{what}: the region selects no {part}; the body reaches from {low} to {high} "
            f"{units.length}; move or enlarge the region"
        )
    return np.flatnonzero(inside).astype(np.int32)


def part_of_check(spec: CheckSpec, problem: Problem, units: Units, what: str) -> Part | None:
    """What of the body a check is about; None where it is about all of it.

    Raises:
        EmptyRegionError: The region selects nothing.
        InputError: No such support or tool, a support that moves in time, or a region without a
            cut: all of the body lies in it.
    """
    mesh = problem.mesh
    weights = np.zeros_like(mesh.points)
    none = np.zeros(0, dtype=np.int32)
    for key, number, tables in (
        ("support", spec.support, problem.supports),
        ("tool", spec.tool, problem.tools),
    ):
        if number is not None and number > len(tables):
            raise InputError(
                f"{what}: {key} = {number}, but the case has {len(tables)} [[{key}]] tables, "
                "counted from 1"
            )
    if spec.support is not None:
        support = problem.supports[spec.support - 1]
        if support.is_moved and support.amplitude is not None and problem.time is not None:
            raise InputError(
                f"{what}: support {spec.support} moves in time, and the inertia of what it fixes "
                "is no part of what is read of its force; check one at rest"
            )
        weights[support.points] = support.components
        return Part(none, weights, support=spec.support - 1, says=f"support {spec.support}")
    if spec.tool is not None:
        return Part(none, weights, tool=spec.tool - 1, says=f"tool {spec.tool}")
    if spec.region is None:
        return None
    if not spec.about.is_of_surface:
        cells = select_cells(mesh, spec.region, units, what)
        return Part(cells, weights, says=f"in {len(cells)} of {mesh.num_cells} cells")
    points = select_points(mesh, spec.region, units, what)
    if len(points) == mesh.num_points:
        raise InputError(
            f"{what}: all points of the body lie in the region, so that nothing is cut; make it "
            "smaller"
        )
    weights[points] = 1.0
    says = f"through the cut around {len(points)} of {mesh.num_points} points"
    return Part(none, weights, says=says)
