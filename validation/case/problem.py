"""From the tables of a case to the problem that every simulator is given, in SI units."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Indices
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.errors import InputError
from palpate.meshes.face_loads import (
    affine_traction,
    hydrostatic_traction,
    moment_traction,
    profile_traction,
)
from palpate.meshes.material_law import Law
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Inclusion, InitialVelocity, Material, Problem, TimeSpan
from palpate.meshes.rigid_modes import require_supported
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
    ToolShape,
    smooth_path,
)
from palpate.meshes.spring import AnchorPath, Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case.body_schema import InclusionSpec, MaterialSpec, RegionSpec
from palpate.validation.case.geometry import inside_folder, load_surface
from palpate.validation.case.loading_schema import (
    TOOL_SIZES,
    AmplitudeSpec,
    ForceSpec,
    GravitySpec,
    LoadSpec,
    MassSpec,
    MomentSpec,
    PointForceSpec,
    PoseSpec,
    PressureSpec,
    SpringSpec,
    StartSpec,
    SupportSpec,
    ToolSpec,
    TractionSpec,
)
from palpate.validation.case.regions import (
    chooses_points,
    flat_normal,
    select_cells,
    select_facets,
    single_points,
)
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.units import Units
from palpate.validation.exchange.nodal_arrays import facet_areas

# Largest load or displacement in SI units: squares and sums of it are still finite.
_LARGEST = 1e100
# Name and unit of each kind of load's size.
_SIZES = {"force_density": "N/m3", "traction": "Pa", "pressure": "Pa", "forces": "N"}
# Shapes of tools that take sizes.
_SHAPES: dict[str, Callable[..., ToolShape]] = {
    "sphere": SphereShape,
    "capsule": CapsuleShape,
    "box": BoxShape,
    "plane": PlaneShape,
}


def build_problem(spec: CaseSpec, folder: Path, mesh: TetMesh) -> Problem:
    """Supports, loads, springs, tools, masses and materials of a case on its mesh.

    Loads are those of the case in their order, then the weight of each mass under each gravity.

    Raises:
        InputError: A region that selects nothing, a body that floats, a bad value.
    """
    build = _Builder(spec.units, mesh)
    material = build.material(spec.material)
    time = spec.time
    masses = tuple(build.mass(s, f"mass {k}") for k, s in enumerate(spec.mass, 1))
    loads = [build.load(s, material, f"load {k}") for k, s in enumerate(spec.load, 1)]
    # After the loads that the case numbers: gravity pulls at the masses too.
    loads += [build.weight(mass, s) for s in spec.load if s.kind == "gravity" for mass in masses]
    problem = Problem(
        mesh,
        material,
        tuple(build.support(s, f"support {k}") for k, s in enumerate(spec.support, 1)),
        tuple(loads),
        None if time is None else TimeSpan(**time.model_dump()),
        tuple(build.tool(s, folder, f"tool {k}") for k, s in enumerate(spec.tool, 1)),
        tuple(build.inclusion(s, f"inclusion {k}") for k, s in enumerate(spec.inclusion, 1)),
        build.start(spec.initial_velocity),
        tuple(build.spring(s, f"spring {k}") for k, s in enumerate(spec.spring, 1)),
        masses,
    )
    # A motion may be that of a free body.
    if time is None:
        require_supported(problem)
    return problem


class _Builder:
    """Builds one table at a time, with the case's units and mesh."""

    def __init__(self, units: Units, mesh: TetMesh) -> None:
        self.units, self.mesh = units, mesh

    def material(self, spec: MaterialSpec) -> Material:
        density = self.units.kilograms_per_cubic_metre(spec.density)
        pascals = self.units.pascals
        match spec:
            case MaterialSpec(c10=float(c10), c01=float(c01), bulk_modulus=float(kappa)):
                return Material.mooney_rivlin(
                    c10=pascals(c10),
                    c01=pascals(c01),
                    bulk_modulus=pascals(kappa),
                    density=density,
                    law=spec.law,
                )
            case MaterialSpec(law=Law.OGDEN, bulk_modulus=float(kappa)):
                pairs = (
                    (spec.mu_1, spec.alpha_1),
                    (spec.mu_2, spec.alpha_2),
                    (spec.mu_3, spec.alpha_3),
                )
                terms = [(pascals(m), a) for m, a in pairs if m is not None and a is not None]
                return Material.ogden(terms, bulk_modulus=pascals(kappa), density=density)
            case MaterialSpec(youngs_modulus=float(modulus), poissons_ratio=float(ratio)):
                return Material(pascals(modulus), ratio, density, spec.law)
        raise AssertionError("the schema asks for either")

    def inclusion(self, spec: InclusionSpec, what: str) -> Inclusion:
        region = spec.region
        if spec.label is not None:
            region = RegionSpec(group=spec.label)
        if region is None:
            # Named so by the mesh that was made of the surfaces.
            return Inclusion(self.mesh.cell_groups[what], self.material(spec.material))
        name, known = region.group, self.mesh.cell_groups
        if name is not None and name not in known:
            raise InputError(
                f"{what}: no group of cells {name!r} in the mesh "
                f"(known: {', '.join(sorted(known)) or 'none'})"
            )
        cells = select_cells(self.mesh, region, self.units, what)
        return Inclusion(cells, self.material(spec.material))

    def support(self, spec: SupportSpec, what: str) -> Support:
        x, y, z = ("x" in spec.components, "y" in spec.components, "z" in spec.components)
        displacement, amplitude = self.units.lengths(spec.displacement), _amplitude(spec.amplitude)
        factors = (1.0,) if amplitude is None else amplitude.factors
        _require_usable(np.outer(factors, displacement), what, "m")
        if chooses_points(self.mesh, spec.region):
            points = single_points(self.mesh, spec.region, self.units, what)
            facets = np.zeros((0, 3), dtype=np.int32)
        else:
            facets = select_facets(self.mesh, spec.region, self.units, what)
            points = np.unique(facets).astype(np.int32)
        normal = _unit(spec.normal) if spec.normal is not None else None
        if spec.sliding and not len(facets):
            raise InputError(f"{what}: single points have no face to slide along; give a normal")
        if spec.sliding:
            normal = flat_normal(self.mesh, facets, what)
        if normal is not None:
            axis = [abs(n) == 1.0 for n in normal]
            if not any(axis):
                return Support(
                    points, facets, displacement=displacement, amplitude=amplitude, normal=normal
                )
            x, y, z = axis
        turn = spec.rotation
        rotation = None
        if turn is not None:
            center, angle = self.units.lengths(turn.center), math.radians(turn.angle_deg)
            rotation = Rotation(_unit(turn.axis), center, angle)
        return Support(points, facets, (x, y, z), displacement, amplitude, rotation)

    def start(self, spec: StartSpec | None) -> InitialVelocity | None:
        if spec is None:
            return None
        lengths = self.units.lengths
        given = lengths(spec.velocity), spec.angular_velocity, lengths(spec.center)
        _require_usable(np.array(given), "initial_velocity", "m/s")
        return InitialVelocity(*given)

    def spring(self, spec: SpringSpec, what: str) -> Spring:
        units = self.units
        if spec.displacement is None:
            times = [anchor.time for anchor in spec.path]
            moved = [units.lengths(anchor.displacement) for anchor in spec.path]
        else:
            times, moved = [0.0], [units.lengths(spec.displacement)]
        stiffness, largest = units.newtons_per_metre(spec.stiffness), np.abs(moved).max()
        _require_usable(np.array([stiffness]), what, "N/m")
        _require_usable(np.array([largest]), what, "m")
        try:
            return Spring.on(
                self.mesh,
                units.lengths(spec.center),
                units.metres(spec.radius),
                stiffness,
                AnchorPath(np.array(times), np.array(moved), spec.smooth),
                _amplitude(spec.amplitude),
            )
        except InputError as error:
            raise InputError(f"{what}: {error}") from error

    def mass(self, spec: MassSpec, what: str) -> PointMass:
        kilograms = self.units.kilograms(spec.mass)
        _require_usable(np.array([kilograms]), what, "kg")
        facets = select_facets(self.mesh, spec.region, self.units, what)
        return PointMass(facets, kilograms, spec.name)

    def weight(self, mass: PointMass, spec: GravitySpec) -> Traction:
        return mass.weight(self.mesh.points, spec.acceleration, _amplitude(spec.amplitude))

    def tool(self, spec: ToolSpec, folder: Path, what: str) -> RigidTool:
        units, drive = self.units, None
        facets = np.zeros((0, 3), dtype=np.int32)
        if spec.region is not None:
            facets = select_facets(self.mesh, spec.region, units, what)
        path = ToolPath(
            np.array([pose.time for pose in spec.pose]),
            np.array([units.lengths(pose.position) for pose in spec.pose]),
            np.array([_quaternion(pose) for pose in spec.pose]),
        )
        if spec.drive is not None:
            amplitude, force = _amplitude(spec.drive.amplitude), units.newtons(spec.drive.force)
            assert amplitude is not None
            drive = ForceDrive(spec.drive.direction, force, amplitude, spec.drive.mass)
        path = smooth_path(path) if spec.smooth else path
        shape = _shape(spec, units, folder)
        return RigidTool(shape, path, spec.friction_coefficient, facets, drive, spec.contact)

    def load(self, spec: LoadSpec, material: Material, what: str) -> Load:
        if isinstance(spec, TractionSpec) and spec.values:
            # Before an affine field is fitted, whose rounding is as large as they are.
            written = [self.units.pascals(t) for value in spec.values for t in value.traction]
            _require_usable(np.array(written), what, "Pa")
        built = self._load(spec, material, what)
        factors = (1.0,) if built.amplitude is None else built.amplitude.factors
        for name, unit in _SIZES.items():
            _require_usable(np.outer(factors, getattr(built, name, 0.0)), what, unit)
        if isinstance(built, Traction) and not built.is_uniform:
            values = built.at(self.mesh.points[np.unique(built.facets)])
            _require_usable(np.outer(factors, values), what, "Pa")
        return built

    def _load(self, spec: LoadSpec, material: Material, what: str) -> Load:
        mesh, units, amplitude = self.mesh, self.units, _amplitude(spec.amplitude)
        if isinstance(spec, GravitySpec):
            gx, gy, gz = (material.density * a for a in spec.acceleration)
            return BodyForce((gx, gy, gz), amplitude)
        if isinstance(spec, PointForceSpec):
            points = single_points(mesh, spec.region, units, what)
            force = np.array([[units.newtons(f) for f in spec.force]])
            return PointForce(points, np.repeat(force, len(points), axis=0), amplitude)
        facets = select_facets(mesh, spec.region, units, what)
        match spec:
            case PressureSpec():
                return Pressure(facets, units.pascals(spec.pressure), amplitude)
            case TractionSpec():
                return self._traction(spec, facets, amplitude, what)
            case MomentSpec():
                moment = [units.newtons(m) * units.metres(1.0) for m in spec.moment]
                return moment_traction(mesh, facets, moment, amplitude)
            case ForceSpec():
                area = float(facet_areas(mesh.points, facets).sum())
                tx, ty, tz = (units.newtons(f) / area for f in spec.force)
                return Traction(facets, (tx, ty, tz), amplitude)

    def _traction(
        self, spec: TractionSpec, facets: Indices, amplitude: TabularAmplitude | None, what: str
    ) -> Traction:
        units = self.units
        try:
            if spec.density is not None and spec.gravity and spec.free_surface:
                density = units.kilograms_per_cubic_metre(spec.density)
                level = units.lengths(spec.free_surface)
                return hydrostatic_traction(
                    self.mesh, facets, density, spec.gravity, level, amplitude
                )
            if spec.traction is None:
                positions = [units.lengths(value.at) for value in spec.values]
                values = [[units.pascals(t) for t in value.traction] for value in spec.values]
                return affine_traction(facets, positions, values, amplitude)
            x, y, z = (units.pascals(t) for t in spec.traction)
            if spec.profile is None or spec.start is None or spec.end is None:
                return Traction(facets, (x, y, z), amplitude)
            start, end = units.lengths(spec.start), units.lengths(spec.end)
            return profile_traction(facets, (x, y, z), spec.profile, start, end, amplitude)
        except InputError as error:
            raise InputError(f"{what}: {error}") from error


