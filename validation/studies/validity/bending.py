"""Bars bent by a load at their tip: linear strain beside Green strain, over a map.

The load is measured by what linear strain itself predicts, the deflection of the tip over the
length, delta = w_linear / L: equal to P L^2 / (3 E I) for a slender bar, known to whoever has a
linear solver, and hardly touched by the stiffness that linear tetrahedra add in bending.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.fastsim.errors import EquilibriumLostError
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, held, side
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.pairs import l2_norm
from palpate.validation.states import Progress
from palpate.validation.studies.bodies import volume_change

# Errors of linear strain that the map is about.
LIMITS = (0.01, 0.05, 0.10)
# Where the map is computed: L / h, Poisson's ratio, delta = w_linear / L.
SLENDERNESSES = (1.0, 2.0, 4.0, 8.0, 16.0)
POISSONS_RATIOS = (0.0, 0.15, 0.3, 0.4, 0.45)
DEFLECTIONS = (*(0.01 * 2.0 ** (k / 2.0) for k in range(13)), 1.28, 2.56)
# Bricks over the height; as long as high, a third as many over the width.
CELLS_ACROSS = 6


@dataclass(frozen=True)
class BendingPoint:
    """Linear beside Green strain under one load.

    `deflection` is w_linear / L, `load` is P L^2 / (E I); `displacement_error` is the L2 norm of
    the difference over that of Green strain, changes of volume are over the rest volume, and
    `tip_rotation` is of the end section by Green strain [rad].
    """

    slenderness: float
    poissons_ratio: float
    deflection: float
    load: float
    displacement_error: float
    linear_volume_change: float
    green_volume_change: float
    tip_rotation: float

    @property
    def volume_error(self) -> float:
        """Difference of volume over the rest volume: in bending the change itself is near 0."""
        return abs(self.linear_volume_change - self.green_volume_change)

    @property
    def bending_strain(self) -> float:
        """Strain at the surface at the clamp by beam theory, M h / (2 E I) [-]."""
        return self.load / (2.0 * self.slenderness)


class BendingLimit(NamedTuple):
    """Where Saint-Venant-Kirchhoff loses its equilibrium; None where not up to the load tried.

    `load` is P L^2 / (E I) at the last equilibrium, `deflection` w_linear / L and
    `smallest_stretch` the smallest principal stretch there [-].
    """

    slenderness: float
    poissons_ratio: float
    cells_across: int
    load: float | None
    deflection: float | None
    smallest_stretch: float | None


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


def follow_bar(
    slenderness: float, poissons_ratio: float, cells_across: int, deflections: Sequence[float]
) -> list[BendingPoint]:
    """One bar under rising loads, as far as Green strain bears them."""
    unit = bent_bar(slenderness, poissons_ratio, 1.0, cells_across)
    linear = solve_static(unit, strain=Strain.LINEAR).displacement
    compliance = tip_deflection(unit.mesh, linear)
    green: Points | None = None
    points = []
    for deflection in deflections:
        load = deflection / compliance
        loaded = bent_bar(slenderness, poissons_ratio, load, cells_across)
        try:
            green = solve_static(loaded, start=green).displacement
        except EquilibriumLostError:
            break
        mesh = loaded.mesh
        points.append(
            BendingPoint(
                slenderness,
                poissons_ratio,
                # Rounded: the same loads have the same name in every bar.
                round(tip_deflection(mesh, load * linear), 9),
                load,
                l2_norm(mesh, load * linear - green) / l2_norm(mesh, green),
                volume_change(mesh, load * linear),
                volume_change(mesh, green),
                _end_rotation(mesh, green),
            )
        )
    return points


def find_limit(slenderness: float, poissons_ratio: float, cells_across: int) -> BendingLimit:
    """Raise the load until fastsim says that equilibrium is lost."""
    unit = bent_bar(slenderness, poissons_ratio, 1.0, cells_across)
    linear = solve_static(unit, strain=Strain.LINEAR).displacement
    # The limit grows with a power of L between 1 and 2; this is about twice of it (measured).
    most = 1.5 * slenderness + 0.5 * slenderness**2
    load, stretch = None, None
    try:
        solve_static(bent_bar(slenderness, poissons_ratio, most, cells_across))
    except EquilibriumLostError as error:
        load, stretch = most * error.load_factor, error.smallest_stretch
    deflection = None if load is None else load * tip_deflection(unit.mesh, linear)
    return BendingLimit(slenderness, poissons_ratio, cells_across, load, deflection, stretch)


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
    """Solve a point of the map again with quadratic tetrahedra; needs FEniCSx.

    Args:
        point: Of the map.
        cells_across: Of the quadratic mesh.
        progress: Called with one line now and then.
    """
    from palpate.reference.child import solve_static_in_child

    L, nu = point.slenderness, point.poissons_ratio
    unit = bent_bar(L, nu, 1.0, cells_across)
    compliance = tip_deflection(
        unit.mesh, solve_static_in_child(unit, strain=Strain.LINEAR, degree=2).displacement
    )
    load = point.deflection / compliance
    loaded = bent_bar(L, nu, load, cells_across)
    progress(f"P2 check: L/h = {L:g}, nu = {nu:g}, deflection {point.deflection:g}")
    linear, green = (
        solve_static_in_child(loaded, strain=s, degree=2) for s in (Strain.LINEAR, Strain.GREEN)
    )
    difference = l2_norm(loaded.mesh, linear.displacement - green.displacement)
    return DegreeCheck(
        point,
        difference / l2_norm(loaded.mesh, green.displacement),
        abs(linear.volume - green.volume) / loaded.mesh.volume,
        point.load / load,
    )


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
