"""A block stretched, crushed, sheared and twisted: linear strain beside Green strain.

Three modes are homogeneous, with closed forms (P is the nominal stress, l the stretch along the
load). Free uniaxial: P / E = l (l^2 - 1) / 2, lateral stretch sqrt(1 - nu (l^2 - 1)); confined:
P / (lmbda + 2 mu) = l (l^2 - 1) / 2; linear strain: l = 1 + P / stiffness in both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import Load, Traction
from palpate.meshes.bricks import brick_box, held, rollers, side
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.studies.bodies import Solve
from palpate.validation.studies.closed_forms import confined_modulus, stretch_under
from palpate.validation.studies.validity.rising import (
    LoadedPoint,
    Measure,
    compliance_of,
    lose_equilibrium,
    raise_load,
)


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
