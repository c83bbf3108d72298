"""The keys of a case file that choose a part of the body."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, model_validator

from palpate.validation.case.numbers import Positive, Vector


class Table(BaseModel):
    """Unknown keys, NaN and infinity are errors; the text below a key describes it to all."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        protected_namespaces=(),
        use_attribute_docstrings=True,
    )


class BoxRegion(Table):
    """Between two corners, in the case's length unit."""

    min: Vector
    """Its lowest corner [units.length]."""
    max: Vector
    """Its highest corner [units.length]."""


class BallRegion(Table):
    """Within a radius of a centre."""

    center: Vector
    """[units.length]."""
    radius: Positive
    """[units.length]."""


class HalfSpaceRegion(Table):
    """The side of a plane to which its normal points."""

    point: Vector
    """A point of the plane [units.length]."""
    normal: Vector
    """Points into the half that is meant; any length."""


class RegionSpec(Table):
    """Part of the boundary: where all the given conditions hold."""

    box: BoxRegion | None = None
    """Between two corners."""
    ball: BallRegion | None = None
    """Within a radius of a centre."""
    half_space: HalfSpaceRegion | None = None
    """One side of a plane."""
    group: str | None = None
    """What the mesh file gives a name: facets; of some keys cells or single points."""
    nearest: Vector | None = None
    """The one point nearest to this place [units.length]; stands alone."""

    @model_validator(mode="after")
    def _says_something(self) -> RegionSpec:
        if not self.model_fields_set:
            raise ValueError("needs one of box, ball, half_space, group, nearest")
        if self.nearest is not None and len(self.model_fields_set) > 1:
            raise ValueError("nearest stands alone")
        return self
