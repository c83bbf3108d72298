"""Tools as triangles, for pictures only."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
)
from palpate.meshes.shapes import shape_sphere

_BOX_FACETS = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ]
)  # fmt: skip


def tool_surface(tool: RigidTool, reach: float) -> tuple[Points, Indices]:
    """Points in the tool's frame [m] and triangles; of a plane a square of this size [m]."""
    match tool.shape:
        case SphereShape(radius):
            ball = shape_sphere(radius, edge_length=0.3 * radius)
            return ball.points, ball.facets
        case CapsuleShape(radius, half_length):
            ball = shape_sphere(radius, edge_length=0.3 * radius)
            drawn_out = np.zeros_like(ball.points)
            drawn_out[:, 2] = np.sign(np.round(ball.points[:, 2] / radius, 6)) * half_length
            return ball.points + drawn_out, ball.facets
        case BoxShape(half_widths):
            corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
            return corners * np.array(half_widths), _BOX_FACETS
        case SurfaceShape(surface):
            return surface.points, surface.facets
        case PlaneShape():
            square = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
            return 0.5 * reach * square, np.array([[0, 1, 2], [1, 3, 2]])
