"""The keys of a case file. No expression is ever evaluated from a case."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from palpate.meshes.face_loads import Profile
from palpate.meshes.problem import Strain
from palpate.validation.case.geometry_schema import GeometrySpec, MeshSpec
from palpate.validation.case.motion_schema import (
    AmplitudeSpec,
    StartSpec,
    TimeSpec,
    ToolSpec,
    as_list,
)
from palpate.validation.case.named_values import require_inputs
from palpate.validation.case.numbers import Count, Flag, Number, PlainData, Vector, plain_number
from palpate.validation.case.region_schema import RegionSpec, Table
from palpate.validation.case.units import Units
from palpate.validation.metrics import CATALOGUE, Metric
from palpate.validation.states import Precision

if TYPE_CHECKING:
    MetricName: TypeAlias = str
else:
    MetricName = Literal[tuple(CATALOGUE)]


class MaterialSpec(Table):
    """Isotropic solid; the ranges are checked where it is built."""

    youngs_modulus: Number
    """Young's modulus [units.stress], above 0."""
    poissons_ratio: Number
    """Poisson's ratio [-], between -1 and 0.5; linear cells lock near 0.5."""
    density: Number = 1000.0
    """[units.density], above 0; matters for weight and motion."""


class InclusionSpec(Table):
    """Cells of another material: those whose centroid lies in the region."""

    region: RegionSpec
    """A box, a ball or a half_space; cells whose centroid lies in it."""
    material: MaterialSpec
    """Of those cells."""

    @model_validator(mode="after")
    def _chooses_cells(self) -> InclusionSpec:
        if self.region.group is not None or self.region.nearest is not None:
            raise ValueError("the region of an inclusion is a box, a ball or a half_space")
        return self


class OverTime(Table):
    """What acts from the start, or by a factor over time."""

    amplitude: AmplitudeSpec | None = None
    """Its factor over time; statics take it as 1."""


class TurnSpec(Table):
    """A turn about an axis through a place, the exact one at every part of the load."""

    axis: Vector
    """Direction of the axis, of any length; the turn is right-handed about it."""
    center: Vector
    """A place on the axis [units.length]."""
    angle_deg: Number
    """At full size [degrees]; more than a whole turn is one."""

    @model_validator(mode="after")
    def _has_an_axis(self) -> TurnSpec:
        if not any(self.axis):
            raise ValueError("axis = [0, 0, 0] turns nothing; give a direction")
        return self


class SupportSpec(OverTime):
    """What is held: by component, turned, or along a normal alone."""

    region: RegionSpec
    """What is held."""
    components: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
    """Which components are held."""
    sliding: Flag = False
    """Held along the normal of its face only, which has to be flat: a symmetry plane."""
    normal: Vector | None = None
    """Or held along this direction only, of any length; free to slide across it."""
    displacement: Vector = (0.0, 0.0, 0.0)
    """Where the held part is moved to [units.length]; of what slides, its part along the normal."""
    rotation: TurnSpec | None = None
    """Turns the held part besides; all components are held then."""

    @model_validator(mode="after")
    def _holds_in_one_way(self) -> SupportSpec:
        given = self.model_fields_set
        ways = [
            name
            for name, is_there in (
                ("components", "components" in given),
                ("sliding", self.sliding),
                ("normal", self.normal is not None),
                ("rotation", self.rotation is not None),
            )
            if is_there
        ]
        if len(ways) > 1:
            raise ValueError(f"{' and '.join(ways)} do not go together; choose one")
        if self.normal is not None and not any(self.normal):
            raise ValueError("normal = [0, 0, 0] is no direction")
        if self.sliding and self.region.nearest is not None:
            raise ValueError("a single point has no face to slide along; give a normal")
        return self


class ForceSpec(OverTime):
    """A total force, spread evenly over the region's area."""

    kind: Literal["force"]
    """A total force, spread evenly over the region's area."""
    region: RegionSpec
    """What is pushed."""
    force: Vector
    """In all [units.force]."""


class TractionAt(Table):
    """Force per rest area at a place."""

    at: Vector
    """The place [units.length]; it need not lie on the face."""
    traction: Vector
    """[units.stress]."""


