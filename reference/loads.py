"""Loads as virtual work in UFL; the full load, which the solver scales by the load factor.

Every load of one kind compiles to the same form, whatever its value or place, so nothing is
compiled twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.kinematics import cofactor, deformation_gradient
from palpate.reference.mesh_transfer import TransferredSpace


@dataclass(frozen=True, eq=False)
class Loads:
    """The loads of a problem on a space.

    Attributes:
        dead: Nodal forces that do not depend on the displacement [N], flat over the space.
        followers: Virtual work [J] of each load that does, as UFL forms of u and v.
    """

    dead: Floats
    followers: tuple[Any, ...]


def apply_loads(
    space: TransferredSpace, loads: Sequence[Load], u: Any, v: Any, strain: Strain
) -> Loads:
    """Turn loads into nodal forces and forms.

    Under linear strain a pressure acts on the rest surface, as in the linear theory, and is dead.

    Args:
        space: Displacement space.
        loads: What pushes.
        u: Displacement function of the space.
        v: Its test function.
        strain: Strain measure of the model.

    Raises:
        InputError: A value that is not finite.
    """
    dead = np.zeros(3 * space.num_blocks)
    followers = []
    for number, load in enumerate(loads, start=1):
        what = f"load {number} ({type(load).__name__})"
        match load:
            case Traction():
                dead += fenicsx.assemble_vector(fenicsx.form(traction_work(space, load, v, what)))
            case BodyForce():
                dead += fenicsx.assemble_vector(fenicsx.form(body_force_work(space, load, v, what)))
            case PointForce():
                dead += _point_forces(space, load, what)
            case Pressure():
                if strain is Strain.LINEAR:
                    dead += fenicsx.assemble_vector(
                        fenicsx.form(pressure_work(space, load, None, v, what))
                    )
                else:
                    followers.append(pressure_work(space, load, u, v, what))
    return Loads(dead, tuple(followers))


def traction_work(space: TransferredSpace, load: Traction, v: Any, what: str) -> Any:
    """Integral of t . v over the rest area, exact for t = t0 + G X + X . C X / 2."""
    mesh = space.transferred.mesh
    traction = _constant(space, load.traction, f"{what}: traction [Pa]")
    degree = space.degree
    if not load.is_uniform:
        # One form for all that vary, whatever their values.
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
