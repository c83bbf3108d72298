"""Supports and loads as plain data in SI units, and whether they contradict each other.

Each may carry an amplitude, its factor over time in dynamics; statics take it as 1. Each
simulator turns these into its own nodal forces and constraints; no mechanics here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import DisagreeingSupportsError, FacetNotOnBoundaryError, InputError
from palpate.meshes.tet_mesh import TetMesh


@dataclass(frozen=True)
class Rotation:
    """A rotation about an axis through a point.

    Args:
        axis: Unit vector, shape (3,); the rotation is right-handed about it.
        center: A point on the axis [m], shape (3,).
        angle: [rad]; may be more than a whole turn.

    Raises:
        InputError: An axis that is no unit vector, or a number that is not finite.

    >>> import palpate
    >>> palpate.Rotation((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.5).angle
    0.5
    """

    axis: tuple[float, float, float]
    center: tuple[float, float, float]
    angle: float

    def __post_init__(self) -> None:
        if not np.isfinite([*self.axis, *self.center, self.angle]).all():
            raise InputError(f"a rotation needs finite numbers, got {self}")
        if abs(math.hypot(*self.axis) - 1.0) > 1e-9:
            raise InputError(f"axis = {self.axis} of a rotation is no unit vector")


@dataclass(frozen=True, eq=False)
class Support:
    """Points with a prescribed displacement: by component, rotated, or along a normal alone.

    Args:
        points: Fixed points, shape (n,); every vertex of `facets` is one and is added here.
        facets: Fixed boundary facets, shape (m, 3): a quadratic solve also fixes their edges.
            Without facets only the points are fixed, which for a solid is a point support.
        components: Which of x, y, z are prescribed.
        displacement: Prescribed displacement [m], shape (3,); read where `components` is true.
        amplitude: Factor over time [-]; None is 1 at all times.
        rotation: Rotates the points as well: at a factor s of load or time a point X is moved by
            s displacement + (R(s angle) - I)(X - center), the exact rotation at every s.
        normal: Fixes the points along this direction alone, free to slide across it: a symmetry
            plane or a smooth wall at any angle. Any length; `displacement` is read along it.
            A point on two such planes is fixed along both normals.

    Raises:
        InputError: A rotation or a normal of single components, or both.

    >>> import palpate
    >>> palpate.Support([0, 1, 2], [[0, 1, 2]], components=(False, False, True)).displacement
    (0.0, 0.0, 0.0)
    """

    points: Indices
    facets: Indices = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int32))
    components: tuple[bool, bool, bool] = (True, True, True)
    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)
    amplitude: TabularAmplitude | None = None
    rotation: Rotation | None = None
    normal: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        points, facets = np.asarray(self.points), np.asarray(self.facets)
        if not points.size or not np.isin(facets, points).all():
            points = np.union1d(points, facets).astype(np.int32)
        object.__setattr__(self, "points", points)
        if self.rotation is not None and not all(self.components):
            raise InputError("a support that is turned holds all three components")
        if self.normal is None:
            return
        if self.rotation is not None or not all(self.components):
            raise InputError("a support along a normal takes no components and no rotation")
        if not (np.isfinite(self.normal).all() and any(self.normal)):
            raise InputError(f"normal = {self.normal} of a support: needs a direction")

    @property
    def is_moved(self) -> bool:
        """Whether it prescribes a displacement other than zero at the full load."""
        return any(self.displacement) or (self.rotation is not None and self.rotation.angle != 0.0)

    @property
    def directions(self) -> Floats:
        """Unit vectors along which it fixes its points, shape (1 to 3, 3)."""
        if self.normal is not None:
            along: Floats = np.array([self.normal]) / np.linalg.norm(self.normal)
            return along
        directions: Floats = np.eye(3)[np.array(self.components)]
        return directions


@dataclass(frozen=True, eq=False)
class Traction:
    """Dead surface load: force per rest area, the same or varying over the facets.

    At the rest position X it is t(X) = t0 + G X + X . C X / 2, in components
    t_i = t0_i + G_ij X_j + C_ijk X_j X_k / 2. It is dead: a point of the face keeps its force,
    in size and in direction, however the body moves or turns.

    Args:
        facets: Loaded boundary facets, shape (m, 3).
        traction: t0, force per rest area [Pa], shape (3,); at the origin, where it varies.
        amplitude: Factor over time [-]; None is 1 at all times.
        gradient: G [Pa/m], shape (3, 3), rows by component of the force; None is zero.
        curvature: C [Pa/m2], shape (3, 3, 3), symmetric in the last two; None is zero.

    Raises:
        InputError: A gradient or curvature of another shape, or a curvature that is not symmetric.

    >>> import palpate
    >>> palpate.Traction([[0, 1, 2]], (0.0, 0.0, -200.0)).traction
    (0.0, 0.0, -200.0)
    """

    facets: Indices
    traction: tuple[float, float, float]
    amplitude: TabularAmplitude | None = None
    gradient: Floats | None = None
    curvature: Floats | None = None

    def __post_init__(self) -> None:
        for name, shape in (("gradient", (3, 3)), ("curvature", (3, 3, 3))):
            given = getattr(self, name)
            if given is None:
                continue
            values = np.ascontiguousarray(given, dtype=np.float64)
            if values.shape != shape or not np.isfinite(values).all():
                raise InputError(f"{name} of a traction needs finite numbers of shape {shape}")
            if values.ndim == 3 and not np.array_equal(values, values.transpose(0, 2, 1)):
                raise InputError("curvature of a traction: C_ijk and C_ikj must be equal")
            object.__setattr__(self, name, values)

    @property
    def is_uniform(self) -> bool:
        """Whether it is the same everywhere."""
        return self.gradient is None and self.curvature is None

    def at(self, points: Points) -> Points:
        """Force per rest area at rest positions [Pa]; shape (..., 3) for (..., 3)."""
        values = np.broadcast_to(np.asarray(self.traction, dtype=np.float64), points.shape)
        if self.gradient is not None:
            values = values + points @ self.gradient.T
        if self.curvature is not None:
            bent = np.einsum("ijk,...j,...k->...i", self.curvature, points, points)
            values = values + 0.5 * bent
        return values


@dataclass(frozen=True, eq=False)
class Pressure:
    """Follower load: pressure on the deformed area, along its inward normal.

    Args:
        facets: Loaded boundary facets, shape (m, 3), counter-clockwise seen from outside.
        pressure: Pressure [Pa]; > 0 pushes inwards.
        amplitude: Factor over time [-]; None is 1 at all times.

    >>> import palpate
    >>> palpate.Pressure([[0, 1, 2]], 1500.0).pressure
    1500.0
    """

    facets: Indices
    pressure: float
    amplitude: TabularAmplitude | None = None


@dataclass(frozen=True, eq=False)
class PointForce:
    """Forces on single points (singular in the continuum: no limit to converge to).

    Args:
        points: Loaded points, shape (n,).
        forces: Force on each [N], shape (n, 3).
        amplitude: Factor over time [-]; None is 1 at all times.

    >>> import palpate
    >>> palpate.PointForce([7], [[0.0, 0.0, -0.2]]).points
    [7]
    """

    points: Indices
    forces: Points
    amplitude: TabularAmplitude | None = None


@dataclass(frozen=True)
class BodyForce:
    """Dead force per rest volume on the whole body (weight: density times gravity).

    Args:
        force_density: Force per rest volume [N/m3], shape (3,).
        amplitude: Factor over time [-]; None is 1 at all times.

    >>> import palpate
    >>> weight = palpate.BodyForce((0.0, 0.0, -9.81 * 1000.0))
    >>> weight.force_density[2]
    -9810.0
    """

    force_density: tuple[float, float, float]
    amplitude: TabularAmplitude | None = None


def gravity(
    acceleration: tuple[float, float, float],
    density: float,
    amplitude: TabularAmplitude | None = None,
) -> BodyForce:
    """The weight of a body of one density, as a body force.

    Args:
        acceleration: [m/s2], shape (3,).
        density: At rest [kg/m3], above 0; the material's.
        amplitude: Factor over time [-]; None is 1 at all times.

    Returns:
        The load: density times acceleration [N/m3].

    Raises:
        InputError: A density that is not above 0, or an acceleration that is not finite.

    >>> import palpate
    >>> palpate.gravity((0.0, 0.0, -9.81), density=1000.0).force_density
    (0.0, 0.0, -9810.0)
    """
    if not (math.isfinite(density) and density > 0.0 and np.isfinite(acceleration).all()):
        raise InputError(
            f"gravity of {acceleration} m/s2 on {density:g} kg/m3: needs finite numbers, and a "
            "density above 0"
        )
    x, y, z = (density * float(a) for a in acceleration)
    return BodyForce((x, y, z), amplitude)


def spread_force(
    mesh: TetMesh,
    force: tuple[float, float, float],
    where: Callable[[Points], NDArray[np.bool_]],
    amplitude: TabularAmplitude | None = None,
) -> Traction:
    """A force spread evenly, per rest area, over the boundary facets of a region.

    Args:
        mesh: The body.
        force: In all [N], shape (3,).
        where: From centroids of boundary facets at rest [m], (n, 3), to whether each is loaded,
            (n,).
        amplitude: Factor over time [-]; None is 1 at all times.

    Returns:
        The load: force over the area of these facets [Pa].

    Raises:
        InputError: No facet is chosen, or the choice has another shape.

    >>> import palpate
    >>> body = palpate.mesh(palpate.box((0.06, 0.02, 0.02), edge_length=0.01))
    >>> load = palpate.spread_force(body, (0.4, 0.0, 0.0), lambda x: x[:, 0] > 0.0599)
    >>> [round(t, 9) for t in load.traction]  # Pa: over 4 cm2
    [1000.0, 0.0, 0.0]
    """
    facets = mesh.boundary_facets
    corners = mesh.points[facets]
    chosen = np.asarray(where(corners.mean(axis=1)))
    if chosen.dtype != np.bool_ or chosen.shape != (len(facets),):
        raise InputError(
            f"where gave {chosen.dtype} of shape {chosen.shape}; needs one truth value for each of "
            f"{len(facets)} facets"
        )
    if not chosen.any():
        raise InputError("no boundary facet has its centroid in this region: make it larger")
    a, b, c = corners[chosen].transpose(1, 0, 2)
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    x, y, z = (float(component) / area for component in force)
    return Traction(facets[chosen], (x, y, z), amplitude)


Load: TypeAlias = Traction | Pressure | PointForce | BodyForce


# Checks that every simulator relies on: supports agree on each point, facets lie on the boundary.

# Displacements closer than this fraction of the largest prescribed one are equal.
_AGREE = 1e-9
# Singular values of unit normals below which two directions count as one.
_ONE_DIRECTION = 1e-8


def require_boundary_facets(mesh: TetMesh, facets: Indices, what: str) -> None:
    """Refuse facets inside the body, and facets given twice, whatever the order of their corners.

    Raises:
        FacetNotOnBoundaryError: With the guilty rows; `what` names the facets, such as "load 2".
    """
    if not len(facets):
        return
    rows = _keys(facets)
    inside = np.flatnonzero(~np.isin(rows, _keys(mesh.boundary_facets)))
    if inside.size:
        raise FacetNotOnBoundaryError(what, inside.tolist(), facets[inside[0]].tolist())
    first = np.unique(rows, return_index=True)[1]
    copies = np.setdiff1d(np.arange(len(rows)), first)
    if copies.size:
        corners = facets[copies[0]].tolist()
        raise FacetNotOnBoundaryError(what, copies.tolist(), corners, is_copy=True)


def require_agreement(mesh: TetMesh, supports: Sequence[Support], end_time: float | None) -> None:
    """Refuse supports that prescribe different displacements of a point along one direction.

    Checked under the full load, and at half of it where a support rotates; in a motion, which ends
    at `end_time` [s], at every knot of the supports' amplitudes and half-way between.

    Raises:
        DisagreeingSupportsError: With the points and both supports.
    """
    if len(supports) < 2 or not any(support.is_moved for support in supports):
        return
    holders = np.zeros(mesh.num_points, dtype=np.int64)
    is_moved = np.zeros(mesh.num_points, dtype=bool)
    for support in supports:
        holders[support.points] += 1
        is_moved[support.points] |= support.is_moved
    shared = np.flatnonzero((holders > 1) & is_moved)
    if not shared.size:
        return
    for time, factors in _moments(supports, end_time):
        guilty = _disagreement(mesh.points[shared], shared, supports, factors)
        if guilty is not None:
            raise DisagreeingSupportsError(*guilty, time)


def _disagreement(
    positions: Points,
    points: NDArray[np.int64],
    supports: Sequence[Support],
    factors: Sequence[float],
) -> tuple[list[int], tuple[int, int], str, tuple[float, float]] | None:
    """The points, the two supports, the direction, and what each prescribes for the first [m]."""
    covers = np.array([np.isin(points, support.points) for support in supports])
    moved = [placed(s, positions, factor) for s, factor in zip(supports, factors, strict=True)]
    tolerance = _AGREE * max(
        np.abs(move[here]).max(initial=0.0) for move, here in zip(moved, covers, strict=True)
    )
    found: dict[tuple[tuple[int, int], int], tuple[str, dict[int, tuple[float, float]]]] = {}
    # Points of the same supports have the same directions.
    patterns, pattern_of = np.unique(covers, axis=1, return_inverse=True)
    for k, pattern in enumerate(patterns.T):
        rows = np.flatnonzero(pattern_of.reshape(-1) == k)
        known, owners, wanted = np.zeros((0, 3)), list[int](), np.zeros((len(rows), 0))
        for number in np.flatnonzero(pattern).tolist():
            for axis, direction in enumerate(supports[number].directions):
                with np.errstate(invalid="ignore"):  # the solvers refuse what is not finite
                    here = moved[number][rows] @ direction
                weights = np.linalg.pinv(known.T, rcond=_ONE_DIRECTION) @ direction
                if np.linalg.norm(direction - weights @ known) > _ONE_DIRECTION:
                    known, wanted = np.vstack([known, direction]), np.column_stack([wanted, here])
                    owners.append(number)
                    continue
                there = wanted @ weights
                other = owners[int(np.abs(weights).argmax())]
                for row in np.flatnonzero(np.abs(there - here) > tolerance).tolist():
                    along = "(" + ", ".join(f"{d:.4g}" for d in direction) + ")"
                    name = "xyz"[int(direction.argmax())] if 1.0 in direction else along
                    _, by_point = found.setdefault(((other + 1, number + 1), axis), (name, {}))
                    by_point[int(points[rows[row]])] = float(there[row]), float(here[row])
    if not found:
        return None
    (pair, _), (name, by_point) = min(found.items())
    guilty = sorted(by_point)
    return guilty, pair, name, by_point[guilty[0]]


def placed(support: Support, points: Points, factor: float) -> Points:
    """Displacements [m] that a support prescribes at a factor of its full size, (n, 3)."""
    wanted: Points = np.tile(factor * np.array(support.displacement), (len(points), 1))
    turn = support.rotation
    if turn is not None:
        # Rodrigues: R r - r = sin a (k x r) + (1 - cos a) k x (k x r).
        angle, axis = factor * turn.angle, np.array(turn.axis)
        across = np.cross(axis, points - np.array(turn.center))
        wanted += math.sin(angle) * across + (1.0 - math.cos(angle)) * np.cross(axis, across)
    return wanted


def _moments(
    supports: Sequence[Support], end_time: float | None
) -> Iterator[tuple[float | None, list[float]]]:
    """Times, and the factor of each support then; in statics fractions of the load."""
    if end_time is None:
        yield None, [1.0] * len(supports)
        if any(support.rotation is not None for support in supports):
            yield None, [0.5] * len(supports)
        return
    amplitudes = [support.amplitude for support in supports]
    knots = {0.0, end_time, *(t for a in amplitudes if a is not None for t in a.times)}
    inside = sorted(t for t in knots if 0.0 <= t <= end_time)
    middles = [0.5 * (a + b) for a, b in itertools.pairwise(inside)]
    for time in sorted([*inside, *middles]):
        yield time, [1.0 if a is None else a(time) for a in amplitudes]


def _keys(facets: Indices) -> NDArray[np.void]:
    """One value for each facet, whatever the order of its corners."""
    rows = np.ascontiguousarray(np.sort(np.asarray(facets, dtype=np.int32), axis=1))
    return rows.view(np.dtype((np.void, 12))).ravel()
