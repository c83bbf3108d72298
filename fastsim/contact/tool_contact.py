"""A rigid tool beside a body: gaps at boundary vertices, and the penalty's forces.

The facet integral of the penalty pressure k max(0, -g) is taken by vertex quadrature: each
boundary vertex carries a third of the rest area of its contact facets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.forces import constraints, lumped_areas
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    ToolPath,
    ToolShape,
    rotation_matrix,
)

# Numbers of a pose: position, rotation row by row.
POSE = 12


@dataclass(frozen=True, eq=False)
class Gaps:
    """Signed distances to a tool, negative inside.

    Attributes:
        distances: [m], shape (n,).
        normals: Gradient of the distance, out of the tool [-], shape (n, 3).
        curvatures: The distance's second derivative is curvature (I - n n^T - axis axis^T)
            [1/m], shape (n,).
        axes: Unit vectors or zero, shape (n, 3).
    """

    distances: Points
    normals: Points
    curvatures: Points
    axes: Points


class ToolContact:
    """One tool and the vertices it may touch.

    Attributes:
        tool: The tool.
        vertices: Points that may touch, ascending: not held in all components, shape (n,).
        areas: Rest area of each [m2], shape (n,).
    """

    def __init__(self, problem: Problem, tool: RigidTool) -> None:
        mesh = problem.mesh
        self.tool = tool
        self.shape = core_shape(tool.shape)
        facets = tool.contact_facets if len(tool.contact_facets) else mesh.boundary_facets
        self.facets = _checked_facets(facets, mesh.num_points)
        lumped = lumped_areas(mesh, self.facets)
        is_free = constraints(problem)[0].any(axis=1)
        self.vertices = np.flatnonzero((lumped > 0.0) & is_free).astype(np.int32)
        self.areas = lumped[self.vertices]
        self._rest = mesh.points[self.vertices]

    def places(self, displacement: Points) -> Points:
        """The vertices as displaced [m], shape (n, 3)."""
        places: Points = self._rest + displacement[self.vertices]
        return places

    def gaps(self, displacement: Points, pose: Points) -> Gaps:
        """Gaps of the vertices, the tool at a pose (see `poses_at`)."""
        return gaps_at(self.shape, self.places(displacement), pose)


def core_shape(shape: ToolShape) -> _core.ToolShape:
    """The compiled twin of a shape."""
    match shape:
        case SphereShape():
            return _core.ToolShape.sphere(shape.radius)
        case CapsuleShape():
            return _core.ToolShape.capsule(shape.radius, shape.half_length)
        case BoxShape():
            return _core.ToolShape.box(*shape.half_widths)
        case PlaneShape():
            return _core.ToolShape.half_space()
        case _:
            surface = shape.surface
            return _core.ToolShape.surface(
                np.array(surface.points, dtype=np.float64), np.array(surface.facets, np.int32)
            )


def gaps_at(shape: _core.ToolShape, places: Points, pose: Points) -> Gaps:
    """Gaps of places in space [m], shape (n, 3), to a shape at a pose, shape (12,)."""
    given = np.ascontiguousarray(places, dtype=np.float64)
    return Gaps(*shape.gaps(given, np.ascontiguousarray(pose, dtype=np.float64)))


def poses_at(path: ToolPath, times: Points) -> Points:
    """Poses at many times at once: position, then rotation row by row; shape (n, 12).

    The same as `ToolPath.pose_at`: straight and at constant turn (slerp) between knots.
    """
    t = np.clip(np.asarray(times, dtype=np.float64), path.times[0], path.times[-1])
    out = np.empty((len(t), POSE))
    for axis in range(3):
        out[:, axis] = np.interp(t, path.times, path.positions[:, axis])
    turns = path.rotations
    if len(path.times) == 1 or np.abs(turns - turns[0]).max() == 0.0:
        out[:, 3:] = rotation_matrix(turns[0]).ravel()
        return out
    after = np.clip(np.searchsorted(path.times, t, side="right"), 1, len(path.times) - 1)
    s = (t - path.times[after - 1]) / (path.times[after] - path.times[after - 1])
    start, end = turns[after - 1], turns[after].copy()
    cosine = np.sum(start * end, axis=1)
    end[cosine < 0.0] *= -1.0
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.where(angle < 1e-9, 1.0, np.sin(angle))
    first = np.where(angle < 1e-9, 1.0 - s, np.sin((1.0 - s) * angle) / sine)
    last = np.where(angle < 1e-9, s, np.sin(s * angle) / sine)
    w, x, y, z = (first[:, None] * start + last[:, None] * end).T
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    out[:, 3:] = np.stack(rows, axis=1)
    return out


def on_tool(contact: ToolContact, displacement: Points, force: Points, pose: Points) -> Points:
    """Force [N] and moment about the tool's origin [N m] on the tool, shape (6,).

    Args:
        contact: The tool.
        displacement: Of the body [m], shape (num_points, 3).
        force: On the contact's vertices [N], shape (n, 3).
        pose: Of the tool.
    """
    arms = contact.places(displacement) - pose[:3]
    return np.concatenate([-force.sum(axis=0), -np.cross(arms, force).sum(axis=0)])


def _checked_facets(facets: Indices, num_points: int) -> Indices:
    facets = np.asarray(facets)
    if facets.size and (facets.min() < 0 or facets.max() >= num_points):
        raise InputError("contact_facets name points that the mesh does not have")
    return facets
