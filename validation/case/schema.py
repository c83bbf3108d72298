"""The keys of a case file. No expression is ever evaluated from a case."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from palpate.meshes.problem import Strain
from palpate.validation.case.motion_schema import AmplitudeSpec, TimeSpec, ToolSpec, as_list
from palpate.validation.case.named_values import require_inputs
from palpate.validation.case.numbers import (
    Flag,
    Number,
    PlainData,
    Positive,
    Vector,
    plain_number,
)
from palpate.validation.case.region_schema import BallRegion, RegionSpec, Table
from palpate.validation.case.units import Units
from palpate.validation.metrics import CATALOGUE, MOVING_TRUTH_METRICS
from palpate.validation.states import Precision

# Held against a number of the case file: the candidate's answer, or the truth itself.
PUBLISHED = "published_displacement"
PUBLISHED_SWING = "published_oscillation"
PUBLISHED_METRICS = (PUBLISHED, PUBLISHED_SWING)
# The candidate's own, without a reference.
OWN_METRICS = tuple(
    metric.name
    for metric in CATALOGUE.values()
    if metric.compare is None and metric.name not in PUBLISHED_METRICS
)
# What the truth of a motion can be asked for.
MOVING_TRUTH = (*MOVING_TRUTH_METRICS, *PUBLISHED_METRICS)


class GeometrySpec(Table):
    """Exactly one of a built-in shape, a surface file or a mesh file."""

    shape: Literal["box", "beam", "cylinder", "sphere", "kidney"] | None = None
    surface: str | None = None
    mesh: str | None = None
    # Mend a surface file where that is safe; what was done is told in the report.
    repair: Flag = False
    size: Vector | None = None
    length: Positive | None = None
    width: Positive | None = None
    height: Positive | None = None
    radius: Positive | None = None
    edge_length: Positive | None = None

    @model_validator(mode="after")
    def _is_one_thing(self) -> GeometrySpec:
        given = [k for k in ("shape", "surface", "mesh") if getattr(self, k) is not None]
        if len(given) != 1:
            raise ValueError("needs exactly one of shape, surface, mesh")
        parameters = {
            None: set(),
            "box": {"size", "edge_length"},
            "beam": {"length", "width", "height", "edge_length"},
            "cylinder": {"radius", "height", "edge_length"},
            "sphere": {"radius", "edge_length"},
            "kidney": {"edge_length"},
        }[self.shape]
        extra = self.model_fields_set - parameters - {"shape", "surface", "mesh"}
        if self.surface is not None:
            extra.discard("repair")
        missing = parameters - self.model_fields_set
        what = f"shape {self.shape!r}" if self.shape else given[0]
        wrongs = [f"takes no {', '.join(sorted(extra))}"] if extra else []
        wrongs += [f"needs {', '.join(sorted(missing))}"] if missing else []
        if wrongs:
            hint = "; cells are sized by edge_length" if extra == {"size"} else ""
            raise ValueError(f"{what} {' and '.join(wrongs)}{hint}")
        return self


class GradeSpec(Table):
    """Smaller cells towards a point, a ball or the whole boundary; sizes grow with distance."""

    point: Vector | None = None
    ball: BallRegion | None = None
    boundary: Flag = False
    smallest: Positive
    growth: Positive = 0.5

    @model_validator(mode="after")
    def _is_towards_one_thing(self) -> GradeSpec:
        if (self.point is not None) + (self.ball is not None) + self.boundary != 1:
            raise ValueError("needs exactly one of point, ball, boundary = true")
        return self


class MeshSpec(Table):
    """Who fills a surface, and how finely."""

    mesher: Literal["auto", "fastsim", "gmsh"] = "auto"
    edge_length: Positive | None = None
    # The given facets, or better ones within a distance of them.
    boundary: Literal["kept", "free"] = "kept"
    boundary_distance: Positive | None = None
    # Bisected afterwards until each cell is as small as every grade asks.
    grade: tuple[GradeSpec, ...] = ()

    @model_validator(mode="after")
    def _free_says_how_far(self) -> MeshSpec:
        if (self.boundary == "free") != (self.boundary_distance is not None):
            raise ValueError('boundary = "free" and boundary_distance go together')
        return self


class MaterialSpec(Table):
    """Isotropic solid; the ranges are checked where it is built."""

    youngs_modulus: Number
    poissons_ratio: Number
    density: Number = 1000.0


class InclusionSpec(Table):
    """Cells of another material: those whose centroid lies in the region."""

    region: RegionSpec
    material: MaterialSpec

    @model_validator(mode="after")
    def _chooses_cells(self) -> InclusionSpec:
        if self.region.group is not None or self.region.nearest is not None:
            raise ValueError("the region of an inclusion is a box, a ball or a half_space")
        return self


class OverTime(Table):
    """What acts from the start, or by a factor over time."""

    amplitude: AmplitudeSpec | None = None


class SupportSpec(OverTime):
    """What is held."""

    region: RegionSpec
    components: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
    displacement: Vector = (0.0, 0.0, 0.0)


class ForceSpec(OverTime):
    """A total force, spread evenly over the region's area."""

    kind: Literal["force"]
    region: RegionSpec
    force: Vector


class TractionSpec(OverTime):
    """Force per rest area."""

    kind: Literal["traction"]
    region: RegionSpec
    traction: Vector


class PressureSpec(OverTime):
    """Pressure that follows the surface; > 0 pushes inwards."""

    kind: Literal["pressure"]
    region: RegionSpec
    pressure: Number


class GravitySpec(OverTime):
    """Weight: density times an acceleration [m/s2]."""

    kind: Literal["gravity"]
    acceleration: Vector


class PointForceSpec(OverTime):
    """A force on the point nearest to a place."""

    kind: Literal["point_force"]
    region: RegionSpec
    force: Vector