def _require_usable(values: NDArray[np.float64], what: str, unit: str) -> None:
    """Raise InputError for what cannot be squared and summed, products and units counted."""
    size = float(np.abs(values).max())
    if not size < _LARGEST:
        raise InputError(f"{what}: {size:g} {unit} is too large to compute with; lower it")


def _unit(values: tuple[float, float, float]) -> tuple[float, float, float]:
    """The direction of a vector; exact along an axis, and no square is lost or without end."""
    largest = max(abs(v) for v in values)
    parts = [v / largest for v in values]
    size = math.hypot(*parts)
    x, y, z = (part / size for part in parts)
    return x, y, z


def _amplitude(spec: AmplitudeSpec | None) -> TabularAmplitude | None:
    return None if spec is None else TabularAmplitude(spec.times, spec.factors, spec.smooth)


def _shape(spec: ToolSpec, units: Units, folder: Path) -> ToolShape:
    if spec.surface is not None:
        path = inside_folder(folder, spec.surface)
        return SurfaceShape(load_surface(path, scale=units.metres(1.0)).surface)
    sizes = units.sizes(getattr(spec, key) for key in TOOL_SIZES[spec.shape])
    return _SHAPES[spec.shape](*sizes)


def _quaternion(pose: PoseSpec) -> list[float]:
    """Unit quaternion (w, x, y, z) of a turn about an axis."""
    if pose.rotation is None:
        return [1.0, 0.0, 0.0, 0.0]
    half = 0.5 * math.radians(pose.rotation.angle_deg)
    # In fractions of its largest, so that no square underflows or overflows.
    largest = max(abs(a) for a in pose.rotation.axis)
    axis = [a / largest for a in pose.rotation.axis]
    return [math.cos(half), *(math.sin(half) * a / math.hypot(*axis) for a in axis)]
