"""The keys of a case file that choose a part of the body."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, model_validator

from palpate.validation.case.numbers import Positive, Vector


class Table(BaseModel):
    """Unknown keys, NaN and infinity are errors."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=()
    )


class BoxRegion(Table):
    """Between two corners, in the case's length unit."""

    min: Vector
    max: Vector


class BallRegion(Table):
    """Within a radius of a centre."""

    center: Vector
    radius: Positive


class HalfSpaceRegion(Table):
    """The side of a plane to which its normal points."""

    point: Vector
    normal: Vector


class RegionSpec(Table):
    """Part of the boundary: where all the given conditions hold."""

    box: BoxRegion | None = None
    ball: BallRegion | None = None
    half_space: HalfSpaceRegion | None = None
    group: str | None = None
    nearest: Vector | None = None

    @model_validator(mode="after")
    def _says_something(self) -> RegionSpec:
        if not self.model_fields_set:
            raise ValueError("needs one of box, ball, half_space, group, nearest")
        if self.nearest is not None and len(self.model_fields_set) > 1:
            raise ValueError("nearest stands alone")
        return self
