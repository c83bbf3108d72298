"""The keys of a case file. No expression is ever evaluated from a case."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from palpate.meshes.problem import Strain
from palpate.validation.case.body_schema import (
    Count,
    GeometrySpec,
    InclusionSpec,
    MaterialSpec,
    MeshSpec,
    NotNegative,
    Number,
    PlainData,
    Positive,
    RegionSpec,
    Table,
    Vector,
    plain_number,
)
from palpate.validation.case.loading_schema import (
    LoadSpec,
    MassSpec,
    SpringSpec,
    StartSpec,
    SupportSpec,
    TimeSpec,
    ToolSpec,
    as_list,
)
from palpate.validation.case.measurement_schema import (
    MarkerSpec,
    MeasurementSpec,
    UncertaintySpec,
    require_known_markers,
)
from palpate.validation.case.units import Units
from palpate.validation.metrics import CATALOGUE, STRESSES, Metric
from palpate.validation.states import Precision

# What is judged and said, not what is solved.
_NOT_INPUTS = (
    "schema_version", "title", "description", "check", "evidence", "published", "marker",
    "measurement", "uncertainty",
)  # fmt: skip


def input_names(spec: BaseModel) -> list[str]:
    """Names of every number, or row of numbers, that a case file gives to be solved with."""
    tables = spec.model_dump(exclude_unset=True, exclude=set(_NOT_INPUTS))
    return [name for key, value in tables.items() for name in _number_names(key, value)]


def require_inputs(spec: BaseModel, names: tuple[str, ...], what: str) -> None:
    """Raise ValueError at the first name, of those in `what`, that the case does not give."""
    given = input_names(spec)
    for name in names:
        if name in given:
            continue
        near = difflib.get_close_matches(name, given, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"it gives {', '.join(given)}"
        raise ValueError(f"{what}: the case gives no number {name!r}; {hint}")


def _number_names(key: str, value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for inner, found in value.items():
            yield from _number_names(f"{key}.{inner}", found)
    elif _is_number(value):
        yield key
    elif isinstance(value, list | tuple):
        if all(map(_is_number, value)):
            yield key
        else:
            for index, found in enumerate(value):
                yield from _number_names(f"{key}[{index}]", found)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


if TYPE_CHECKING:
    MetricName: TypeAlias = str
    ComponentName: TypeAlias = str
else:
    MetricName = Literal[tuple(CATALOGUE)]
    ComponentName = Literal[(*"xyz", *STRESSES)]


class CheckSpec(Table):
    """A limit and the reason for it."""

    metric: MetricName
    """What is compared, or measured of the candidate itself."""
    against: Literal["same_mesh", "truth", "candidate"] = "same_mesh"
    """The reference on the same mesh, the truth with its error bar, or the candidate alone."""
    strain: Strain | None = None
    """Which result is judged; the case's strain where nothing is said."""
    limit: Number
    """Most that the error may be, from what the user needs; mostly [-]."""
    reason: str = Field(min_length=1)
    """Why this limit."""
    precision: Precision | None = None
    """"single" raises the limit to what float32 does; the case's where nothing is said."""
    at: Vector | None = None
    """Position of a published number: a point of the mesh [units.length]."""
    component: ComponentName | None = None
    """Component of a published number; the last eight are of a stress."""
    quantity: Literal["amplitude", "frequency", "damping", "mean"] | None = None
    """The quantity that a published_oscillation compares."""
    expected: Number | None = None
    """The published number, in the case's units, Hz or 1/s; the reason names its source."""
    uncertainty: NotNegative | None = None
    """Uncertainty of the published or measured number, in its unit; counts like an error bar."""
    region: RegionSpec | None = None
    """For stress: cells compared, away from clamped edges; for traction_resultant: one side."""
    support: Annotated[Count, Field(ge=1)] | None = None
    """Number from 1 of the [[support]] whose force counts; traction_resultant: this or region."""
    tool: Annotated[Count, Field(ge=1)] | None = None
    """Number of the [[tool]] of a published_tool_force, from 1."""

    @model_validator(mode="after")
    def _makes_sense(self) -> CheckSpec:
        about = self.about
        if about.is_published and self.against == "same_mesh":
            raise ValueError(
                f'{self.metric} goes with against = "candidate", or "truth" for the '
                "reference's own"
            )
        if not about.is_published and about.is_own != (self.against == "candidate"):
            own = ", ".join(_names(lambda m: m.is_own or m.is_published))
            raise ValueError(f'{own} go with against = "candidate", and nothing else does')
        if about.needs_same_mesh and self.against != "same_mesh":
            raise ValueError(f'{self.metric} goes with against = "same_mesh" only')
        if self.precision is not None and about.is_own:
            raise ValueError(f"precision goes with what is compared, not with {self.metric}")
        self._has_what_the_metric_takes()
        if not about.is_own and self.limit <= 0.0:
            raise ValueError("limit must be above 0")
        return self

    def _has_what_the_metric_takes(self) -> None:
        """Raise ValueError where a key of a number or part of the body is missing or unused."""
        about = self.about
        missing = [key for key in about.asks if getattr(self, key) is None]
        if missing:
            raise ValueError(f"{self.metric} needs {', '.join(missing)}")
        for key in _OF_SOME:
            if getattr(self, key) is not None and not _takes(about, key):
                takers = [metric.name for metric in CATALOGUE.values() if _takes(metric, key)]
                raise ValueError(f"{key} goes with {', '.join(takers)}")
        if self.component is not None and self.component not in about.components:
            known = ", ".join(about.components)
            raise ValueError(f"component of {self.metric} is one of {known}")
        if about.is_published and not self.expected:
            raise ValueError("expected = 0 gives no scale; choose another component or position")
        if self.region is not None and self.region.nearest is not None:
            raise ValueError(
                "the region of a check is a box, a ball, a half_space or a group, not a point"
            )
        if about.is_of_surface and (self.region is None) == (self.support is None):
            raise ValueError(
                f"{self.metric} needs support, the number of one, or region, one side of a cut"
            )
        if about.of_part is not None and not about.is_of_surface and self.region is None:
            raise ValueError(
                f"{self.metric} needs region: cells away from clamped edges, where stress has no "
                "bound"
            )

    @property
    def about(self) -> Metric:
        """The metric's entry in the catalogue."""
        return CATALOGUE[self.metric]

    @property
    def is_of_truth_alone(self) -> bool:
        """Whether the truth itself, not the candidate, is compared with a published number."""
        return self.against == "truth" and self.about.is_published