LoadSpec = Annotated[
    ForceSpec | TractionSpec | PressureSpec | GravitySpec | PointForceSpec,
    Field(discriminator="kind"),
]


class CheckSpec(Table):
    """A limit and the reason for it."""

    metric: Literal[
        "displacement_l2",
        "displacement_h1",
        "energy_norm",
        "displacement_max",
        "max_displacement",
        "volume",
        "local_volume",
        "surface_area",
        "surface_hausdorff",
        "surface_mean_distance",
        "reaction_force",
        "tool_force",
        "strain_energy",
        "trajectory_l2",
        "oscillation_amplitude",
        "oscillation_frequency",
        "oscillation_phase",
        "oscillation_damping",
        "oscillation_mean",
        "smallest_det_f",
        "inverted_cells",
        "published_displacement",
        "published_oscillation",
    ]
    against: Literal["same_mesh", "truth", "candidate"] = "same_mesh"
    strain: Strain | None = None
    limit: Number
    reason: str = Field(min_length=1)
    # "single" raises a limit to what rounding to float32 does; the case's where nothing is said.
    precision: Precision | None = None
    # Of what is published: a point of the mesh, which component, and the number there, in the
    # case's length unit, Hz or 1/s; the reason names the source.
    at: Vector | None = None
    component: Literal["x", "y", "z"] | None = None
    quantity: Literal["amplitude", "frequency", "damping", "mean"] | None = None
    expected: Number | None = None

    @model_validator(mode="after")
    def _makes_sense(self) -> CheckSpec:
        is_published = self.metric in PUBLISHED_METRICS
        if is_published and self.against == "same_mesh":
            raise ValueError(
                f'{self.metric} goes with against = "candidate", or "truth" for the '
                "reference's own"
            )
        if not is_published and (self.metric in OWN_METRICS) != (self.against == "candidate"):
            own = ", ".join((*OWN_METRICS, *PUBLISHED_METRICS))
            raise ValueError(f'{own} go with against = "candidate", and nothing else does')
        if CATALOGUE[self.metric].needs_same_mesh and self.against != "same_mesh":
            raise ValueError(f'{self.metric} goes with against = "same_mesh" only')
        if self.precision is not None and self.metric in OWN_METRICS:
            raise ValueError(f"precision goes with what is compared, not with {self.metric}")
        given = [key for key in ("at", "component", "expected") if getattr(self, key) is not None]
        if (is_published and len(given) < 3) or (given and not is_published):
            raise ValueError(
                f"at, component and expected go with {' and '.join(PUBLISHED_METRICS)}, all three"
            )
        if (self.metric == PUBLISHED_SWING) != (self.quantity is not None):
            raise ValueError(f"quantity goes with {PUBLISHED_SWING}: {PUBLISHED_SWING} needs one")
        if is_published and not self.expected:
            raise ValueError("expected = 0 gives no scale; choose another component or point")
        if self.metric not in OWN_METRICS and self.limit <= 0.0:
            raise ValueError("limit must be above 0")
        return self


class EvidenceSpec(Table):
    """What a credibility file asks that only the user can say (ASME V&V 40-2018)."""

    question: str = ""
    context_of_use: str = ""
    quantities_of_interest: str = ""
    applicability: str = ""
    model_influence: Literal["low", "medium", "high"] | None = None
    decision_consequence: Literal["low", "medium", "high"] | None = None
    # Inputs that were fitted to what is published or measured: `load[0].force`.
    fitted: tuple[str, ...] = ()


class CaseSpec(Table):
    """A whole case file."""

    schema_version: Annotated[Literal[1], BeforeValidator(plain_number)] = Field(alias="schema")
    title: str = Field(min_length=1)
    description: str = ""
    units: Units = Units()
    strain: Strain = Strain.GREEN
    # "single" grants float32 to every check that compares; see metrics/rounding.py.
    precision: Precision = Precision.DOUBLE
    geometry: GeometrySpec
    mesh: MeshSpec = MeshSpec()
    material: MaterialSpec
    support: tuple[SupportSpec, ...] = ()
    load: tuple[LoadSpec, ...] = ()
    inclusion: tuple[InclusionSpec, ...] = ()
    tool: Annotated[tuple[ToolSpec, ...], BeforeValidator(as_list)] = ()
    time: TimeSpec | None = None
    check: tuple[CheckSpec, ...] = ()
    evidence: EvidenceSpec = EvidenceSpec()
    published: PlainData = Field(default_factory=dict)

    @model_validator(mode="after")
    def _fitted_values_exist(self) -> CaseSpec:
        require_inputs(self, self.evidence.fitted, "evidence.fitted")
        return self

    @model_validator(mode="after")
    def _motion_needs_time(self) -> CaseSpec:
        for check in self.check:
            metric = CATALOGUE[check.metric]
            if metric.needs_tools and not self.tool:
                raise ValueError(f"check {check.metric} needs [tool]")
            if metric.needs_time and self.time is None:
                raise ValueError(f"check {check.metric} needs [time]")
            if self.time is None:
                continue
            if check.against == "truth" and check.metric not in MOVING_TRUTH:
                raise ValueError(
                    f"the truth of a case with [time] knows {', '.join(MOVING_TRUTH)}; "
                    f'check {check.metric} against = "same_mesh"'
                )
            if check.against == "same_mesh" and self.time.time_step is None:
                raise ValueError(
                    f'check {check.metric} against = "same_mesh" is judged step by step: give '
                    'time_step in [time], the same for all, or check against = "truth"'
                )
            if check.against == "truth" and self.tool:
                raise ValueError(
                    'a case with [time] and [tool] has no truth; check against = "same_mesh"'
                )
        return self
