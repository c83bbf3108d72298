"""The keys of a case file for what was measured of a real body, and how well its inputs are known.

A measurement is of the case as it stands, or with the numbers of `set` in the place of its own: a
bar with and without its weight are two measurements of one case. It is used by `palpate fit`, and,
where it has a limit, it is judged by `palpate gate`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from palpate.validation.case.body_schema import Count, Flag, Number, Positive, Table, Vector

_NAME = r"^[A-Za-z0-9_-]{1,64}$"
# Keys that go with some kinds of measurement only.
_KEYS_OF = {
    "rest": {"markers", "frame", "frame_limit", "start", "end", "rest_limit"},
    "frequency": {"markers", "frame", "frame_limit", "start", "end", "component"},
    "tool_force": {"tool", "component"},
}
_ASKED = {
    "rest": ("markers", "rest_limit"),
    "frequency": ("markers", "component"),
    "tool_force": ("tool", "component"),
}


class MarkerSpec(Table):
    """A marker on a pin that turns with the patch of surface that it is stuck to."""

    name: str = Field(pattern=_NAME)
    """Name of its columns in the files: NAME_x_mm."""
    position: Vector
    """Of the marker, on the body at rest or on a pin beside it [units.length]."""
    radius: Positive | None = None
    """Of the patch that the pin turns with; none of what finds the frame alone [units.length]."""


class MeasurementSpec(Table):
    """What was measured in one or more runs of one experiment."""

    name: str = Field(pattern=_NAME)
    """Name by which a fit uses it or leaves it out."""
    kind: Literal["rest", "frequency", "tool_force"]
    """Motion of markers to rest, frequency of a marker's swing, or force on a tool over depth."""
    files: tuple[str, ...] = Field(min_length=1)
    """CSV, one for each run: columns time_s and NAME_x_mm, or depth_mm and force_N."""
    set: dict[str, Number] = Field(default_factory=dict)
    """Numbers, by key, that this experiment has in the place of the case's."""
    markers: tuple[str, ...] = ()
    """Markers that are compared."""
    frame: tuple[str, ...] = ()
    """Markers that find the body's frame at first; none of files that are in the case's."""
    frame_limit: Positive | None = None
    """Root mean square distance that these may have from their positions [units.length]."""
    start: Number | None = None
    """First time that is used, by the files' clock; their first where nothing is said [s]."""
    end: Number | None = None
    """Last time that is used; their last where nothing is said [s]."""
    rest_limit: Positive | None = None
    """How far a marker may still move in that time [units.length]."""
    component: Literal["x", "y", "z"] | None = None
    """Along which a marker swings, or a tool's force counts."""
    tool: Annotated[Count, Field(ge=1)] | None = None
    """Number of the [[tool]], from 1; its path is straight, its depth the way it has gone."""
    uncertainty: Positive | None = None
    """Standard uncertainty of each value, in its unit; where nothing is said the runs' scatter."""
    fitted: Flag = True
    """Whether a fit without --data uses it; false of what is a check only."""
    limit: Positive | None = None
    """Most that a value may be off, in its unit; not judged where nothing is said."""
    reason: str = ""
    """Why this limit: what its user needs."""

    @model_validator(mode="after")
    def _makes_sense(self) -> MeasurementSpec:
        missing = [key for key in _ASKED[self.kind] if not getattr(self, key)]
        if missing:
            raise ValueError(f'kind = "{self.kind}" needs {", ".join(missing)}')
        known = _KEYS_OF[self.kind]
        for key in set().union(*_KEYS_OF.values()) - known:
            if getattr(self, key):
                raise ValueError(f'{key} does not go with kind = "{self.kind}"')
        if len(set(self.files)) < len(self.files) or len(set(self.markers)) < len(self.markers):
            raise ValueError("a file or a marker is named twice")
        if self.kind == "frequency" and len(self.markers) != 1:
            raise ValueError("a frequency is of one marker")
        if self.frame and (len(set(self.frame)) < 3 or self.frame_limit is None):
            raise ValueError("frame needs three different markers or more, and a frame_limit")
        if self.start is not None and self.end is not None and not self.start < self.end:
            raise ValueError("start must be before end")
        if self.uncertainty is None and len(self.files) < 2:
            raise ValueError("one run has no scatter: state its uncertainty, or name more runs")
        if (self.limit is None) != (not self.reason):
            raise ValueError("a limit needs its reason, and a reason its limit")
        return self


class UncertaintySpec(Table):
    """How well inputs are known: it counts in the verdict on a measurement (ASME V&V 20)."""

    inputs: tuple[str, ...] = Field(min_length=1)
    """Keys of numbers of the case: `material.youngs_modulus`."""
    standard: tuple[Positive, ...]
    """Standard uncertainty of each, in the case's units."""
    correlation: tuple[tuple[Number, ...], ...] = ()
    """Of each with each, between -1 and 1; none where nothing is said."""
    source: str = Field(min_length=1)
    """Where these numbers come from."""

    @model_validator(mode="after")
    def _fits_together(self) -> UncertaintySpec:
        count = len(self.inputs)
        if len(self.standard) != count or len(set(self.inputs)) != count:
            raise ValueError("needs one standard uncertainty for each input, each named once")
        rows = self.correlation
        if rows and (len(rows) != count or any(len(row) != count for row in rows)):
            raise ValueError(f"correlation needs {count} rows of {count} numbers")
        for i, row in enumerate(rows):
            for k, value in enumerate(row):
                if abs(value) > 1.0 or value != rows[k][i] or (i == k and value != 1.0):
                    raise ValueError("correlation must be symmetric, from -1 to 1, with 1 in its "
                                     "diagonal")  # fmt: skip
        return self


def require_known_markers(
    markers: tuple[MarkerSpec, ...], measurements: tuple[MeasurementSpec, ...]
) -> None:
    """Raise ValueError at a name that stands twice, or a marker that is not there."""
    for what, names in (
        ("marker", [marker.name for marker in markers]),
        ("measurement", [measurement.name for measurement in measurements]),
    ):
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two [[{what}]] are named {name!r}; give each its own name")
    radius = {marker.name: marker.radius for marker in markers}
    for measurement in measurements:
        for name in (*measurement.markers, *measurement.frame):
            if name not in radius:
                raise ValueError(
                    f"measurement {measurement.name!r} names marker {name!r}, which no [[marker]] "
                    f"is; there are {', '.join(radius) or 'none'}"
                )
        for name in measurement.markers:
            if radius[name] is None:
                raise ValueError(f"marker {name!r} is compared, and needs a radius")
