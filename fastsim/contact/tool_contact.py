"""A rigid tool beside a body: the points at which gaps are taken, and the gaps.

Each boundary vertex that may touch carries a third of the rest area of its contact facets. The
integral of the penalty pressure k max(0, -g) is taken by vertex quadrature; over facets g is the
average of `contact_sampling.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.contact.contact_sampling import ContactSampling
from palpate.fastsim.contact.errors import FacetContactError
from palpate.fastsim.forces import lumped_areas
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ContactRule,
    PlaneShape,
    RigidTool,
    SphereShape,
    ToolPath,
    ToolShape,
)

# The pose of a tool, as in core/contact/tool_shape.hpp.
POSE = np.dtype([("position", np.float64, 3), ("rotation", np.float64, (3, 3))])


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

    distances: Floats
    normals: Points
    curvatures: Floats
    axes: Points


class ToolContact:
    """One tool and the vertices it may touch.

    Args:
        problem: Mesh and supports.
        tool: The tool.
        is_penalty: Whether the gaps of facets are for a penalty, which is integrated over them.

    Attributes:
        tool: The tool.
        vertices: Points that may touch, ascending: not fixed in all components, shape (n,).
        areas: Rest area of each [m2], shape (n,).
        sampling: Points at which gaps are taken: the vertices, or points of the facets.
    """

    def __init__(self, problem: Problem, tool: RigidTool, *, is_penalty: bool = False) -> None:
        mesh = problem.mesh
        self.tool = tool
        self.shape = core_shape(tool.shape)
        self.facets = tool.contact_facets if len(tool.contact_facets) else mesh.boundary_facets
        lumped = lumped_areas(mesh, self.facets)
        is_free = FixedPoints(problem).is_free.any(axis=1)
        self.vertices = np.flatnonzero((lumped > 0.0) & is_free).astype(np.int32)
        self.areas = lumped[self.vertices]
        self.sampling = ContactSampling(
            tool.contact,
            mesh.points,
            self.facets,
            self.vertices,
            self.areas,
            is_integrated=is_penalty and tool.contact is ContactRule.FACETS,
        )
        self._rest = mesh.points[self.vertices]

    def vertex_positions(self, displacement: Points) -> Points:
        """The vertices as displaced [m], shape (n, 3)."""
        positions: Points = self._rest + displacement[self.vertices]
        return positions

    def gaps(self, displacement: Points, pose: NDArray[np.void]) -> Gaps:
        """Gaps of the points of `sampling`, the tool at a pose (see `poses_at`)."""
        return gaps_at(self.shape, self.sampling.positions(displacement), pose)


def require_vertices(tools: Sequence[RigidTool], what: str) -> None:
    """Refuse contact over facets where it is known at vertices only.

    Args:
        tools: All tools of a problem.
        what: What knows vertices only, as the subject of a sentence.

    Raises:
        FacetContactError: A tool with contact over facets.
    """
    for number, tool in enumerate(tools):
        if tool.contact is not ContactRule.VERTICES:
            raise FacetContactError(number, what)


def core_shape(shape: ToolShape) -> _core.ToolShape:
    """A shape as the core represents it."""
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


def gaps_at(shape: _core.ToolShape, positions: Points, pose: NDArray[np.void]) -> Gaps:
    """Gaps of positions in space [m], shape (n, 3), to a shape at a pose."""
    given = np.ascontiguousarray(positions, dtype=np.float64)
    return Gaps(*shape.gaps(given, np.array(pose).reshape(1).view(np.float64).reshape(1, -1)))


def core_path(path: ToolPath) -> _core.ToolPath:
    """A path as the core represents it."""
    return _core.ToolPath(
        *(np.array(rows, dtype=np.float64) for rows in (path.times, path.positions, path.rotations))
    )


def poses_at(path: ToolPath, times: Floats) -> NDArray[np.void]:
    """Poses at many times at once, shape (n,) of `POSE`; the same as `ToolPath.pose_at`."""
    given = np.ascontiguousarray(times, dtype=np.float64)
    return core_path(path).poses_at(given).view(POSE).reshape(-1)


def on_tool(
    contact: ToolContact, displacement: Points, force: Points, pose: NDArray[np.void]
) -> Points:
    """Force [N] and moment about the tool's origin [N m] on the tool, shape (6,).

    Args:
        contact: The tool.
        displacement: Displacement of the body [m], shape (num_points, 3).
        force: On the points of its sampling [N], shape (m, 3).
        pose: Pose of the tool.
    """
    arms = contact.sampling.positions(displacement) - pose["position"]
    return np.concatenate([-force.sum(axis=0), -np.cross(arms, force).sum(axis=0)])
