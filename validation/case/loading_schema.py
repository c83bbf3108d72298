"""The keys of a case file for what acts on the body: time, tools, supports and loads."""

from __future__ import annotations

from itertools import chain
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from palpate.meshes.face_loads import Profile
from palpate.meshes.rigid_tool import ContactRule
from palpate.validation.case.body_schema import (
    Count,
    Flag,
    NotNegative,
    Number,
    Positive,
    RegionSpec,
    Table,
    Vector,
    require_keys,
)

# States stored of a motion; each is as large as the result of a static case.
MOST_OUTPUTS = 100_000


class TimeSpec(Table):
    """The time axis of a dynamic case; times in s."""

    end_time: Positive
    """End of the motion [s]."""
    time_step: Positive | None = None
    """Time step [s]; only for checks on the same mesh, where all take the same steps."""
    mass_damping: NotNegative = 0.0
    """lambda in D = lambda M [1/s]."""
    stiffness_damping: NotNegative = 0.0
    """beta of a viscous stress beta C : dE/dt, C at rest [s]; D = beta K for small strains."""
    num_outputs: Annotated[Count, Field(ge=1, le=MOST_OUTPUTS)] = 50
    """States stored after the first, evenly spaced."""


class StartSpec(Table):
    """Velocity at the start, that of a rigid body: velocity + angular_velocity x (X - center)."""

    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the center [units.length per s]."""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity [rad/s]."""
    center: Vector = (0.0, 0.0, 0.0)
    """The point that moves with `velocity` [units.length]."""


class AmplitudeSpec(Table):
    """A factor over time, by knots; see meshes/amplitude.py."""

    times: tuple[Number, ...] = Field(min_length=1)
    """Knots [s], increasing."""
    factors: tuple[Number, ...] = Field(min_length=1)
    """Factor at each knot [-]."""
    smooth: Flag = False
    """Smooth steps that hardly excite oscillations, instead of straight lines."""


class RotationSpec(Table):
    """A turn about an axis through the tool's origin."""

    axis: Vector
    """Direction, through the tool's origin."""
    angle_deg: Number
    """Angle [degrees]."""

    @model_validator(mode="after")
    def _has_an_axis(self) -> RotationSpec:
        if not any(self.axis):
            raise ValueError("axis = [0, 0, 0] turns nothing; give a direction")
        return self


class PoseSpec(Table):
    """Position and rotation of the tool at a time [s]."""

    time: Number
    """Time [s]; in statics a load parameter, of which the last counts."""
    position: Vector
    """Position of the tool's origin [units.length]."""
    rotation: RotationSpec | None = None
    """Rotation from the frame that the tool is described in."""


class DriveSpec(Table):
    """The tool is pushed along a direction by a force."""

    direction: Vector
    """Unit vector of the force."""
    force: Number
    """Force along the direction [units.force]."""
    mass: Positive
    """Mass of the tool [kg]."""
    amplitude: AmplitudeSpec = AmplitudeSpec(times=(0.0,), factors=(1.0,))
    """Factor of the force over time."""


# Sizes of each shape of a tool, in the order in which its maker takes them.
TOOL_SIZES: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "capsule": ("radius", "half_length"),
    "box": ("half_widths",),
    "plane": (),
    "surface": ("surface",),
}


class ToolSpec(Table):
    """A rigid tool; lengths in the case's unit."""

    shape: Literal["sphere", "capsule", "box", "plane", "surface"]
    """A capsule lies along the tool's z axis; a plane is its half space z <= 0."""
    radius: Positive | None = None
    """Radius of a sphere or a capsule [units.length]."""
    half_length: Positive | None = None
    """From the origin to the centre of a capsule's end [units.length]."""
    half_widths: tuple[Positive, Positive, Positive] | None = None
    """Half the widths of a box [units.length]."""
    surface: str | None = None
    """A closed surface beside this file, in the tool's frame."""
    pose: tuple[PoseSpec, ...] = Field(min_length=1)
    """Position and rotation over time, linear from one pose to the next."""
    smooth: Flag = False
    """Smooth motion that comes to rest at every pose, not at constant speeds."""
    drive: DriveSpec | None = None
    """A force that pushes the tool instead of following the poses; one pose is its start."""
    friction_coefficient: NotNegative = 0.0
    """Coulomb's coefficient of friction [-]."""
    contact: ContactRule = ContactRule.VERTICES
    """Where linear tetrahedra are kept out of the tool: at vertices, or averaged over facets."""
    region: RegionSpec | None = None
    """The part of the boundary that may touch; all of it where nothing is said."""

    @model_validator(mode="after")
    def _has_its_sizes(self) -> ToolSpec:
        given = {key for key in chain(*TOOL_SIZES.values()) if getattr(self, key) is not None}
        needed = set(TOOL_SIZES[self.shape])
        require_keys(f"shape {self.shape!r}", missing=needed - given, extra=given - needed)
        return self


