"""Linear beside Green strain under rising loads, and the bars that are bent so.

Loads are measured by what linear strain itself predicts, known to whoever has a linear solver: for
a bar the deflection of its tip over its length, delta = w_linear / L, equal to P L^2 / (3 E I) for
a slender one and hardly touched by the stiffness that linear tetrahedra add in bending.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from palpate.fastsim.errors import EquilibriumLostError
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import Load, Traction
from palpate.meshes.bricks import brick_box, held, rollers, side
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import Progress
from palpate.validation.studies.closed_forms import (
    Solve,
    confined_modulus,
    stretch_under,
    volume_change,
)

# Errors of linear strain that the map is about.
LIMITS = (0.01, 0.05, 0.10)
# Where the map is computed: L / h, Poisson's ratio, delta = w_linear / L.
SLENDERNESSES = (1.0, 2.0, 4.0, 8.0, 16.0)
POISSONS_RATIOS = (0.0, 0.15, 0.3, 0.4, 0.45)
DEFLECTIONS = (*(0.01 * 2.0 ** (k / 2.0) for k in range(13)), 1.28, 2.56)
# Bricks over the height; as long as high, a third as many over the width.
CELLS_ACROSS = 6

# A problem under a load, and what linear strain predicts of it.
Make = Callable[[float], Problem]
Measure = Callable[[TetMesh, Points], float]


@dataclass(frozen=True)
class LoadedPoint:
    """Linear beside Green strain under one load.

    `nominal` is what linear strain predicts; `displacement_error` the L2 norm of the difference
    over that of Green strain; changes of volume are over the rest volume [-].
    """

    nominal: float
    load: float
    displacement_error: float
    linear_volume_change: float
    green_volume_change: float

    @property
    def volume_error(self) -> float:
        """Difference of volume over the rest volume: in bending the change itself is near 0."""
        return abs(self.linear_volume_change - self.green_volume_change)


def raise_load(
    make: Make, measure: Measure, nominals: Iterable[float], solve: Solve = solve_static
) -> Iterator[tuple[tuple[float, float, float, float, float], TetMesh, Points]]:
    """The numbers of each `LoadedPoint`, mesh and Green displacement, as far as that is borne."""
    unit = make(1.0)
    linear = solve(unit, strain=Strain.LINEAR).displacement
    compliance = measure(unit.mesh, linear)
    green: Points | None = None
    for nominal in nominals:
        load = nominal / compliance
        loaded = make(load)
        try:
            green = solve(loaded, start=green).displacement
        except EquilibriumLostError:
            return
        mesh, bent = loaded.mesh, load * linear
        error = l2_norm(mesh, bent - green) / l2_norm(mesh, green)
        numbers = (nominal, load, error, volume_change(mesh, bent), volume_change(mesh, green))
        yield numbers, mesh, green


def lose_equilibrium(make: Make, most: float) -> tuple[float, float] | None:
    """Load and smallest stretch at the last equilibrium; None where it is not lost up to `most`."""
    try:
        solve_static(make(most))
    except EquilibriumLostError as error:
        return most * error.load_factor, error.smallest_stretch
    return None


def compliance_of(make: Make, measure: Measure) -> float:
    """What linear strain predicts for a load of 1."""
    unit = make(1.0)
    return measure(unit.mesh, solve_static(unit, strain=Strain.LINEAR).displacement)


def border(errors: Sequence[float], measures: Sequence[float], limit: float) -> float | None:
    """Where an error reaches a limit, between two points; None where it does not.

    The logarithms are interpolated: small errors are powers of the load.

    Args:
        errors: Under rising loads [-].
        measures: What is asked for at the same points: load, deflection, rotation.
        limit: [-], > 0.
    """
    for k in range(1, len(errors)):
        if 0.0 < errors[k - 1] <= limit < errors[k]:
            part = math.log(limit / errors[k - 1]) / math.log(errors[k] / errors[k - 1])
            a, b = measures[k - 1 : k + 1]
            return float(a * (b / a) ** part)
    return None


@dataclass(frozen=True)
class BendingPoint(LoadedPoint):
    """Of a bar: `nominal` is w_linear / L, the load P L^2 / (E I), both [-]."""

    slenderness: float
    poissons_ratio: float
    tip_rotation: float  # of the end section, by Green strain [rad]

    @property
    def bending_strain(self) -> float:
        """Strain at the surface at the clamp by beam theory, M h / (2 E I) [-]."""
        return self.load / (2.0 * self.slenderness)


class BendingLimit(NamedTuple):
    """Where Saint-Venant-Kirchhoff loses its equilibrium; None where not up to the load tried.

    `load` is P L^2 / (E I) at the last equilibrium, `deflection` is w_linear / L there [-].
    """

    slenderness: float
    poissons_ratio: float
    cells_across: int
    load: float | None
    deflection: float | None


def bent_bar(slenderness: float, poissons_ratio: float, load: float, cells_across: int) -> Problem:
    """A bar of height and width 1 m, E = 1 Pa, clamped at x = 0, its tip pushed down.

    Args:
        slenderness: Length [m].
        poissons_ratio: [-].
        load: P L^2 / (E I) [-].
        cells_across: Bricks over the height.
    """
    L, n = slenderness, cells_across
    mesh = brick_box((max(2, round(n * L)), max(2, n // 3), n), (L, 1.0, 1.0))
    # I = 1/12, and the end has an area of 1.
    load_at_tip = Traction(side(mesh, 0, L), (0.0, 0.0, -load / (12.0 * L * L)))
    clamp = held(side(mesh, 0, 0.0))
    return Problem(mesh, Material(1.0, poissons_ratio), (clamp,), (load_at_tip,))


def tip_deflection(mesh: TetMesh, displacement: Points) -> float:
    """Mean deflection of the end section along -z over the length [-]."""
    L = float(mesh.points[:, 0].max())
    end = mesh.points[:, 0] > L * (1 - 1e-9)
    return -float(displacement[end, 2].mean()) / L


def _end_rotation(mesh: TetMesh, displacement: Points) -> float:
    """Angle of the normal of the end section, downwards [rad]."""
    corners = (mesh.points + displacement)[side(mesh, 0, mesh.points[:, 0].max())]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    return math.atan2(-normal[2], normal[0])


def follow_bar(
    slenderness: float, poissons_ratio: float, cells_across: int, deflections: Iterable[float]
) -> list[BendingPoint]:
    """One bar under rising loads, as far as Green strain bears them."""

    def make(load: float) -> Problem:
        return bent_bar(slenderness, poissons_ratio, load, cells_across)

    return [
        BendingPoint(*numbers, slenderness, poissons_ratio, _end_rotation(mesh, green))
        for numbers, mesh, green in raise_load(make, tip_deflection, deflections)
    ]


def find_limit(slenderness: float, poissons_ratio: float, cells_across: int) -> BendingLimit:
    """Raise the load until fastsim says that equilibrium is lost."""

    def make(load: float) -> Problem:
        return bent_bar(slenderness, poissons_ratio, load, cells_across)

    # The limit grows with a power of L between 1 and 2; this is about twice of it (measured).
    end = lose_equilibrium(make, 1.5 * slenderness + 0.5 * slenderness**2)
    load = None if end is None else end[0]
    deflection = None if load is None else load * compliance_of(make, tip_deflection)
    return BendingLimit(slenderness, poissons_ratio, cells_across, load, deflection)


class DegreeCheck(NamedTuple):
    """One point of the map by fastsim's linear tetrahedra and by the reference's quadratic ones.

    Displacement and volume error are of linear strain, by P2 at the same deflection; `load_ratio`
    is the load for this deflection, P1 over P2: how much too stiff P1 is [-].
    """

    by_linear: BendingPoint
    displacement_error: float
    volume_error: float
    load_ratio: float

    @property
    def displacement_ratio(self) -> float:
        """Displacement error by P2 over that by P1 [-]."""
        return self.displacement_error / self.by_linear.displacement_error

    @property
    def volume_ratio(self) -> float:
        """Volume error by P2 over that by P1 [-]."""
        return self.volume_error / self.by_linear.volume_error


def check_by_quadratic(point: BendingPoint, cells_across: int, progress: Progress) -> DegreeCheck:
    """Solve a point of the map again with quadratic tetrahedra; needs FEniCSx."""
    from palpate.reference.child import run_task
    from palpate.reference.tasks import StaticTask

    L, nu = point.slenderness, point.poissons_ratio
    unit = bent_bar(L, nu, 1.0, cells_across)
    found = run_task(StaticTask(Strain.LINEAR, degree=2), unit)
    load = point.nominal / tip_deflection(unit.mesh, found.displacement)
    loaded = bent_bar(L, nu, load, cells_across)
    progress(f"P2 check: L/h = {L:g}, nu = {nu:g}, deflection {point.nominal:g}")
    linear, green = (run_task(StaticTask(strain, degree=2), loaded) for strain in Strain)
    difference = l2_norm(loaded.mesh, linear.displacement - green.displacement)
    return DegreeCheck(
        point,
        difference / l2_norm(loaded.mesh, green.displacement),
        abs(linear.volume - green.volume) / loaded.mesh.volume,
        point.load / load,
    )


# A block stretched, crushed, sheared and twisted: linear strain beside Green strain.
#
# Three modes are homogeneous, with closed forms (P is the nominal stress, l the stretch along the
# load). Free uniaxial: P / E = l (l^2 - 1) / 2, lateral stretch sqrt(1 - nu (l^2 - 1)); confined:
# P / (lmbda + 2 mu) = l (l^2 - 1) / 2; linear strain: l = 1 + P / stiffness in both.


class Mode(StrEnum):
    """How the block is loaded."""

    STRETCH = "stretch"
    COMPRESSION = "compression"
    CONFINED_COMPRESSION = "confined compression"
    SHEAR = "shear between plates"
    TWIST = "twist"


HOMOGENEOUS = (Mode.STRETCH, Mode.COMPRESSION, Mode.CONFINED_COMPRESSION)
# Up to where each mode is followed, in what linear strain predicts: strain, shear angle or twist;
# and up to where a loss of equilibrium is looked for.
LARGEST = dict(zip(Mode, (0.6, 0.19, 0.19, 1.0, 1.0), strict=True))
MOST = dict(zip(Mode, (2.0, 0.25, 0.25, 2.0, 2.0), strict=True))
_POINTS = 13


@dataclass(frozen=True)
class ModePoint(LoadedPoint):
    """Of the block: the errors in closed form, where there is one, are beside those found."""

    mode: Mode
    poissons_ratio: float
    closed_form: tuple[float, float, float] | None

    @property
    def distance(self) -> float:
        """Largest distance from the closed form, of numbers of order one; 0 without one."""
        found = (self.displacement_error, self.linear_volume_change, self.green_volume_change)
        return max(abs(a - b) for a, b in zip(found, self.closed_form or found, strict=True))


def follow_mode(
    mode: Mode, poissons_ratio: float, *, cells_across: int = 4, solve: Solve = solve_static
) -> list[ModePoint]:
    """One mode under rising loads, as far as Green strain bears them.

    Where the state is homogeneous, two bricks along an edge are enough.
    """
    n = 2 if mode in HOMOGENEOUS else cells_across
    nominals = np.geomspace(0.01 * LARGEST[mode], LARGEST[mode], _POINTS).tolist()

    def make(load: float) -> Problem:
        return block(mode, poissons_ratio, load, n)

    return [
        ModePoint(*numbers, mode, poissons_ratio, closed_form(mode, poissons_ratio, numbers[0]))
        for numbers, _, _ in raise_load(make, _measure(mode), nominals, solve)
    ]


def find_mode_limit(mode: Mode, poissons_ratio: float) -> tuple[float, float] | None:
    """Where equilibrium is lost, on a mesh too coarse to buckle before the material gives way.

    Returns:
        The largest load borne, in what linear strain predicts, and the smallest stretch there;
        None where it is not lost up to MOST.
    """

    def make(load: float) -> Problem:
        return block(mode, poissons_ratio, load, 2)

    compliance = compliance_of(make, _measure(mode))
    end = lose_equilibrium(make, MOST[mode] / compliance)
    return None if end is None else (end[0] * compliance, end[1])


def closed_form(
    mode: Mode, poissons_ratio: float, nominal: float
) -> tuple[float, float, float] | None:
    """Displacement error and the two changes of volume of a homogeneous state; else None.

    Args:
        mode: How the block is loaded.
        poissons_ratio: [-].
        nominal: Nominal stress over E, or over lmbda + 2 mu where confined [-], >= 0.
    """
    if mode not in HOMOGENEOUS:
        return None
    stress = nominal if mode is Mode.STRETCH else -nominal
    lateral = 0.0 if mode is Mode.CONFINED_COMPRESSION else poissons_ratio
    along = stretch_under(stress)
    across = math.sqrt(1.0 - lateral * (along**2 - 1.0))
    # A homogeneous strain about the corner that stays: every axis has the same integral of X^2.
    green = np.array([along, across, across]) - 1.0
    linear = np.array([stress, -lateral * stress, -lateral * stress])
    error = float(np.linalg.norm(linear - green) / np.linalg.norm(green))
    return error, float(np.prod(1.0 + linear)) - 1.0, float(np.prod(1.0 + green)) - 1.0


def block(mode: Mode, poissons_ratio: float, load: float, cells_across: int) -> Problem:
    """A cube of 1 m and E = 1 Pa, or for twist a bar twice as high, loaded at its top.

    Args:
        mode: How it is loaded.
        poissons_ratio: [-].
        load: Nominal strain, shear angle, or for twist the largest tangential traction [-].
        cells_across: Bricks along an edge of the cube.
    """
    n = cells_across
    height = 2.0 if mode is Mode.TWIST else 1.0
    mesh = brick_box((n, n, round(n * height)), (1.0, 1.0, height))
    material = Material(1.0, poissons_ratio)
    top = side(mesh, 2, height)
    clamp = held(side(mesh, 2, 0.0))
    if mode is Mode.SHEAR:
        return Problem(mesh, material, (clamp, held(top, displacement=(load, 0.0, 0.0))), ())
    if mode is Mode.TWIST:
        return Problem(mesh, material, (clamp,), _twisting(mesh, top, load))
    sides = [(axis, 0.0) for axis in range(3)]
    stiffness = 1.0
    if mode is Mode.CONFINED_COMPRESSION:
        sides += [(0, 1.0), (1, 1.0)]
        stiffness = confined_modulus(material)
    stress = stiffness * (load if mode is Mode.STRETCH else -load)
    return Problem(mesh, material, rollers(mesh, sides), (Traction(top, (0.0, 0.0, stress)),))


def _twisting(mesh: TetMesh, top: Indices, load: float) -> tuple[Load, ...]:
    """Dead tractions around the axis of the bar, each facet its own."""
    centres = mesh.points[top].mean(axis=1)
    return tuple(
        Traction(top[k : k + 1], (-load * (y - 0.5), load * (x - 0.5), 0.0))
        for k, (x, y, _) in enumerate(centres)
    )


def _measure(mode: Mode) -> Measure:
    """The nominal strain and the shear angle are their own loads; the twist is measured."""
    return _twist if mode is Mode.TWIST else lambda _mesh, _displacement: 1.0


def _twist(mesh: TetMesh, displacement: Points) -> float:
    """Rotation of the top about the axis by least squares, for small rotations [rad]."""
    top = mesh.points[:, 2] > mesh.points[:, 2].max() - 1e-9
    x, y = (mesh.points[top, :2] - 0.5).T
    u, v = displacement[top, :2].T
    return float(np.sum(x * v - y * u) / np.sum(x * x + y * y))