# Keys of a check that go with some metrics only.
_OF_SOME = ("at", "component", "quantity", "tool", "expected", "uncertainty", "support", "region")


def _takes(metric: Metric, key: str) -> bool:
    """Whether a key of a check, of those that only some metrics take, goes with a metric."""
    also = {
        "uncertainty": metric.is_published,
        "support": metric.is_of_surface,
        "region": metric.of_part is not None,
    }
    return key in metric.asks or also.get(key, False)


def _names(which: Callable[[Metric], bool]) -> list[str]:
    return [metric.name for metric in CATALOGUE.values() if which(metric)]


class TruthSpec(Table):
    """What the stored truth is to be, and of which body; bar and budget are those of statics."""

    bar: Annotated[Number, Field(gt=0.0)] = 0.005
    """Error bar that is small enough, for every metric checked against the truth [-]."""
    minutes: Annotated[Number, Field(gt=0.0)] = 15.0
    """No finer mesh is begun that would take longer than this, for each strain measure [min]."""
    memory: Annotated[Number, Field(gt=0.0)] = 8.0
    """No finer mesh is begun that would need more memory than this [GB]."""
    surface: str | None = None
    """A finer surface of the body beside this file: what it changes is reported with the bars."""
    geometry_distance: Positive | None = None
    """How far the true surface may be from the mesh's, where no surface is given [units.length]."""


class EvidenceSpec(Table):
    """What a credibility file asks that only the user can say (ASME V&V 40-2018)."""

    question: str = ""
    """The question that the simulation is for."""
    context_of_use: str = ""
    """Where the result is used, and with what other evidence."""
    quantities_of_interest: str = ""
    """The quantities that are read from the result."""
    applicability: str = ""
    """How near the case is to its use."""
    model_influence: Literal["low", "medium", "high"] | None = None
    """How much the decision rests on the model."""
    decision_consequence: Literal["low", "medium", "high"] | None = None
    """How grave a wrong decision is."""
    fitted: tuple[str, ...] = ()
    """Inputs that were fitted to what is published or measured: `load[0].force`."""