def as_list(value: Any) -> Any:
    """[tool] stands for one [[tool]]."""
    return [value] if isinstance(value, dict) else value


class OverTime(Table):
    """Anything that acts from the start, or by a factor over time."""

    amplitude: AmplitudeSpec | None = None
    """Factor over time; statics take it as 1."""


class TurnSpec(RotationSpec):
    """A turn about an axis through a point, the exact one at every part of the load."""

    axis: Vector
    """Direction of the axis, of any length; the turn is right-handed about it."""
    center: Vector
    """A point on the axis [units.length]."""
    angle_deg: Number
    """Angle at full size [degrees]; it may exceed a whole turn."""


class SupportSpec(OverTime):
    """What is fixed or moved: by component, turned, or along a normal alone."""

    region: RegionSpec
    """The part of the boundary that is fixed."""
    components: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
    """Which components are fixed."""
    sliding: Flag = False
    """Fixed along the normal of its face only, which has to be flat: a symmetry plane."""
    normal: Vector | None = None
    """Direction along which alone it is fixed, of any length; free to slide across it."""
    displacement: Vector = (0.0, 0.0, 0.0)
    """Displacement of that part [units.length]; where it slides, along the normal only."""
    rotation: TurnSpec | None = None
    """Rotation of that part besides; all components are then fixed."""

    @model_validator(mode="after")
    def _holds_in_one_way(self) -> SupportSpec:
        ways = ["components"] if "components" in self.model_fields_set else []
        ways += [name for name in ("sliding", "normal", "rotation") if getattr(self, name)]
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
    """The part of the boundary that is pushed."""
    force: Vector
    """Total force [units.force]."""


_OF_LIQUIDS = ("density", "free_surface", "gravity")


class TractionAt(Table):
    """Force per rest area at a position."""

    at: Vector
    """The position [units.length]; it need not lie on the face."""
    traction: Vector
    """Force per rest area [units.stress]."""


class TractionSpec(OverTime):
    """Force per rest area, uniform or varying; dead: it does not turn with the body."""

    kind: Literal["traction"]
    """Force per rest area."""
    region: RegionSpec
    """The part of the boundary that is pushed."""
    traction: Vector | None = None
    """Force per rest area [units.stress]; with a profile, where that is 1. Instead of values."""
    profile: Profile | None = None
    """From start to end, s from 0 to 1: linear is s, parabolic 4 s (1 - s); or of a liquid."""
    start: Vector | None = None
    """Start of a profile, where s = 0 [units.length]."""
    end: Vector | None = None
    """End of a profile, where s = 1 [units.length]."""
    density: Positive | None = None
    """Density of the liquid of a hydrostatic profile [units.density]."""
    gravity: Vector | None = None
    """Gravity of a hydrostatic profile [m/s2], whatever the units."""
    free_surface: Vector | None = None
    """A position where a hydrostatic profile has pressure 0 [units.length]."""
    values: tuple[TractionAt, ...] = Field(default=(), max_length=4)
    """The traction at 1 to 4 positions instead, affine in between and beyond."""

    @model_validator(mode="after")
    def _says_it_once(self) -> TractionSpec:
        liquid = [key for key in _OF_LIQUIDS if getattr(self, key) is not None]
        if self.profile is Profile.HYDROSTATIC:
            others = {"traction", "values", "start", "end"} & self.model_fields_set
            if others or len(liquid) < 3:
                raise ValueError(
                    "a hydrostatic profile needs density, gravity and free_surface, and goes "
                    "without traction, values, start and end"
                )
            if not any(self.gravity or ()):
                raise ValueError("gravity = [0, 0, 0] presses nothing; give a direction")
            return self
        if liquid:
            raise ValueError(f'{", ".join(liquid)} goes with profile = "hydrostatic"')
        if (self.traction is None) != bool(self.values):
            raise ValueError("needs traction, alone or with a profile, or values at 1 to 4 points")
        given = {key for key in ("profile", "start", "end") if getattr(self, key) is not None}
        if self.values and given:
            raise ValueError(f"values go without {', '.join(sorted(given))}")
        if given and len(given) < 3:
            raise ValueError("profile, start and end go together")
        if self.start is not None and self.start == self.end:
            raise ValueError("start and end of a profile are the same position")
        return self


