"""One body of a batch as plain numbers: what a run is told before it starts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.gpu.errors import UnsupportedOnDeviceError
from palpate.fastsim.gpu.kernels.tool_shapes import BOX, CAPSULE, HALF_SPACE, SPHERE
from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    SphereShape,
    ToolShape,
)


@dataclass(frozen=True, eq=False)
class ToolData:
    """A tool and the vertices it may touch, their stiffness k A [N/m]."""

    shape: int
    size: tuple[float, float, float]
    is_constraint: bool
    friction: float
    reach: float
    deepest: float
    direction: tuple[float, float, float]
    mass: float
    vertices: Indices
    stiffnesses: Floats


@dataclass(eq=False)
class BodyData:
    """A body, and what drives it.

    Attributes:
        body: At rest.
        mass: Lumped [kg], shape (num_points,).
        is_free: 1 where free, 0 where held, shape (num_points, 3).
        time_step: [s].
        mass_damping: [1/s].
        displacement_limit: [m].
        dead: Forces by history [N], shape (num_points, 3) each.
        facets, pressures, pressure_histories: Follower pressures [Pa].
        support_values, support_histories: Terms below one another, (terms * num_points, 3).
        slides: Points, directions (n, 6), values (n, 2), histories (n, 2).
        tools: In their order.
    """

    body: Body
    mass: Floats
    is_free: Floats
    time_step: float
    mass_damping: float
    displacement_limit: float
    dead: dict[int, Floats] = field(default_factory=dict)
    facets: Indices = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int32))
    pressures: Floats = field(default_factory=lambda: np.zeros(0))
    pressure_histories: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    support_values: Floats | None = None
    support_histories: Indices | None = None
    slides: tuple[Indices, Floats, Floats, Indices] | None = None
    tools: list[ToolData] = field(default_factory=list)

    @property
    def half_damping(self) -> float:
        """C of eq. 12 [-]."""
        return 0.5 * self.mass_damping * self.time_step

    @property
    def keep(self) -> float:
        """What is left of an increment without a force [-]."""
        return (1.0 - self.half_damping) / (1.0 + self.half_damping)

    @property
    def mobility(self) -> Floats:
        """Increment by a unit force [m/N], 0 where held, shape (num_points, 3)."""
        each = self.time_step**2 / (self.mass * (1.0 + self.half_damping))
        found: Floats = np.where(self.is_free != 0, each[:, None], 0.0)
        return found


def require_supported(body: Body, device: str) -> None:
    """Raise for what only the core does.

    Raises:
        UnsupportedOnDeviceError: A law other than Saint-Venant-Kirchhoff's.
    """
    if body.strain is Strain.GREEN and body.law is not Law.SAINT_VENANT_KIRCHHOFF:
        raise UnsupportedOnDeviceError(f"the law {body.law.value}", device)


def shape_numbers(shape: ToolShape, device: str) -> tuple[int, tuple[float, float, float]]:
    """A shape as the kernels know it: its kind, and its lengths [m].

    Raises:
        UnsupportedOnDeviceError: A shape given by a surface.
    """
    match shape:
        case SphereShape():
            return SPHERE, (shape.radius, 0.0, 0.0)
        case CapsuleShape():
            return CAPSULE, (shape.radius, shape.half_length, 0.0)
        case BoxShape():
            return BOX, shape.half_widths
        case PlaneShape():
            return HALF_SPACE, (0.0, 0.0, 0.0)
        case _:
            raise UnsupportedOnDeviceError("a tool whose shape is a surface", device)
