"""Signed distance to a rigid tool with its first two derivatives.

Every analytic shape here is a distance to a plane, line or point, less a radius:
d = |P (x - c)| - r with a projection P that is constant in a region of space. So
grad d = n = P (x - c) / |P (x - c)| and grad grad d = (P - n n) / |P (x - c)|.

Of a closed triangulated surface the nearest point is on a facet, an edge or a point of it; there
d = s |P (x - c)| as well. The sign s is by the side of the facet's normal, or of the pseudo-normal
of the edge or point: facets' normals weighted by their angle there (J. A. Baerentzen, H. Aanaes,
IEEE Trans. Vis. Comput. Graph. 11, 2005).

A node has to leave a box through the face by which it entered. Near an edge the nearest face is the
wrong one: a node that entered through the bottom, nearer to a side than it is deep, would be pushed
out of that side. A node enters through the face that it was outside of, and of several through that
whose plane it crossed last; a node in contact with a face belongs to it until it leaves the box.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    SphereShape,
    SurfaceShape,
    ToolShape,
)
from palpate.meshes.surface_checks import require_closed


@dataclass(frozen=True, eq=False)
class Distance:
    """Distances of n positions from a tool, with derivatives.

    Attributes:
        gap: Signed distance, negative inside the tool [m], shape (n,).
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
    positions: Points,
    came_from: Points | None = None,
) -> Distance:
    """Distance of positions from a tool in a pose.

    Args:
        shape: Shape in the tool's frame.
        position: Position of the tool's origin [m], shape (3,).
        rotation: From the tool's frame to the global one, shape (3, 3).
        positions: Positions [m], shape (n, 3).
        came_from: Previous positions in the tool's frame at that time [m], shape (n, 3): inside a
            box the distance is from the face of entry. Without them it is from the nearest face.

    Raises:
        InputError: The surface of the tool does not bound a solid.

    Note:
        The normal jumps across the medial axis of a shape (at the centre of a sphere, inside a box
        without `came_from`, inside a surface below its edges) and the curvature at the edges of a
        box and from facet to facet of a surface.
    """
    local = (positions - position) @ rotation
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
    """Distance from the centre or line at which the arms start, less a radius."""
    lengths = np.linalg.norm(arms, axis=1)
    safe = np.where(lengths > 0.0, lengths, 1.0)
    # At the centre itself any direction is a normal.
    normal = np.where(lengths[:, None] > 0.0, arms / safe[:, None], [1.0, 0.0, 0.0])
    curvature = (projections - normal[:, :, None] * normal[:, None, :]) / safe[:, None, None]
    return Distance(lengths - radius, normal, curvature)


def _box(local: Points, half_widths: Points, came_from: Points | None) -> Distance:
    beyond = np.abs(local) - half_widths
    sides = np.where(local < 0.0, -1.0, 1.0)
    # Outside: nearest face, edge or corner, by the axes along which the position is outside.
    kept = (beyond > 0.0).astype(np.float64)
    outside = _round(kept * beyond * sides, kept[:, :, None] * np.eye(3), 0.0)
    axes, face_sides = entered_faces(local, half_widths, came_from)
    rows = np.arange(len(local))
    depth = face_sides * local[rows, axes] - half_widths[axes]
    face = np.zeros_like(local)
    face[rows, axes] = face_sides
    # A position that was moved onto a side has to stay there in spite of rounding.
    slack = 0.0 if came_from is None else touching_distance(half_widths)
    inside = ~(beyond > slack).any(axis=1)
    return Distance(
        np.where(inside, depth, outside.gap),
        np.where(inside[:, None], face, outside.normal),
        np.where(inside[:, None, None], 0.0, outside.curvature),
    )


Mask = NDArray[np.bool_]
# In units of the smallest half width.
_TOUCHING = 1e-6