class MomentSpec(OverTime):
    """A pure moment as the dead traction a x (X - c); no force in all."""

    kind: Literal["moment"]
    """A moment without a force, the same about every point."""
    region: RegionSpec
    """The face that it acts on; c is its centroid, a follows from its second moments."""
    moment: Vector
    """Moment [units.force times units.length]; dead: cos(angle) is left where the face turns."""


class PressureSpec(OverTime):
    """Pressure that follows the surface; > 0 pushes inwards."""

    kind: Literal["pressure"]
    """A pressure that follows the surface."""
    region: RegionSpec
    """The part of the boundary that is pressed."""
    pressure: Number
    """Pressure [units.stress]; above 0 it pushes inwards."""


class GravitySpec(OverTime):
    """Weight: density times an acceleration [m/s2]."""

    kind: Literal["gravity"]
    """Weight."""
    acceleration: Vector
    """Acceleration [m/s2], whatever the units."""


class PointForceSpec(OverTime):
    """A force on the point nearest to a position, or on each of a group of points."""

    kind: Literal["point_force"]
    """A force on single points; there is no truth that it converges to."""
    region: RegionSpec
    """Chooses one point by `nearest`, or several by `group`."""
    force: Vector
    """Force on each point [units.force]."""


class AnchorSpec(Table):
    """Position of a spring's anchor at a time."""

    time: Number
    """Time [s]."""
    displacement: Vector
    """Displacement from the position with the body at rest [units.length]."""


class SpringSpec(OverTime):
    """A spring over a patch of the surface, as by forceps, pulled by a moved anchor."""

    amplitude: AmplitudeSpec | None = None
    """Factor over time on its stiffness, 0 (let go) to 1; statics take it as 1."""
    center: Vector
    """Centre of the patch, on the surface at rest [units.length]."""
    radius: Positive
    """Radius of the patch; the spring's weight falls smoothly to 0 there [units.length]."""
    stiffness: Positive
    """Stiffness of the whole patch [units.force per units.length]."""
    displacement: Vector | None = None
    """Displacement of the anchor from the start on [units.length]; or a path."""
    path: tuple[AnchorSpec, ...] = ()
    """Positions of the anchor over time, linear in between; statics take the last one."""
    smooth: Flag = False
    """Smooth motion that comes to rest at every position of the path, not at constant speeds."""

    @model_validator(mode="after")
    def _moves_in_one_way(self) -> SpringSpec:
        if (self.displacement is None) != bool(self.path):
            raise ValueError("needs displacement or path, one of the two")
        if self.smooth and not self.path:
            raise ValueError("smooth goes with path")
        return self


class MassSpec(Table):
    """A mass that hangs on the surface: inert in a motion, and heavy where a gravity load acts."""

    name: str = Field(default="", pattern=r"^[A-Za-z0-9_-]{0,64}$")
    """Name by which an experiment addresses it: letters, digits, '_' and '-'."""
    region: RegionSpec
    """The part of the boundary over which it is spread evenly, by area at rest."""
    mass: NotNegative
    """The whole mass [units.mass]."""


LoadSpec = Annotated[
    ForceSpec | TractionSpec | MomentSpec | PressureSpec | GravitySpec | PointForceSpec,
    Field(discriminator="kind"),
]
