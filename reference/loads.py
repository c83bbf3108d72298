"""Loads and springs as virtual work in UFL; the full load, which the solver scales.

Every load of one kind compiles to the same form, whatever its value or region, so nothing is
compiled twice. A load whose direction follows the body has one form for statics, for the mixed
form and for motion. The virtual work of a spring over a patch of the surface is

    W(u; v) = integral of kappa (d - u) . v over the patch    (see `palpate.meshes.spring`),

with kappa linear on each facet between its values at the vertices, whatever the degree of u, so
that the integral is exact. It is a Robin condition, and its tangent is symmetric.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.meshes.spring import Spring
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.laws import cofactor, deformation_gradient
from palpate.reference.mesh_transfer import TransferredSpace, create_space


class Loaded(Protocol):
    """A body: its space, displacement, test function and strain measure.

    `unknown` is the function of all unknowns: `u`, and the pressures of the mixed form.
    """

    space: TransferredSpace
    u: Any
    v: Any
    strain: Strain

    @property
    def unknown(self) -> Any: ...  # noqa: D102  (above)


class FollowerLoad:
    """The forces of a load that depends on the displacement, and their derivative.

    Of the virtual work of the full load on a body, as a UFL form [J].
    """

    def __init__(self, body: Loaded, work: Any) -> None:
        self._force = fenicsx.form(work)
        # R contains the load with a minus sign and a factor; so does the tangent.
        self._factor = fem.Constant(body.space.transferred.mesh, PETSc.ScalarType(0.0))
        trial = ufl.TrialFunction(body.unknown.function_space)
        change = ufl.derivative(work, body.unknown, trial)
        self._tangent = fenicsx.form(-self._factor * change)

    def force(self) -> Floats:
        """Nodal forces of the full load [N], flat."""
        return fenicsx.assemble_vector(self._force)

    def add_tangent(self, matrix: Any, factor: float) -> None:
        """Add minus the derivative of the forces, times a factor."""
        self._factor.value = factor
        fenicsx.assemble_into_matrix(matrix, self._tangent)


def apply_loads(body: Loaded, loads: Sequence[Load]) -> tuple[Floats, list[FollowerLoad]]:
    """Nodal forces of loads that do not depend on the displacement [N], flat, and those that do.

    Under linear strain a pressure acts on the rest surface, as in the linear theory: a dead load.

    Raises:
        InputError: A value is not finite.
    """
    space = body.space
    dead = np.zeros(3 * space.num_blocks)
    followers = []
    test = ufl.TestFunction(space.space)
    for number, load in enumerate(loads, start=1):
        what = f"load {number} ({type(load).__name__})"
        match load:
            case Traction():
                work = traction_work(space, load, test, what)
                dead += fenicsx.assemble_vector(fenicsx.form(work))
            case BodyForce():
                work = body_force_work(space, load, test, what)
                dead += fenicsx.assemble_vector(fenicsx.form(work))
            case PointForce():
                dead += _point_forces(space, load, what)
            case Pressure():
                if body.strain is Strain.LINEAR:
                    work = pressure_work(space, load, None, test, what)
                    dead += fenicsx.assemble_vector(fenicsx.form(work))
                else:
                    work = pressure_work(space, load, body.u, body.v, what)
                    followers.append(FollowerLoad(body, work))
    return dead, followers


def traction_work(space: TransferredSpace, load: Traction, v: Any, what: str) -> Any:
    """Integral of t . v over the rest area, exact for t = t0 + G X + X . C X / 2."""
    mesh = space.transferred.mesh
    traction = _constant(space, load.traction, f"{what}: traction [Pa]")
    degree = space.degree
    if not load.is_uniform:
        # All tractions that vary in space share one form, whatever their values.
        G = np.zeros((3, 3)) if load.gradient is None else load.gradient
        C = np.zeros((3, 3, 3)) if load.curvature is None else load.curvature
        X = ufl.SpatialCoordinate(mesh)
        slope, bend = (fem.Constant(mesh, values.astype(PETSc.ScalarType)) for values in (G, C))
        i, j, k = ufl.indices(3)
        bent = ufl.as_vector(bend[i, j, k] * X[j] * X[k], i)
        traction = traction + slope * X + bent / 2
        degree += 2
    area = space.transferred.facet_measure(load.facets, what, degree=degree)
    return ufl.inner(traction, v) * area


def body_force_work(space: TransferredSpace, load: BodyForce, v: Any, what: str) -> Any:
    """Integral of b . v over the rest volume."""
    force = _constant(space, load.force_density, f"{what}: force_density [N/m3]")
    volume = ufl.dx(domain=space.transferred.mesh, metadata={"quadrature_degree": space.degree})
    return ufl.inner(force, v) * volume


def pressure_work(space: TransferredSpace, load: Pressure, u: Any, v: Any, what: str) -> Any:
    """Integral of -p n . v over the deformed area; over the rest area where u is None.

    n da = cof(F) N dA (Nanson).
    """
    mesh = space.transferred.mesh
    pressure = _constant(space, (load.pressure,), f"{what}: pressure [Pa]")[0]
    normal = ufl.FacetNormal(mesh)
    # cof F is of degree 2 (p - 1), v of degree p.
    degree = space.degree if u is None else 3 * space.degree - 2
    area = space.transferred.facet_measure(load.facets, what, degree=degree)
    area_vector = normal if u is None else cofactor(deformation_gradient(u)) * normal
    return -pressure * ufl.inner(area_vector, v) * area


def _point_forces(space: TransferredSpace, load: PointForce, what: str) -> Floats:
    points = load.points
    forces = np.asarray(load.forces, dtype=np.float64)
    if forces.shape != (len(points), 3) or not np.isfinite(forces).all():
        raise InputError(f"{what}: forces [N] need shape ({len(points)}, 3) of finite values")
    nodal = np.zeros((space.num_blocks, 3))
    here = np.isin(space.dof_of_point[points], space.owned_dofs(points))
    np.add.at(nodal, space.dof_of_point[points[here]], forces[here])
    return nodal.ravel()


def _constant(space: TransferredSpace, values: Sequence[float], what: str) -> Any:
    if not all(math.isfinite(value) for value in values):
        raise InputError(f"{what} = {tuple(values)}: needs finite values")
    return fem.Constant(space.transferred.mesh, np.array(values, dtype=PETSc.ScalarType))


class SpringForce(FollowerLoad):
    """The forces of a spring on a body, and their derivative.

    The anchor is at the end of the spring's path until `move_to` is called.
    """

    def __init__(self, body: Loaded, spring: Spring, what: str) -> None:
        space = body.space
        mesh = space.transferred.mesh
        self._path = spring.path.components()
        self._amplitude: TabularAmplitude | None = spring.amplitude
        self._anchor = fem.Constant(mesh, spring.path.end.astype(PETSc.ScalarType))
        kappa = _density(space, spring)
        area = space.transferred.facet_measure(spring.facets, what, degree=1 + 2 * space.degree)
        super().__init__(body, kappa * ufl.inner(self._anchor - body.u, body.v) * area)

    @property
    def is_steady(self) -> bool:
        """Whether its stiffness is constant in time."""
        return self._amplitude is None

    def factor(self, time: float) -> float:
        """Factor on its stiffness at a time [s] [-]."""
        return 1.0 if self._amplitude is None else self._amplitude(time)

    def move_to(self, time: float) -> None:
        """Move the anchor to its position at a time [s]."""
        self._anchor.value[:] = [component(time) for component in self._path]


def _density(space: TransferredSpace, spring: Spring) -> Any:
    """Stiffness per rest area [N/m3] as a function that is linear in each cell."""
    source = space.transferred.source
    nodal: Floats = np.zeros((source.num_points, 3))
    nodal[spring.facets.ravel(), 0] = spring.densities(source.points).ravel()
    linear = create_space(space.transferred, 1)
    found = fem.Function(linear.space)
    found.x.array[: 3 * linear.num_blocks] = linear.from_points(nodal)
    found.x.scatter_forward()
    return found[0]


def spring_forces(body: Loaded, springs: Sequence[Spring]) -> list[SpringForce]:
    """The forces of each of a problem's springs on a body."""
    return [
        SpringForce(body, spring, f"spring {number} (Spring)")
        for number, spring in enumerate(springs, start=1)
    ]
