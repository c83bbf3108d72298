"""The keys of a case file for what moves: time, amplitudes, tools."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from palpate.validation.case.numbers import Count, Flag, NotNegative, Number, Positive, Vector
from palpate.validation.case.region_schema import RegionSpec, Table

# States kept of a motion; each is as large as the answer of a static case.
MOST_OUTPUTS = 100_000


class TimeSpec(Table):
    """The time axis of a dynamic case; times in s."""

    end_time: Positive
    """[s]."""
    time_step: Positive | None = None
    """[s]; only for checks on the same mesh, where all take the same steps."""
    mass_damping: NotNegative = 0.0
    """lambda in D = lambda M [1/s]."""
    stiffness_damping: NotNegative = 0.0
    """beta of a viscous stress beta C : dE/dt, C at rest [s]; D = beta K for small strains."""
    num_outputs: Annotated[Count, Field(ge=1, le=MOST_OUTPUTS)] = 50
    """States kept after the first, evenly spaced."""


class StartSpec(Table):
    """Velocity at the start, that of a rigid body: velocity + angular_velocity x (X - center)."""

    velocity: Vector = (0.0, 0.0, 0.0)
    """At the center [units.length per s]."""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """[rad/s]."""
    center: Vector = (0.0, 0.0, 0.0)
    """[units.length]."""


class AmplitudeSpec(Table):
    """A factor over time, by knots; see meshes/amplitude.py."""

    times: tuple[Number, ...] = Field(min_length=1)
    """Knots [s], increasing."""
    factors: tuple[Number, ...] = Field(min_length=1)
    """Factor at each knot [-]."""
    smooth: Flag = False
    """Steps that hardly ring, in place of straight lines."""


class RotationSpec(Table):
    """A turn about an axis through the tool's origin."""

    axis: Vector
    """Direction, through the tool's origin."""
    angle_deg: Number
    """[degrees]."""

    @model_validator(mode="after")
    def _has_an_axis(self) -> RotationSpec:
        if not any(self.axis):
            raise ValueError("axis = [0, 0, 0] turns nothing; give a direction")
        return self


class PoseSpec(Table):
    """Where the tool is at a time [s]."""

    time: Number
    """[s]; in statics a load parameter, of which the last counts."""
    position: Vector
    """Of the tool's origin [units.length]."""
    rotation: RotationSpec | None = None
    """Its turn from the frame it is described in."""


class DriveSpec(Table):
    """The tool is pushed along a direction by a force."""

    direction: Vector
    """Unit vector."""
    force: Number
    """Along it [units.force]."""
    mass: Positive
    """Of the tool [kg]."""
    amplitude: AmplitudeSpec = AmplitudeSpec(times=(0.0,), factors=(1.0,))
    """Factor of the force over time."""


class ToolSpec(Table):
    """A rigid tool; lengths in the case's unit."""

    shape: Literal["sphere", "capsule", "box", "plane", "surface"]
    """A capsule lies along the tool's z axis; a plane is its half space z <= 0."""
    radius: Positive | None = None
    """Of a sphere or a capsule [units.length]."""
    half_length: Positive | None = None
    """Of a capsule, from the origin to the centre of an end [units.length]."""
    half_widths: tuple[Positive, Positive, Positive] | None = None
    """Of a box [units.length]."""
    surface: str | None = None
    """A closed surface beside this file, in the tool's frame."""
    pose: tuple[PoseSpec, ...] = Field(min_length=1)
    """Where it is over time, straight from one pose to the next."""
    smooth: Flag = False
    """Resting at every pose, its speed without jumps, in the place of constant speeds."""
    drive: DriveSpec | None = None
    """Pushed by a force in place of following the poses; then one pose says where it starts."""
    friction_coefficient: NotNegative = 0.0
    """Coulomb's [-]."""
    region: RegionSpec | None = None
    """The part of the boundary that may touch; all of it where nothing is said."""

    @model_validator(mode="after")
    def _has_its_sizes(self) -> ToolSpec:
        sizes = {"radius", "half_length", "half_widths", "surface"}
        needed = {
            "sphere": {"radius"},
            "capsule": {"radius", "half_length"},
            "box": {"half_widths"},
            "plane": set(),
            "surface": {"surface"},
        }[self.shape]
        given = {name for name in sizes if getattr(self, name) is not None}
        if needed - given:
            raise ValueError(f"shape {self.shape!r} needs {', '.join(sorted(needed - given))}")
        if given - needed:
            raise ValueError(f"shape {self.shape!r} takes no {', '.join(sorted(given - needed))}")
        return self


def as_list(value: Any) -> Any:
    """[tool] stands for one [[tool]]."""
    return [value] if isinstance(value, dict) else value
