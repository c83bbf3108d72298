"""Rigid tools in another form: turned, mirrored, in another unit of length."""

from __future__ import annotations

import dataclasses

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.tri_surface import TriSurface

Matrix = Floats

# Every shape but a surface is its own mirror image along x of its frame; a surface is mirrored.
_ALONG_X = np.diag([-1.0, 1.0, 1.0])


def turned_tool(tool: RigidTool, matrix: Matrix) -> RigidTool:
    """A tool's path and drive turned about the origin; its contact facets stay.

    Args:
        tool: Any.
        matrix: Orthogonal, shape (3, 3); of determinant -1 it mirrors. A mirrored pose is no turn,
            so that the tool's frame is mirrored along x too: R becomes M R S.
    """
    path, rotations, shape = tool.path, tool.path.rotations, tool.shape
    if np.linalg.det(matrix) < 0.0:
        # M R S = (M S) (S R S), and S R S turns about the axis -S a by the same angle.
        matrix_of_frame, rotations = matrix @ _ALONG_X, rotations * [1.0, 1.0, -1.0, -1.0]
        shape = _mirrored(shape)
    else:
        matrix_of_frame = matrix
    drive = tool.drive
    if drive is not None:
        x, y, z = (matrix @ np.array(drive.direction)).tolist()
        drive = dataclasses.replace(drive, direction=(x, y, z))
    return dataclasses.replace(
        tool,
        shape=shape,
        path=ToolPath(
            path.times,
            path.positions @ matrix.T,
            _product(_quaternion(matrix_of_frame), rotations),
        ),
        drive=drive,
    )


def scaled_tool(tool: RigidTool, scale: float) -> RigidTool:
    """A tool with its lengths in another unit, a metre being `scale` of it; forces stay."""
    path = tool.path
    return dataclasses.replace(
        tool,
        shape=_scaled(tool.shape, scale),
        path=ToolPath(path.times, scale * path.positions, path.rotations),
    )


def _scaled(shape: ToolShape, scale: float) -> ToolShape:
    match shape:
        case SphereShape():
            return SphereShape(scale * shape.radius)
        case CapsuleShape():
            return CapsuleShape(scale * shape.radius, scale * shape.half_length)
        case BoxShape():
            a, b, c = (scale * width for width in shape.half_widths)
            return BoxShape((a, b, c))
        case PlaneShape():
            return shape
        case SurfaceShape():
            return SurfaceShape(TriSurface(scale * shape.surface.points, shape.surface.facets))


def _mirrored(shape: ToolShape) -> ToolShape:
    if not isinstance(shape, SurfaceShape):
        return shape
    surface = shape.surface
    return SurfaceShape(TriSurface(surface.points @ _ALONG_X, surface.facets[:, [0, 2, 1]]))


def _quaternion(rotation: Matrix) -> Floats:
    """Unit quaternion (w, x, y, z) of a rotation matrix.

    The largest eigenvector of a symmetric matrix (I. Y. Bar-Itzhack, J. Guidance 23, 2000), which
    no angle makes inaccurate.
    """
    R = rotation
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0.0, 0.0, 0.0],
            [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], 0.0, 0.0],
            [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], 0.0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    vector = np.linalg.eigh(K)[1][:, -1]
    found: Floats = vector[[3, 0, 1, 2]]
    return found


def _product(first: Floats, rows: Floats) -> Floats:
    """Hamilton's product of one quaternion with many: turn by these, then by that."""
    w, v = first[0], first[1:]
    scalar = w * rows[:, 0] - rows[:, 1:] @ v
    vector = w * rows[:, 1:] + rows[:, :1] * v + np.cross(v, rows[:, 1:])
    return np.column_stack([scalar, vector])
