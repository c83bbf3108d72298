"""Rigid tools that touch the body: shape, path and drive as plain data; no mechanics here.

A tool has a frame of its own. A pose (position, rotation) maps a point x of the frame to
rotation @ x + position in space. Each simulator measures distances to the shape by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.tri_surface import TriSurface

# How far from 1 the length of a quaternion may be; within this it is normalised.
UNIT_TOLERANCE = 1e-6


class ToolError(InputError):
    """A tool that cannot be used: a size not above 0, NaN in its path, times not increasing."""


@dataclass(frozen=True)
class SphereShape:
    """A ball about the tool's origin; radius [m] > 0.

    >>> import palpate
    >>> palpate.SphereShape(radius=0.005).radius
    0.005
    """

    radius: float

    def __post_init__(self) -> None:
        _require_size("radius of a sphere", self.radius)


@dataclass(frozen=True)
class CapsuleShape:
    """A cylinder with round ends about the tool's z axis.

    Args:
        radius: [m], > 0.
        half_length: From the origin to the centre of either end [m], > 0.

    >>> import palpate
    >>> palpate.CapsuleShape(radius=0.003, half_length=0.02).half_length
    0.02
    """

    radius: float
    half_length: float

    def __post_init__(self) -> None:
        _require_size("radius of a capsule", self.radius)
        _require_size("half_length of a capsule", self.half_length)


@dataclass(frozen=True)
class BoxShape:
    """A box along the tool's axes with its centre at the origin; half widths [m], each > 0.

    >>> import palpate
    >>> palpate.BoxShape((0.01, 0.01, 0.002)).half_widths
    (0.01, 0.01, 0.002)
    """

    half_widths: tuple[float, float, float]

    def __post_init__(self) -> None:
        for width in self.half_widths:
            _require_size("half width of a box", width)


@dataclass(frozen=True)
class PlaneShape:
    """The half space z <= 0 of the tool's frame; its outward normal is +z.

    >>> import palpate
    >>> palpate.PlaneShape()
    PlaneShape()
    """


@dataclass(frozen=True, eq=False)
class SurfaceShape:
    """The inside of a closed surface given in the tool's frame (see `surface_checks`).

    >>> import palpate
    >>> from palpate.meshes.shapes import shape_sphere
    >>> palpate.SurfaceShape(shape_sphere(0.01, edge_length=0.005)).surface.num_facets > 0
    True
    """

    surface: TriSurface


ToolShape: TypeAlias = SphereShape | CapsuleShape | BoxShape | PlaneShape | SurfaceShape


def _identity_rotations() -> Floats:
    return np.zeros((0, 4))


@dataclass(frozen=True, eq=False)
class ToolPath:
    """Poses over time: straight and at constant rotation rate between knots, at rest outside.

    Args:
        times: Knots [s], increasing, shape (n,), n >= 1. In statics a load parameter.
        positions: Of the tool's origin [m], shape (n, 3).
        rotations: Unit quaternions (w, x, y, z), shape (n, 4); none means no rotation.

    Raises:
        ToolError: Wrong shapes, NaN or infinity, times that do not increase, or a quaternion that
            is not of unit length.

    >>> import palpate
    >>> path = palpate.ToolPath([0.0, 1.0], [[0.0, 0.0, 0.03], [0.0, 0.0, 0.01]])
    >>> path.pose_at(0.5)[0].round(6).tolist()
    [0.0, 0.0, 0.02]
    """

    times: Floats
    positions: Points
    rotations: Floats = field(default_factory=_identity_rotations)

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=np.float64)
        positions = np.array(self.positions, dtype=np.float64, order="C")
        rotations = np.array(self.rotations, dtype=np.float64, order="C")
        count = len(times) if times.ndim == 1 else 0
        if rotations.shape == (0, 4):
            rotations = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
        if count == 0 or positions.shape != (count, 3) or rotations.shape != (count, 4):
            raise ToolError(
                "a tool's path needs times (n,), positions (n, 3) and rotations (n, 4), n >= 1; "
                f"got {times.shape}, {positions.shape}, {rotations.shape}"
            )
        for what, rows in (("time", times), ("position", positions), ("rotation", rotations)):
            bad = np.flatnonzero(~np.isfinite(rows.reshape(count, -1)).all(axis=1))
            if bad.size:
                raise ToolError(f"the tool's path has a {what} at knot {bad[0]} that is not finite")
        back = np.flatnonzero(~(np.diff(times) > 0.0))
        if back.size:
            k = int(back[0]) + 1
            raise ToolError(
                f"the tool's path runs backwards at knot {k}: {times[k]:g} s after "
                f"{times[k - 1]:g} s; times must increase"
            )
        length = np.linalg.norm(rotations, axis=1)
        bad = np.flatnonzero(~(np.abs(length - 1.0) < UNIT_TOLERANCE))
        if bad.size:
            raise ToolError(
                f"the tool's rotation at knot {bad[0]} has length {length[bad[0]]:g}; "
                "give unit quaternions (w, x, y, z)"
            )
        rotations /= length[:, None]
        for name, rows in (("times", times), ("positions", positions), ("rotations", rotations)):
            rows.setflags(write=False)
            object.__setattr__(self, name, rows)

    def pose_at(self, time: float) -> tuple[Floats, Floats]:
        """Position [m], shape (3,), and rotation matrix, shape (3, 3), at a time [s]."""
        after = int(np.searchsorted(self.times, time, side="right"))
        rotation = rotation_matrix(self.quaternion_at(time))
        if after in (0, len(self.times)):
            return self.positions[min(after, len(self.times) - 1)].copy(), rotation
        s = self._part(after, time)
        return (1.0 - s) * self.positions[after - 1] + s * self.positions[after], rotation

    def quaternion_at(self, time: float) -> Floats:
        """Unit quaternion (w, x, y, z), shape (4,), at a time [s]."""
        after = int(np.searchsorted(self.times, time, side="right"))
        if after in (0, len(self.times)):
            end: Floats = self.rotations[min(after, len(self.times) - 1)].copy()
            return end
        return _between(self.rotations[after - 1], self.rotations[after], self._part(after, time))

    def _part(self, after: int, time: float) -> float:
        """Fraction of the time from the knot before `after` to that knot, 0 to 1."""
        begin, end = self.times[after - 1], self.times[after]
        return float((time - begin) / (end - begin))


@dataclass(frozen=True)
class ForceDrive:
    """The tool moves along a line from the first pose of its path, pushed by a force.

    Args:
        direction: Unit vector in space, shape (3,).
        force: Magnitude along it [N], times the amplitude.
        amplitude: Factor over time [-].
        mass: Mass of the tool [kg], > 0; does not matter in statics.

    >>> import palpate
    >>> from_the_start = palpate.TabularAmplitude((0.0,), (1.0,))
    >>> palpate.ForceDrive((0.0, 0.0, -1.0), 0.5, from_the_start, mass=0.02).force
    0.5
    """

    direction: tuple[float, float, float]
    force: float
    amplitude: TabularAmplitude
    mass: float

    def __post_init__(self) -> None:
        length = math.sqrt(sum(d * d for d in self.direction))
        if not abs(length - 1.0) < UNIT_TOLERANCE:
            raise ToolError(f"the tool's direction has length {length:g}; give a unit vector")
        if not math.isfinite(self.force):
            raise ToolError(f"the tool's force is {self.force:g} N; it must be finite")
        _require_size("mass of a tool", self.mass)


def _all_free_boundary() -> Indices:
    return np.zeros((0, 3), dtype=np.int32)


class ContactRule(StrEnum):
    """Where a linear surface is kept out of a tool.

    Vertices: the gap is taken at boundary vertices, each with a third of the rest area of its
    contact facets; between them a curved tool cuts into the facets.

    Facets: the gap is averaged over the facets with the dual shape functions 4 phi_i - 1 of the
    vertices, for which a facet has as many constraints as vertices and none of them is met by
    overlap elsewhere (B. I. Wohlmuth, SIAM J. Numer. Anal. 38 (2000) 989-1012):

        g_i = sum over facets f at i, points q of A_f w_q (4 beta_qi - 1) g(x_q) / a_i,

    a_i a third of the rest area A of those facets, x_q the position of the point with barycentric
    coordinates beta_q, w_q = 1/12 its weight: the points (2/3, 1/6, 1/6) and their two rotations in
    each of the four triangles that halved edges make, exact for products of two shape functions.
    The gap is at least 0 wherever the pressure p_i at a vertex is above it, and the virtual work is
    the sum over vertices of a_i p_i times the variation of g_i. Friction is of the slip s over the
    tool, averaged like g, across the average of the normals, and at most mu a_i p_i. An average of
    what is linear over each facet is its value at the vertex: s_i is the vertex's own slip.
    """

    VERTICES = "vertices"
    FACETS = "facets"


@dataclass(frozen=True, eq=False)
class RigidTool:
    """A rigid body pressed into the deformable one.

    The gap is the distance of the body's surface from the shape, negative inside. On linear
    tetrahedra `contact` says where it is taken, so that every simulator has the same discrete
    problem.

    Args:
        shape: Shape in the tool's frame.
        path: Poses over time.
        friction_coefficient: Coulomb's [-], >= 0; 0 is frictionless.
        contact_facets: Boundary facets that may touch, shape (m, 3); none means all of the
            boundary. Fixed points take no part.
        drive: Force that pushes the tool instead of a given motion; then the path has one pose.
        contact: Where the surface of linear tetrahedra is kept out of the tool.

    Raises:
        ToolError: A negative friction coefficient, or a drive with more than one pose.

    >>> import palpate
    >>> down = palpate.ToolPath([0.0, 1.0], [[0.0, 0.0, 0.03], [0.0, 0.0, 0.01]])
    >>> palpate.RigidTool(palpate.SphereShape(0.005), down).friction_coefficient
    0.0
    """

    shape: ToolShape
    path: ToolPath
    friction_coefficient: float = 0.0
    contact_facets: Indices = field(default_factory=_all_free_boundary)
    drive: ForceDrive | None = None
    contact: ContactRule = ContactRule.VERTICES

    def __post_init__(self) -> None:
        object.__setattr__(self, "contact", ContactRule(self.contact))
        if not (math.isfinite(self.friction_coefficient) and self.friction_coefficient >= 0.0):
            raise ToolError(
                f"friction_coefficient = {self.friction_coefficient:g}: needs a value >= 0"
            )
        if self.drive is not None and len(self.path.times) != 1:
            raise ToolError("a tool driven by a force takes a path of one pose, where it starts")


def rotation_matrix(quaternion: NDArray[Any]) -> Floats:
    """Rotation matrix, shape (3, 3), of a unit quaternion (w, x, y, z)."""
    w, x, y, z = (float(q) for q in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _between(start: Floats, end: Floats, s: float) -> Floats:
    """The rotation at constant rate, the shorter way round (Shoemake 1985, slerp)."""
    cosine = float(start @ end)
    if cosine < 0.0:
        end, cosine = -end, -cosine
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-9:
        return start
    turned: Floats = (math.sin((1 - s) * angle) * start + math.sin(s * angle) * end) / math.sin(
        angle
    )
    return turned


def _require_size(what: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ToolError(f"{what} = {value:g}: needs a finite value above 0")


def require_drive_of_statics(tools: Sequence[RigidTool]) -> None:
    """Refuse a force on a tool for which the static equilibrium is not unique.

    Statics drive a single tool along its line until the body balances the whole force; friction on
    the way there would depend on the steps taken.

    Args:
        tools: All tools of a problem.

    Raises:
        ToolError: A tool driven by a force beside other tools, or with friction; a force that is
            not above 0.
    """
    for number, tool in enumerate(tools, start=1):
        if tool.drive is None:
            continue
        driven = f"tool {number} is driven by"
        if len(tools) > 1:
            raise ToolError(f"{driven} a force, beside others: statics drive one tool, alone")
        if tool.friction_coefficient > 0.0:
            raise ToolError(
                f"{driven} a force and has friction, whose drag depends on the way: statics drive "
                "a tool without friction; set 0, or give a path"
            )
        if not tool.drive.force > 0.0:
            raise ToolError(
                f"{driven} {tool.drive.force:g} N: statics need a force above 0; turn the "
                "direction round"
            )


# Straight pieces from one pose to the next: jumps of speed are below 5 % of the largest speed.
_PIECES = 64
_STEP = TabularAmplitude((0.0, 1.0), (0.0, 1.0), is_smooth=True)


def smooth_path(path: ToolPath) -> ToolPath:
    """The same poses at the same times, with the speed of the smooth amplitude between them.

    From pose to pose the tool has gone the fraction 10 s^3 - 15 s^4 + 6 s^5 of the way at the
    fraction s of the time, given by closely spaced knots: every simulator reads a path of straight
    pieces.

    Args:
        path: Straight from pose to pose.

    Returns:
        A path through the same poses, with 64 pieces for each of the given ones.

    >>> import numpy as np
    >>> path = ToolPath(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    >>> smooth_path(path).pose_at(0.25)[0].round(4).tolist()
    [0.1035, 0.0, 0.0]
    """
    parts = np.arange(_PIECES) / _PIECES
    steps = np.array([_STEP(float(s)) for s in parts])
    times, along, rotations = [], [], []
    for k, (begin, end) in enumerate(zip(path.times, path.times[1:], strict=False)):
        times.append(begin + (end - begin) * parts)
        start, way = path.positions[k], path.positions[k + 1] - path.positions[k]
        along.append(start + steps[:, None] * way)
        rotations += [path.quaternion_at(float(begin + (end - begin) * s)) for s in steps]
    return ToolPath(
        np.concatenate([*times, path.times[-1:]]),
        np.concatenate([*along, path.positions[-1:]]),
        np.array([*rotations, path.rotations[-1]]),
    )
