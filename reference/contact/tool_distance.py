"""Signed distance to a rigid tool with its first two derivatives, in closed form.

Every analytic shape here is a distance to a plane, line or point, less a radius:
d = |P (x - c)| - r with a projection P that is constant in a region of space. So
grad d = n = P (x - c) / |P (x - c)| and grad grad d = (P - n n) / |P (x - c)|. Surfaces: see
`surface_distance`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    SphereShape,
    SurfaceShape,
    ToolShape,
)
from palpate.reference.contact.box_faces import entered_faces, touching_distance
from palpate.reference.contact.surface_distance import closed_surface, surface_distance


@dataclass(frozen=True, eq=False)
class Distance:
    """Distance of n places from a tool.

    Attributes:
        gap: Negative inside the tool [m], shape (n,).
        normal: Its gradient, the tool's outward unit normal [-], shape (n, 3).
        curvature: Its second gradient [1/m], shape (n, 3, 3).
    """

    gap: Floats
    normal: Points
    curvature: Floats


def tool_distance(
    shape: ToolShape,
    position: Floats,
    rotation: Floats,
    places: Points,
    came_from: Points | None = None,
) -> Distance:
    """Measure places in space from a tool in a pose.

    Args:
        shape: In the tool's frame.
        position: Of the tool's origin [m], shape (3,).
        rotation: From the tool's frame to space, shape (3, 3).
        places: [m], shape (n, 3).
        came_from: Where each was before, in the tool's frame of then [m], shape (n, 3): inside a
            box the distance is that from the face it came by. Without it from the nearest.

    Raises:
        InputError: A surface that bounds no solid.

    Note:
        The normal jumps across the medial axis of a shape (at the centre of a sphere, inside a box
        without `came_from`, inside a surface below its edges) and the curvature at the edges of a
        box and from facet to facet of a surface.
    """
    local = (places - position) @ rotation
    match shape:
        case SphereShape():
            found = _round(local, np.broadcast_to(np.eye(3), (len(local), 3, 3)), shape.radius)
        case CapsuleShape():
            along = local[:, 2]
            h = shape.half_length
            kept = np.ones((len(local), 3))
            kept[np.abs(along) < h, 2] = 0.0
            arms = local - np.outer(np.clip(along, -h, h), [0.0, 0.0, 1.0])
            found = _round(arms, kept[:, :, None] * np.eye(3), shape.radius)
        case BoxShape():
            found = _box(local, np.asarray(shape.half_widths), came_from)
        case PlaneShape():
            normal = np.tile([0.0, 0.0, 1.0], (len(local), 1))
            found = Distance(local[:, 2], normal, np.zeros((len(local), 3, 3)))
        case SurfaceShape():
            found = Distance(*surface_distance(closed_surface(shape), local))
    return Distance(found.gap, found.normal @ rotation.T, rotation @ found.curvature @ rotation.T)


def _round(arms: Points, projections: Points, radius: float) -> Distance:
    """Distance from the centre or line that the arms start at, less a radius."""
    lengths = np.linalg.norm(arms, axis=1)
    safe = np.where(lengths > 0.0, lengths, 1.0)
    # On the centre itself every direction is as good.
    normal = np.where(lengths[:, None] > 0.0, arms / safe[:, None], [1.0, 0.0, 0.0])
    curvature = (projections - normal[:, :, None] * normal[:, None, :]) / safe[:, None, None]
    return Distance(lengths - radius, normal, curvature)


def _box(local: Points, half_widths: Points, came_from: Points | None) -> Distance:
    beyond = np.abs(local) - half_widths
    sides = np.where(local < 0.0, -1.0, 1.0)
    # Outside: the nearest face, edge or corner, by the axes on which the place lies beyond it.
    kept = (beyond > 0.0).astype(np.float64)
    outside = _round(kept * beyond * sides, kept[:, :, None] * np.eye(3), 0.0)
    axes, face_sides = entered_faces(local, half_widths, came_from)
    rows = np.arange(len(local))
    depth = face_sides * local[rows, axes] - half_widths[axes]
    face = np.zeros_like(local)
    face[rows, axes] = face_sides
    # What was put onto a side has to stay there, roundings or not.
    slack = 0.0 if came_from is None else touching_distance(half_widths)
    inside = ~(beyond > slack).any(axis=1)
    return Distance(
        np.where(inside, depth, outside.gap),
        np.where(inside[:, None], face, outside.normal),
        np.where(inside[:, None, None], 0.0, outside.curvature),
    )
