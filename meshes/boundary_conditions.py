"""What is held and what is pushed, as plain data in SI units.

Each may carry an amplitude, its factor over time in dynamics; statics take it as 1. Each
simulator turns these into its own nodal forces and constraints; no mechanics here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError


def _no_facets() -> Indices:
    return np.zeros((0, 3), dtype=np.int32)


@dataclass(frozen=True)
class Rotation:
    """A turn about an axis through a place.

    Args:
        axis: Unit vector, shape (3,); the turn is right-handed about it.
        center: A place on the axis [m], shape (3,).
        angle: [rad]; more than a whole turn is one.

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
    """Points held at a given displacement: by component, turned, or along a normal alone.

    Args:
        points: Held points, shape (n,); every vertex of `facets` is held, and named here, too.
        facets: Held boundary facets, shape (m, 3): a quadratic solve also holds their edges.
            Without facets only the points are held, which for a solid is a point support.
        components: Which of x, y, z are held.
        displacement: Prescribed displacement [m], shape (3,); read where `components` is true.
        amplitude: Factor over time [-]; None is 1 at all times.
        rotation: Turns the points besides: at a factor s of load or time a point X is moved by
            s displacement + (R(s angle) - I)(X - center), the exact turn at every s.
        normal: Holds the points along this direction alone, free to slide across it: a symmetry
            plane or a smooth wall at any angle. Any length; `displacement` is read along it.
            A point on two such planes is held along both normals.

    Raises:
        InputError: A rotation or a normal of single components, or both.

    >>> import palpate
    >>> palpate.Support([0, 1, 2], [[0, 1, 2]], components=(False, False, True)).displacement
    (0.0, 0.0, 0.0)
    """

    points: Indices
    facets: Indices = field(default_factory=_no_facets)
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
        """Whether it is anywhere but at rest at full size."""
        return any(self.displacement) or (self.rotation is not None and self.rotation.angle != 0.0)

    @property
    def directions(self) -> Floats:
        """Unit vectors along which it holds its points, shape (1 to 3, 3)."""
        if self.normal is not None:
            along: Floats = np.array([self.normal]) / np.linalg.norm(self.normal)
            return along
        held: Floats = np.eye(3)[np.array(self.components)]
        return held


@dataclass(frozen=True, eq=False)
class Traction:
    """Dead surface load: force per rest area, the same or varying over the facets.

    At the rest place X it is t(X) = t0 + G X + X . C X / 2, in components
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
        """Force per rest area at rest places [Pa]; (..., 3) for (..., 3)."""
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
    """Forces on single points (singular in the continuum limit: no truth to converge to).

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


Load: TypeAlias = Traction | Pressure | PointForce | BodyForce