def entered_faces(
    local: Points, half_widths: Points, came_from: Points | None
) -> tuple[Indices, Points]:
    """The face through which each position, if it is inside, entered on a straight line.

    Args:
        local: Positions in the box's frame [m], shape (n, 3).
        half_widths: Half widths of the box [m], shape (3,).
        came_from: Previous positions in the frame at that time [m], shape (n, 3); without them, and
            for a position that was inside, the nearest face is taken.

    Returns:
        Axis of the face's normal, shape (n,), and its side of the box, -1 or 1, shape (n,).
    """
    rows = np.arange(len(local))
    axes = np.argmax(np.abs(local) - half_widths, axis=1)
    sides = _signs(local)[rows, axes]
    if came_from is None:
        return axes, sides
    slack = touching_distance(half_widths)
    beyond, before = np.abs(came_from) - half_widths, _signs(came_from)
    way = np.abs(came_from) - before * local
    # A position that is still outside along an axis has not crossed a plane of this axis.
    crossed = (beyond > slack) & (way >= beyond - slack)
    parts = np.where(crossed, beyond / np.where(crossed, way, 1.0), -1.0)
    last, known = np.argmax(parts, axis=1), crossed.any(axis=1)
    return np.where(known, last, axes), np.where(known, before[rows, last], sides)


def seen_at(local: Points, half_widths: Points, came_from: Points | None) -> Points:
    """Positions in the box's frame from which the next step may enter it [m], shape (n, 3).

    A position that does not touch the box is returned as it is. One that touches it, or is inside,
    is moved straight in front of the face through which it entered.

    Args:
        local: Positions in the box's frame [m], shape (n, 3).
        half_widths: Half widths of the box [m], shape (3,).
        came_from: See `entered_faces`.
    """
    axes, sides = entered_faces(local, half_widths, came_from)
    touching = (np.abs(local) - half_widths).max(axis=1) <= touching_distance(half_widths)
    return np.where(touching[:, None], _in_front_of(axes, sides, local, half_widths), local)


class ContactFaces:
    """The faces of a box that nodes are in contact with while an equilibrium is sought.

    A node straight in front of a face is in contact with its whole plane: at the edge of the face
    the forces would jump, and a node would gain and lose contact without end. A node beyond the
    edge at equilibrium has slid off, and is released to the adjacent face.

    Args:
        half_widths: Half widths of the box [m], shape (3,).

    Attributes:
        came_from: See `entered_faces`; None before the first equilibrium.
    """

    def __init__(self, half_widths: tuple[float, float, float]) -> None:
        self._half_widths = np.asarray(half_widths)
        self.came_from: Points | None = None
        self._kept: Points | None = None
        self._has_slid: Mask = np.zeros(0, dtype=np.bool_)

    def keep(self, local: Points) -> None:
        """Accept an equilibrium with the nodes at these positions [m], shape (n, 3)."""
        self._kept = seen_at(local, self._half_widths, self.came_from)
        self.go_back()

    def go_back(self) -> None:
        """Return to the last accepted equilibrium."""
        self.came_from = self._kept
        self._has_slid = np.zeros(0 if self._kept is None else len(self._kept), dtype=np.bool_)

    def planes(self, local: Points) -> tuple[Mask, Points, Points]:
        """The planes that nodes are in contact with, for positions [m], shape (n, 3).

        Returns:
            Whether a node has such a plane, shape (n,), its distance from the plane [m], shape
            (n,), and the plane's outward normal in the frame of the box, shape (n, 3).
        """
        has_plane, axes, sides = self._touched()
        normals = np.zeros_like(local)
        normals[np.arange(len(local)), axes] = sides
        return has_plane, (normals * local).sum(axis=1) - self._half_widths[axes], normals

    def let_go(self, local: Points, pressed: Mask) -> tuple[Mask, bool]:
        """Release the pressed nodes that have slid off the face they are in contact with.

        Returns:
            Which nodes, shape (n,), and whether one of them had already slid off another face.
        """
        assert self.came_from is not None
        has_plane, axes, _ = self._touched()
        beyond = np.abs(local) - self._half_widths
        beyond[np.arange(len(axes)), axes] = -np.inf
        off = has_plane & pressed & (beyond.max(axis=1) > touching_distance(self._half_widths))
        round_it = np.argmax(beyond, axis=1)
        sides = _signs(local)[np.arange(len(axes)), round_it]
        moved = _in_front_of(round_it, sides, local, self._half_widths)
        self.came_from = np.where(off[:, None], moved, self.came_from)
        again = bool((off & self._has_slid).any())
        self._has_slid = self._has_slid | off
        return off, again

    def _touched(self) -> tuple[Mask, Indices, Points]:
        assert self.came_from is not None
        beyond = np.abs(self.came_from) - self._half_widths
        axes = np.argmax(beyond, axis=1)
        count = (beyond > touching_distance(self._half_widths)).sum(axis=1)
        return count == 1, axes, _signs(self.came_from)[np.arange(len(axes)), axes]