class CaseSpec(Table):
    """A whole case file."""

    schema_version: Annotated[Literal[1], BeforeValidator(plain_number)] = Field(alias="schema")
    """Version of this format."""
    title: str = Field(min_length=1)
    """One line for people."""
    description: str = ""
    """What is simulated, and why."""
    units: Units = Units()
    """Units of this file; SI where nothing is said."""
    strain: Strain = Strain.GREEN
    """green is the material's law, linear Hooke's, for small turns and strains."""
    precision: Precision = Precision.DOUBLE
    """"single" grants float32 to every check that compares."""
    geometry: GeometrySpec
    """The body: exactly one of shape, surface and mesh."""
    mesh: MeshSpec = MeshSpec()
    """The program that fills a shape or surface, and how finely."""
    material: MaterialSpec
    """Material of the body."""
    support: tuple[SupportSpec, ...] = ()
    """Parts of the boundary that are fixed; the body may not float."""
    load: tuple[LoadSpec, ...] = ()
    """Loads that push."""
    spring: tuple[SpringSpec, ...] = ()
    """Springs that pull at a patch of the surface."""
    mass: tuple[MassSpec, ...] = ()
    """Masses that hang on the surface: gravity pulls them too, and they are inert in a motion."""
    inclusion: tuple[InclusionSpec, ...] = ()
    """Parts of another material."""
    tool: Annotated[tuple[ToolSpec, ...], BeforeValidator(as_list)] = ()
    """Rigid tools; [tool] stands for a single [[tool]]."""
    time: TimeSpec | None = None
    """Makes the case a motion, from rest or with an initial_velocity; statics without."""
    initial_velocity: StartSpec | None = None
    """Velocity at the start of a motion, except where supports fix. Free bodies need no support."""
    check: tuple[CheckSpec, ...] = ()
    """What is judged, with the reason for each limit."""
    marker: tuple[MarkerSpec, ...] = ()
    """Markers that were followed on the real body."""
    measurement: tuple[MeasurementSpec, ...] = ()
    """What was measured of the real body: for a fit, and, with a limit, judged."""
    uncertainty: tuple[UncertaintySpec, ...] = ()
    """How well inputs are known: counts in the verdict on a measurement."""
    truth: TruthSpec = TruthSpec()
    """What the stored truth is to be, and of which body."""
    evidence: EvidenceSpec = EvidenceSpec()
    """What a credibility file asks that only its author can say."""
    published: PlainData = Field(default_factory=dict)
    """Numbers of a paper, shown in the report; any keys."""

    @model_validator(mode="after")
    def _mesh_file_is_not_meshed(self) -> CaseSpec:
        given = sorted(self.mesh.model_fields_set - {"grade"})
        if self.geometry.mesh is not None and given:
            raise PydanticCustomError(
                "mesh_file",
                "a mesh file is graded, not meshed; remove this key, or give the body as "
                "[geometry] surface, which is meshed",
                {"path": ("mesh", given[0])},
            )
        return self

    @model_validator(mode="after")
    def _fitted_values_exist(self) -> CaseSpec:
        require_inputs(self, self.evidence.fitted, "evidence.fitted")
        return self

    @model_validator(mode="after")
    def _measurements_make_sense(self) -> CaseSpec:
        require_known_markers(self.marker, self.measurement)
        for measurement in self.measurement:
            if self.time is not None:
                raise ValueError("a [[measurement]] is of a case without [time]")
            if measurement.kind == "frequency" and self.tool:
                raise ValueError("a frequency is of a case without [tool]: nothing swings freely")
            if measurement.tool is not None and measurement.tool > len(self.tool):
                raise ValueError(
                    f"measurement {measurement.name!r}: there is no tool {measurement.tool}"
                )
        return self

    @model_validator(mode="after")
    def _true_surface_is_of_a_file(self) -> CaseSpec:
        given = [k for k in ("surface", "geometry_distance") if getattr(self.truth, k) is not None]
        if not given:
            return self
        if len(given) > 1:
            raise ValueError("[truth] takes surface or geometry_distance, not both")
        if self.geometry.shape is not None:
            raise ValueError(
                f"[truth] {given[0]} is for bodies from files: shape {self.geometry.shape!r} knows "
                "its own surface"
            )
        return self

    @model_validator(mode="after")
    def _masses_are_told_apart(self) -> CaseSpec:
        names = [mass.name for mass in self.mass if mass.name]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two masses are named {name!r}; give each its own name")
        return self

    @model_validator(mode="after")
    def _motion_needs_time(self) -> CaseSpec:
        if self.initial_velocity is not None and self.time is None:
            raise ValueError("initial_velocity is of a motion: give [time]")
        for check in self.check:
            metric = check.about
            if metric.needs_tools and not self.tool:
                raise ValueError(f"check {check.metric} needs [tool]")
            if metric.needs_time and self.time is None:
                raise ValueError(f"check {check.metric} needs [time]")
            if self.time is None:
                continue
            if check.against == "truth" and not metric.has_moving_truth:
                known = ", ".join(_names(lambda m: m.has_moving_truth))
                raise ValueError(
                    f"the truth of a case with [time] knows {known}; "
                    f'check {check.metric} against = "same_mesh"'
                )
            if check.against == "same_mesh" and self.time.time_step is None:
                raise ValueError(
                    f'check {check.metric} against = "same_mesh" is judged step by step: give '
                    'time_step in [time], the same for all, or check against = "truth"'
                )
        return self
