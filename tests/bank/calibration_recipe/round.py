"""Round bodies whose answer is a function of the radius: thick spheres and tubes blown up by a
pressure inside, and a cylinder that is twisted.

With r(R) the radius that a radius at rest moves to, the energy is the integral of w(r', r, R) R^k,
k = 2 for spheres, 1 for tubes and cylinders (R. W. Ogden, Non-linear Elastic Deformations, 1984,
sections 5.3.2 to 5.3.4), which is stationary where q = R^k dw/dr' has dq/dR = R^k dw/dr:

    sphere    F = diag(r', r/R, r/R),   tube F = diag(r', r/R, 1),   p = -q(A) / (A r(A)/A)^k,
    twisted   F = [[r', 0, 0], [0, r/R, r tau], [0, 0, 1]],          q(B) = 0.

A collocation method solves it to 1e-10; derivatives of w are by complex steps, so that a law is
its energy alone. A follower pressure may have a largest value; the load is below it.

The truth solves polyhedra. These are cut from the round body by planes through its axis or middle,
which are exactly flat, and what the facets of the curved sides leave out is the geometry part of
the bar. A twisted cylinder's ends hold all of a section: only as far as it keeps its radius, which
it does where the volume hardly changes, is the answer that of the whole; what r(R) - R is says how
well it is known.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

from calibration_recipe.answers import Answer
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Pressure, Rotation, Support
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.field_norms import SMALLEST_CHANGE
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.difference import make_state

_INNER, _HEIGHT = 1.0, 0.4
_TOLERANCE = 1e-10
_STEP = 1e-30
# Ogden's own rubber (1972): exponents, and parts of the shear modulus.
_EXPONENTS = (1.3, 5.0, -2.0)
_CONSTANTS = (0.63, 0.0012, -0.01)
# Of Mooney and Rivlin's shear modulus, in c01.
_SECOND = 0.3
# Stretch at the inner radius up to which the largest pressure is looked for, and how many.
_WIDEST, _STEPS = 2.5, 30


def material_of(law: str, nu: float) -> Material:
    """A material of Young's modulus 1 Pa by the name of its law."""
    plain = Material(1.0, nu, 1.0)
    mu = 0.5 / (1.0 + nu)
    if Law(law).has_c01:
        return replace(plain, law=Law(law), c01=0.5 * _SECOND * mu)
    if law == Law.OGDEN:
        whole = sum(c * a for c, a in zip(_CONSTANTS, _EXPONENTS, strict=True))
        parts = [(c * a / whole, a) for c, a in zip(_CONSTANTS, _EXPONENTS, strict=True)]
        return replace(plain, law=Law.OGDEN, ogden_terms=tuple(parts))
    return replace(plain, law=Law(law))