def touching_distance(half_widths: Points) -> float:
    """A position nearer than this to a face or an edge touches it [m]."""
    return _TOUCHING * float(half_widths.min())


def _signs(values: Points) -> Points:
    signs: Points = np.where(values < 0.0, -1.0, 1.0)
    return signs


def _in_front_of(axes: Indices, sides: Points, local: Points, half_widths: Points) -> Points:
    moved: Points = np.clip(local, -half_widths, half_widths)
    moved[np.arange(len(local)), axes] = 2.0 * sides * half_widths[axes]
    return moved


# Edge k is from corner k to the next; the two edges after it complete the facet.
_NEXT = np.array([1, 2, 0])
# Nearer than this to an edge or point, in sizes of the surface, its pseudo-normal is the normal.
_ON_IT = 1e-10
# Largest number of pairs of positions and facets that are processed at once.
_AT_ONCE = 2_000_000


@dataclass(frozen=True, eq=False)
class ClosedSurface:
    """A closed surface with the normals that signed distances need.

    Attributes:
        corners: Corners of each facet [m], shape (m, 3, 3).
        normals: Outward normal of each facet [-], shape (m, 3).
        edge_normals: Pseudo-normals of each facet's edges [-], shape (m, 3, 3).
        corner_normals: Pseudo-normals of each facet's corners [-], shape (m, 3, 3).
        centres: Centre of each facet [m], shape (m, 3).
        radii: Distance of its farthest corner from it [m], shape (m,).
        size: Diagonal of its bounding box [m].
    """

    corners: Points
    normals: Points
    edge_normals: Points
    corner_normals: Points
    centres: Points
    radii: Floats
    size: float


@lru_cache(maxsize=8)
def closed_surface(shape: SurfaceShape) -> ClosedSurface:
    """Compute the normals of a tool's surface.

    Raises:
        InputError: The surface does not bound a solid (see `require_closed`).
    """
    surface = shape.surface
    require_closed(surface)
    facets = surface.facets
    corners = surface.points[facets]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.linalg.norm(across, axis=1)[:, None]
    at_points = np.zeros((len(surface.points), 3))
    for k in range(3):
        one = _unit(corners[:, _NEXT[k]] - corners[:, k])
        other = _unit(corners[:, _NEXT[_NEXT[k]]] - corners[:, k])
        angles = np.arccos(np.clip(np.sum(one * other, axis=1), -1.0, 1.0))
        np.add.at(at_points, facets[:, k], angles[:, None] * normals)
    edges = np.sort(np.stack([facets, facets[:, _NEXT]], axis=2), axis=2).reshape(-1, 2)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    edge = edge.reshape(-1, 3)
    at_edges = np.zeros((int(edge.max()) + 1, 3))
    for k in range(3):
        np.add.at(at_edges, edge[:, k], normals)
    points = surface.points[np.unique(facets)]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    return ClosedSurface(
        corners, normals, _unit(at_edges)[edge], _unit(at_points)[facets], centres, radii, size
    )