class TractionSpec(OverTime):
    """Force per rest area, uniform or varying; dead: it does not turn with the body."""

    kind: Literal["traction"]
    """Force per rest area."""
    region: RegionSpec
    """What is pushed."""
    traction: Vector | None = None
    """[units.stress]; with a profile, where that is 1. In place of values."""
    profile: Profile | None = None
    """Along start to end, s from 0 to 1: linear is s, parabolic 4 s (1 - s), uniform 1."""
    start: Vector | None = None
    """Of a profile: where s = 0 [units.length]."""
    end: Vector | None = None
    """Of a profile: where s = 1 [units.length]."""
    values: tuple[TractionAt, ...] = Field(default=(), max_length=4)
    """Or its values at 1 to 4 places, affine in between and beyond."""

    @model_validator(mode="after")
    def _says_it_once(self) -> TractionSpec:
        if (self.traction is None) != bool(self.values):
            raise ValueError("needs traction, alone or with a profile, or values at 1 to 4 places")
        given = {key for key in ("profile", "start", "end") if getattr(self, key) is not None}
        if self.values and given:
            raise ValueError(f"values go without {', '.join(sorted(given))}")
        if given and len(given) < 3:
            raise ValueError("profile, start and end go together")
        if self.start is not None and self.start == self.end:
            raise ValueError("start and end of a profile are the same place")
        return self


class MomentSpec(OverTime):
    """A pure moment as the dead traction a x (X - c); no force in all."""

    kind: Literal["moment"]
    """A moment without a force, the same about every point."""
    region: RegionSpec
    """The face that it acts on; c is its centroid, a follows from its second moments."""
    moment: Vector
    """[units.force times units.length]; dead: cos(angle) of it is left where the face turns."""


class PressureSpec(OverTime):
    """Pressure that follows the surface; > 0 pushes inwards."""

    kind: Literal["pressure"]
    """A pressure that follows the surface."""
    region: RegionSpec
    """What is pressed."""
    pressure: Number
    """Above 0 pushes inwards [units.stress]."""


class GravitySpec(OverTime):
    """Weight: density times an acceleration [m/s2]."""

    kind: Literal["gravity"]
    """Weight."""
    acceleration: Vector
    """[m/s2], whatever the units."""


class PointForceSpec(OverTime):
    """A force on the point nearest to a place."""

    kind: Literal["point_force"]
    """A force on one point; has no truth to converge to."""
    region: RegionSpec
    """Its `nearest` chooses the point."""
    force: Vector
    """[units.force]."""


LoadSpec = Annotated[
    ForceSpec | TractionSpec | MomentSpec | PressureSpec | GravitySpec | PointForceSpec,
    Field(discriminator="kind"),
]


class CheckSpec(Table):
    """A limit and the reason for it."""

    metric: MetricName
    """What is compared, or measured of the candidate itself."""
    against: Literal["same_mesh", "truth", "candidate"] = "same_mesh"
    """The reference on the same mesh, the truth with its error bar, or the candidate alone."""
    strain: Strain | None = None
    """Which answer is judged; the case's strain where nothing is said."""
    limit: Number
    """What the error may be at most, from what the user needs; mostly [-]."""
    reason: str = Field(min_length=1)
    """Why this limit."""
    precision: Precision | None = None
    """"single" raises the limit to what float32 does; the case's where nothing is said."""
    at: Vector | None = None
    """Of what is published: the point of the mesh [units.length]."""
    component: Literal["x", "y", "z"] | None = None
    """Of what is published: which component."""
    quantity: Literal["amplitude", "frequency", "damping", "mean"] | None = None
    """Of a published_oscillation."""
    expected: Number | None = None
    """The published number [units.length, Hz or 1/s]; the reason names its source."""
    region: RegionSpec | None = None
    """Of stress_l2: cells looked at, away from clamped edges; of traction_resultant: one side."""
    support: Annotated[Count, Field(ge=1)] | None = None
    """Of a traction_resultant: the number of a [[support]], from 1, instead of a region."""

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
        given = [key for key in ("at", "component", "expected") if getattr(self, key) is not None]
        if (about.is_published and len(given) < 3) or (given and not about.is_published):
            raise ValueError(
                f"at, component and expected go with {' and '.join(_names(_is_published))}, "
                "all three"
            )
        if (about.is_published and about.is_fitted) != (self.quantity is not None):
            (swing,) = _names(lambda m: m.is_published and m.is_fitted)
            raise ValueError(f"quantity goes with {swing}: {swing} needs one")
        if about.is_published and not self.expected:
            raise ValueError("expected = 0 gives no scale; choose another component or point")
        self._looks_somewhere()
        if not about.is_own and self.limit <= 0.0:
            raise ValueError("limit must be above 0")
        return self

    def _looks_somewhere(self) -> None:
        """Raise ValueError where a part of the body is missing, or given where it has no place."""
        about = self.about
        if self.support is not None and not about.is_of_surface:
            surfaces = ", ".join(_names(lambda m: m.is_of_surface))
            raise ValueError(f"support goes with {surfaces}")
        if self.region is not None and about.of_part is None:
            parts = ", ".join(_names(lambda m: m.of_part is not None))
            raise ValueError(f"region goes with {parts}")
        if about.of_part is None:
            return
        if about.is_of_surface and (self.region is None) == (self.support is None):
            raise ValueError(
                f"{self.metric} needs support, the number of one, or region, one side of a cut"
            )
        if not about.is_of_surface and self.region is None:
            raise ValueError(
                f"{self.metric} needs region: cells away from clamped edges, where stress has no "
                "bound"
            )
        if self.region is not None and self.region.nearest is not None:
            raise ValueError(
                "the region of a check is a box, a ball, a half_space or a group, not a point"
            )

    @property
    def about(self) -> Metric:
        """What the catalogue says of its metric."""
        return CATALOGUE[self.metric]

    @property
    def is_of_truth_alone(self) -> bool:
        """Whether the truth itself, not the candidate, is held against a published number."""
        return self.against == "truth" and self.about.is_published