def energy_of(material: Material, first: Any, second: Any, J: Any, stretches: Any = None) -> Any:
    """W of the two invariants of C and J [Pa]; Ogden's of the three stretches."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    mu = 0.5 * E / (1.0 + nu)
    lmbda = 2.0 * mu * nu / (1.0 - 2.0 * nu)
    kappa = lmbda + 2.0 * mu / 3.0
    log, shape = np.log(J), J ** (-2.0 / 3.0) * first - 3.0
    match material.law:
        case Law.SAINT_VENANT_KIRCHHOFF:
            trace = 0.5 * (first - 3.0)
            squared = 0.25 * (first**2 - 2.0 * second - 2.0 * first + 3.0)
            return 0.5 * lmbda * trace**2 + mu * squared
        case Law.NEO_HOOKEAN:
            return 0.5 * mu * (first - 3.0) - mu * log + 0.5 * lmbda * log**2
        case Law.NEO_HOOKEAN_STABLE:
            bulk = lmbda + mu
            return 0.5 * mu * (first - 3.0) + 0.5 * bulk * (J - 1.0 - mu / bulk) ** 2
        case Law.NEO_HOOKEAN_ISOCHORIC:
            return 0.5 * mu * shape + 0.5 * kappa * (J - 1.0) ** 2
        case Law.MOONEY_RIVLIN | Law.MOONEY_RIVLIN_LOG:
            c01 = material.c01
            change = log if material.law is Law.MOONEY_RIVLIN_LOG else J - 1.0
            other = c01 * (J ** (-4.0 / 3.0) * second - 3.0)
            return (0.5 * mu - c01) * shape + other + 0.5 * kappa * change**2
        case Law.OGDEN:
            # mu_p / alpha_p, the part of the shear modulus being mu_p alpha_p / 2.
            found = 0.5 * kappa * (J - 1.0) ** 2
            for share, alpha in material.ogden_terms:
                powers = sum((s * J ** (-1.0 / 3.0)) ** alpha for s in stretches)
                found = found + 2.0 * mu * share / alpha**2 * (powers - 3.0)
            return found
    raise ValueError(f"{material.law} is not written here")


@dataclass(frozen=True)
class Radial:
    """The ordinary differential equation of a round body.

    Attributes:
        material: Of all of it.
        k: 2 of a sphere, 1 of a tube or a cylinder.
        twist: Turn by length [rad/m], of a cylinder.
    """

    material: Material
    k: int
    twist: float = 0.0

    def density(self, slope: Any, r: Any, R: Any) -> Any:
        """Energy density w(r', r, R) [Pa]."""
        a, b = slope, r / R
        if self.k == 2:
            first, second, J = a**2 + 2.0 * b**2, 2.0 * (a * b) ** 2 + b**4, a * b**2
            return energy_of(self.material, first, second, J, (a, b, b))
        plane = b**2 + (r * self.twist) ** 2 + 1.0
        first, second, J = a**2 + plane, a**2 * plane + b**2, a * b
        return energy_of(self.material, first, second, J, (a, b, 1.0 + 0.0 * b))

    def along(self, slope: Floats, r: Floats, R: Floats) -> Floats:
        """dw/dr' [Pa]."""
        found: Floats = self.density(slope + 1j * _STEP, r, R).imag / _STEP
        return found

    def slope(self, q: Floats, r: Floats, R: Floats) -> Floats:
        """r' of q by Newton's method, from the constant volume."""
        wanted, a = q / R**self.k, (R / r) ** self.k
        for _ in range(60):
            left = wanted - self.along(a, r, R)
            h = 1e-6 * a
            stiff = (self.along(a + h, r, R) - self.along(a - h, r, R)) / (2.0 * h)
            step = np.clip(left / stiff, -0.2 * a, 0.2 * a)
            a = a + step
            if np.abs(step).max() < 1e-14:
                break
        return a

    def solve(
        self,
        inner: float,
        outer: float,
        conditions: Callable[[Floats, Floats], Floats],
        guess: Callable[[Floats], Floats],
        tolerance: float = _TOLERANCE,
    ) -> Callable[[Floats], Floats]:
        """(r, q) by R, (2, n) for (n,).

        Raises:
            ValueError: It was not found to the tolerance.
        """  # fmt: skip
        R = np.linspace(inner, outer, 41)

        def rates(R: Floats, y: Floats) -> Floats:
            r, q = y
            a = self.slope(q, r, R)
            push = self.density(a, r + 1j * _STEP, R).imag / _STEP
            return np.array([a, R**self.k * push])

        found = solve_bvp(rates, conditions, R, guess(R), tol=tolerance, max_nodes=20_000)
        if found.status != 0:
            raise ValueError(found.message)
        of: Callable[[Floats], Floats] = found.sol
        return of

    def inflated(
        self, stretch: float, outer: float, tolerance: float = _TOLERANCE
    ) -> tuple[Callable[[Floats], Floats], float]:
        """r(R), with q, of a given stretch at the inner radius; and the pressure inside [Pa]."""
        n, A = self.k + 1, _INNER

        def guess(R: Floats) -> Floats:
            r = (R**n + (stretch**n - 1.0) * A**n) ** (1.0 / n)
            return np.array([r, 0.1 * (R - outer)])

        def ends(a: Floats, b: Floats) -> Floats:
            return np.array([a[0] - stretch * A, b[1]])

        of = self.solve(A, outer, ends, guess, tolerance)
        return of, float(-of(np.array([A]))[1, 0] / (stretch * A) ** self.k)

    def widest(self, outer: float) -> float:
        """Stretch at the inner radius under the largest pressure, or _WIDEST if it still rises."""
        stretches, before = np.linspace(1.0, _WIDEST, _STEPS + 1), 0.0
        for here, s in itertools.pairwise(stretches):
            pressure = self.inflated(float(s), outer, 1e-4)[1]
            if pressure < before:
                return float(here)
            before = pressure
        return _WIDEST


def inflation_problem(
    *, body: str, law: str, nu: float, outer: float, part: float, bricks: int
) -> tuple[Problem, Strain, Answer]:
    """A thick sphere or tube under a pressure inside, below the largest that it bears.

    Args:
        body: "sphere" (a 24th) or "tube" (an eighth, between smooth walls).
        law: Of a `Material`.
        nu: Poisson's ratio.
        outer: Radius over the inner one.
        part: Of the way of the inner radius to the largest pressure.
        bricks: Along an arc of 45 degrees, and through the wall.
    """
    material = material_of(law, nu)
    equation = Radial(material, 2 if body == "sphere" else 1)
    of, pressure = equation.inflated(1.0 + part * (equation.widest(outer) - 1.0), outer)
    is_sphere = body == "sphere"
    mesh, supports, inside = (wedge_of_sphere if is_sphere else wedge_of_tube)(outer, bricks)
    problem = Problem(mesh, material, supports, (Pressure(inside, pressure),))
    ends = np.array([_INNER, outer])
    moved = of(ends)[0]
    if is_sphere:
        # A 24th of the whole; faces in four planes through the middle, two and two alike.
        volume = np.diff(moved**3 - ends**3)[0] * 4.0 * math.pi / 72.0
        angles = 2.0 * (math.pi / 4.0 + math.atan(math.sqrt(0.5)))
        flat = 0.5 * angles * np.diff(moved**2 - ends**2)[0]
        area = (moved**2 - ends**2).sum() * 4.0 * math.pi / 24.0 + flat
    else:
        flat = math.pi / 8.0 * np.diff(moved**2 - ends**2)[0]
        volume = _HEIGHT * flat
        sides = 2.0 * _HEIGHT * np.diff(moved - ends)[0]
        area = 2.0 * flat + sides + _HEIGHT * math.pi / 4.0 * (moved - ends).sum()
    points = mesh.points
    lengths = np.linalg.norm(points[:, : 3 if is_sphere else 2], axis=1)
    u = points * (of(np.clip(lengths, _INNER, outer))[0] / lengths - 1.0)[:, None]
    if not is_sphere:
        u[:, 2] = 0.0
    state = make_state(mesh, u, label="radial", simulator="known", strain=Strain.GREEN)
    state = replace(
        state, volume=mesh.volume + float(volume), surface_area=mesh.surface_area + float(area)
    )
    on = "spheres" if is_sphere else "cylinders"
    return problem, Strain.GREEN, Answer(state, {"": 1e-8}, surface=on, radii=(_INNER, outer))


def wedge_of_sphere(outer: float, bricks: int) -> tuple[TetMesh, tuple[Support, ...], Indices]:
    """A 24th of a thick sphere between planes through the middle, their supports, and its inside.

    Inner radius 1 m; so many bricks along an arc of 45 degrees, and through the wall.
    """
    box = brick_box((bricks, bricks, bricks), (1.0, 1.0, 1.0))
    x, y, z = box.points.T
    a, b = np.tan(0.25 * np.pi * x), np.tan(0.25 * np.pi * y)
    along = np.column_stack([a, b, np.ones_like(a)])
    radius = _INNER + (outer - _INNER) * z
    points = radius[:, None] * along / np.linalg.norm(along, axis=1, keepdims=True)
    planes = (
        _wall(side(box, 0, 0.0), (1.0, 0.0, 0.0)),
        _wall(side(box, 0, 1.0), (1.0, 0.0, -1.0)),
        _wall(side(box, 1, 0.0), (0.0, 1.0, 0.0)),
        _wall(side(box, 1, 1.0), (0.0, 1.0, -1.0)),
    )
    return TetMesh(points, box.cells), planes, side(box, 2, 0.0)


def wedge_of_tube(outer: float, bricks: int) -> tuple[TetMesh, tuple[Support, ...], Indices]:
    """An eighth of a tube between smooth walls, as `wedge_of_sphere`; one brick along the axis."""
    box = brick_box((bricks, 1, bricks), (1.0, 1.0, 1.0))
    x, y, z = box.points.T
    radius, angle = _INNER + (outer - _INNER) * z, 0.25 * np.pi * x
    points = np.column_stack([radius * np.sin(angle), radius * np.cos(angle), -_HEIGHT * y])
    planes = (
        _wall(side(box, 0, 0.0), (1.0, 0.0, 0.0)),
        _wall(side(box, 0, 1.0), (1.0, -1.0, 0.0)),
        _wall(side(box, 1, 0.0), (0.0, 0.0, 1.0)),
        _wall(side(box, 1, 1.0), (0.0, 0.0, 1.0)),
    )
    return TetMesh(points, box.cells), planes, side(box, 2, 0.0)


def _wall(facets: Indices, normal: tuple[float, float, float]) -> Support:
    return Support(np.unique(facets).astype(np.int32), facets, normal=normal)


def torsion_problem(
    *, law: str, nu: float, angle: float, bricks: int
) -> tuple[Problem, Strain, Answer]:
    """A cylinder of radius 1 m and height 1.5 m whose ends are held, one of them turned.

    Args:
        law: Of a `Material`.
        nu: Poisson's ratio, near 0.5.
        angle: Of the one end [rad].
        bricks: Across; three for each two of them along.
    """
    height = 1.5
    box = brick_box((bricks, bricks, 3 * bricks // 2), (2.0, 2.0, height))
    mesh = TetMesh(_rounded(box.points), box.cells)
    material = material_of(law, nu)
    far = side(box, 2, height)
    turn = Rotation((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), angle)
    supports = (
        support_of(side(box, 2, 0.0)),
        Support(np.unique(far).astype(np.int32), far, rotation=turn),
    )
    problem = Problem(mesh, material, supports, ())
    equation, least = Radial(material, 1, angle / height), 1e-3

    def ends(a: Floats, b: Floats) -> Floats:
        # Near the axis r is R times a number.
        slope = equation.slope(a[1:], a[:1], np.array([least]))[0]
        return np.array([slope - a[0] / least, b[1]])

    of = equation.solve(least, 1.0, ends, lambda R: np.array([R, 0.0 * R]))
    R = np.linspace(least, 1.0, 200)
    apart = float(np.abs(of(R)[0] - R).max())
    x, y, z = mesh.points.T
    c, s = np.cos(angle * z / height), np.sin(angle * z / height)
    u = np.column_stack([c * x - s * y - x, s * x + c * y - y, 0.0 * z])
    largest = 2.0 * math.sin(0.5 * angle)
    state = make_state(mesh, u, label="twisted", simulator="known", strain=Strain.GREEN)
    state = replace(state, volume=mesh.volume, surface_area=mesh.surface_area)
    displacements = ("displacement_l2", "displacement_max", "max_displacement")
    doubts = dict.fromkeys(displacements, apart / largest)
    # Volume and area hardly change: by what r(R) - R makes of them, over a thousandth of the whole.
    doubts |= {
        "volume": 2.0 * apart / SMALLEST_CHANGE,
        "surface_area": 2.0 * apart / SMALLEST_CHANGE,
    }
    answer = Answer(state, doubts, surface="cylinders", radii=(1.0,))
    return problem, Strain.GREEN, answer


def _rounded(points: Points) -> Points:
    """A square of half width 1 m about (1, 1) as a disc about the axis, further out more so."""
    xy = points[:, :2] - 1.0
    most, length = np.abs(xy).max(axis=1), np.linalg.norm(xy, axis=1)
    ratio = np.divide(most, length, out=np.ones_like(most), where=length > 0.0)
    part = most**2
    return np.column_stack([xy * (part * ratio + (1.0 - part) * 0.8)[:, None], points[:, 2]])
