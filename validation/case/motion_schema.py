"""The keys of a case file for what moves: time, amplitudes, tools."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from palpate.validation.case.numbers import (
    Count,
    Flag,
    NotNegative,
    Number,
    Positive,
    Vector,
)
from palpate.validation.case.region_schema import RegionSpec, Table

# States kept of a motion; each is as large as the answer of a static case.
MOST_OUTPUTS = 100_000


class TimeSpec(Table):
    """The time axis of a dynamic case; times in s."""

    end_time: Positive
    time_step: Positive | None = None
    mass_damping: NotNegative = 0.0
    num_outputs: Annotated[Count, Field(ge=1, le=MOST_OUTPUTS)] = 50


class AmplitudeSpec(Table):
    """A factor over time, by knots; see meshes/amplitude.py."""

    times: tuple[Number, ...] = Field(min_length=1)
    factors: tuple[Number, ...] = Field(min_length=1)
    smooth: Flag = False


class RotationSpec(Table):
    """A turn about an axis through the tool's origin."""

    axis: Vector
    angle_deg: Number

    @model_validator(mode="after")
    def _has_an_axis(self) -> RotationSpec:
        if not any(self.axis):
            raise ValueError("axis = [0, 0, 0] turns nothing; give a direction")
        return self


class PoseSpec(Table):
    """Where the tool is at a time [s]."""

    time: Number
    position: Vector
    rotation: RotationSpec | None = None


class DriveSpec(Table):
    """The tool is pushed along a direction by a force."""

    direction: Vector
    force: Number
    mass: Positive
    amplitude: AmplitudeSpec = AmplitudeSpec(times=(0.0,), factors=(1.0,))


class ToolSpec(Table):
    """A rigid tool; lengths in the case's unit."""

    shape: Literal["sphere", "capsule", "box", "plane", "surface"]
    radius: Positive | None = None
    half_length: Positive | None = None
    half_widths: tuple[Positive, Positive, Positive] | None = None
    surface: str | None = None
    pose: tuple[PoseSpec, ...] = Field(min_length=1)
    drive: DriveSpec | None = None
    friction_coefficient: NotNegative = 0.0
    # The part of the boundary that may touch; all of it where nothing is said.
    region: RegionSpec | None = None

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