def surface_distance(surface: ClosedSurface, positions: Points) -> tuple[Floats, Points, Floats]:
    """Distance, normal and curvature at positions in the surface's frame; see `Distance`.

    Args:
        surface: The surface.
        positions: Positions [m], shape (n, 3).
    """
    facet, weights = _nearest(surface, positions)
    rows = np.arange(len(positions))
    corners = surface.corners[facet]
    arms = positions - np.einsum("nk,nki->ni", weights, corners)
    is_inner = weights > 0.0
    count = is_inner.sum(axis=1)
    # An edge is identified by the corner opposite to it, which follows its end.
    out = np.argmin(is_inner, axis=1)
    along = _unit(corners[rows, _NEXT[_NEXT[out]]] - corners[rows, _NEXT[out]])
    on_edge, on_corner = count == 2, count == 1
    pseudo = np.where(
        on_edge[:, None],
        surface.edge_normals[facet, _NEXT[out]],
        surface.corner_normals[facet, np.argmax(is_inner, axis=1)],
    )
    length = np.linalg.norm(arms, axis=1)
    is_off = (on_edge | on_corner) & (length > _ON_IT * surface.size)
    side = np.where(np.sum(arms * pseudo, axis=1) < 0.0, -1.0, 1.0)
    safe = np.where(is_off, length, 1.0)
    radial = (side / safe)[:, None] * arms
    kept = np.eye(3) - np.where(on_edge[:, None, None], along[:, :, None] * along[:, None, :], 0.0)
    bend = (side / safe)[:, None, None] * (kept - radial[:, :, None] * radial[:, None, :])
    flat = np.where((on_edge | on_corner)[:, None], pseudo, surface.normals[facet])
    return (
        np.where(is_off, side * length, np.sum(arms * flat, axis=1)),
        np.where(is_off[:, None], radial, flat),
        np.where(is_off[:, None, None], bend, 0.0),
    )


def _unit(rows: Points) -> Points:
    lengths = np.linalg.norm(rows, axis=-1, keepdims=True)
    unit: Points = rows / np.where(lengths > 0.0, lengths, 1.0)
    return unit


def _nearest(surface: ClosedSurface, positions: Points) -> tuple[Indices, Floats]:
    """The facet that is nearest to each position, and the weights of its corners there.

    A facet is nearer than its centre and no nearer than its centre less its radius, which rules out
    all but a few.

    Returns:
        Facets, shape (n,), and weights, shape (n, 3): exactly 0 for corners that do not belong to
        the nearest facet, edge or point.
    """
    from scipy.spatial.distance import cdist

    chosen = np.zeros(len(positions), dtype=np.int32)
    weights = np.zeros((len(positions), 3))
    step = max(1, _AT_ONCE // len(surface.corners))
    for start in range(0, len(positions), step):
        part = positions[start : start + step]
        apart = cdist(part, surface.centres)
        most = apart.min(axis=1, keepdims=True) + _ON_IT * surface.size
        row, facet = np.nonzero(apart - surface.radii <= most)
        found = _weights(surface.corners[facet], part[row])
        arms = part[row] - np.einsum("nk,nki->ni", found, surface.corners[facet])
        order = np.lexsort((np.sum(arms**2, axis=1), row))
        nearest = order[np.searchsorted(row, np.arange(len(part)))]
        chosen[start : start + step] = facet[nearest]
        weights[start : start + step] = found[nearest]
    return chosen, weights


def _weights(corners: Points, positions: Points) -> Floats:
    """Weights of the point of each of n triangles nearest to one position each, shape (n, 3)."""
    a, b, c = (corners[:, k] for k in range(3))
    across = np.cross(b - a, c - a)
    squared = np.sum(across**2, axis=1)
    arms = positions - a
    # Weights of the foot of the perpendicular on the plane.
    second = np.sum(arms * np.cross(c - a, across), axis=1) / squared
    third = np.sum(arms * np.cross(across, b - a), axis=1) / squared
    best: Floats = np.stack([1.0 - second - third, second, third], axis=1)
    is_in = (best > 0.0).all(axis=1)
    least = np.where(is_in, 0.0, np.inf)
    for k in range(3):
        start, way = corners[:, k], corners[:, _NEXT[k]] - corners[:, k]
        t = np.clip(np.sum((positions - start) * way, axis=1) / np.sum(way**2, axis=1), 0.0, 1.0)
        distance = np.sum((positions - start - t[:, None] * way) ** 2, axis=1)
        on_edge = np.zeros_like(best)
        on_edge[:, k], on_edge[:, _NEXT[k]] = 1.0 - t, t
        is_nearer = ~is_in & (distance < least)
        best = np.where(is_nearer[:, None], on_edge, best)
        least = np.where(is_nearer, distance, least)
    return best