def _names(which: Callable[[Metric], bool]) -> list[str]:
    return [metric.name for metric in CATALOGUE.values() if which(metric)]


def _is_published(metric: Metric) -> bool:
    return metric.is_published


class TruthSpec(Table):
    """What the stored truth of a static case is to be: `palpate reference build` keeps to it."""

    bar: Annotated[Number, Field(gt=0.0)] = 0.005
    """Error bar that is small enough, of every metric checked against the truth [-]."""
    minutes: Annotated[Number, Field(gt=0.0)] = 15.0
    """No finer mesh is begun that would take longer, for each strain measure [min]."""
    memory: Annotated[Number, Field(gt=0.0)] = 8.0
    """Nor one that would need more than this [GB]."""


class EvidenceSpec(Table):
    """What a credibility file asks that only the user can say (ASME V&V 40-2018)."""

    question: str = ""
    """What the simulation shall answer."""
    context_of_use: str = ""
    """Where the answer is used, and beside what other evidence."""
    quantities_of_interest: str = ""
    """What is read from it."""
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
    """The law: green is Saint-Venant-Kirchhoff, linear is for small turns and strains."""
    precision: Precision = Precision.DOUBLE
    """"single" grants float32 to every check that compares."""
    geometry: GeometrySpec
    """The body: exactly one of shape, surface and mesh."""
    mesh: MeshSpec = MeshSpec()
    """Who fills a shape or surface, and how finely."""
    material: MaterialSpec
    """Of the body."""
    support: tuple[SupportSpec, ...] = ()
    """What is held; the body may not float."""
    load: tuple[LoadSpec, ...] = ()
    """What pushes."""
    inclusion: tuple[InclusionSpec, ...] = ()
    """Parts of another material."""
    tool: Annotated[tuple[ToolSpec, ...], BeforeValidator(as_list)] = ()
    """Rigid tools; [tool] stands for a single [[tool]]."""
    time: TimeSpec | None = None
    """Makes the case a motion, from rest or with an initial_velocity; statics without."""
    initial_velocity: StartSpec | None = None
    """Of a motion; what is held starts as its support does. Free bodies need no support."""
    check: tuple[CheckSpec, ...] = ()
    """What is judged, with the reason for each limit."""
    truth: TruthSpec = TruthSpec()
    """What the stored truth of a static case is to be."""
    evidence: EvidenceSpec = EvidenceSpec()
    """What a credibility file asks that only its author can say."""
    published: PlainData = Field(default_factory=dict)
    """Numbers of a paper, told in the report; any keys."""

    @model_validator(mode="after")
    def _fitted_values_exist(self) -> CaseSpec:
        require_inputs(self, self.evidence.fitted, "evidence.fitted")
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
