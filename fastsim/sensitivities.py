"""How an equilibrium moves with the numbers of its problem: one solve of its tangent for each.

Of R(a, p) = 0, the force out of balance at the displacement a, follows K da/dp = dR/dp with the
tangent K = -dR/da (D. A. Tortorelli, P. Michaleris, Inverse Problems in Engineering 1, 1994,
section 2.2, direct differentiation). dR/dp is a central difference of R at the fixed a, which takes
no solve: exact but for rounding where R is linear or quadratic in p, as in moduli and loads, and
to the square of the step elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.errors import FastsimError
from palpate.fastsim.newton import Newton
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain

# Newton's tolerance here, by which the tangent's solves get their digits.
_TOLERANCE = 1e-16


@dataclass(frozen=True, eq=False)
class Change:
    """A number of a problem moved down and up.

    Attributes:
        behind: The problem with the number lower by half of `width`.
        ahead: The problem with the number higher by half of `width`.
        width: Distance of the two values, in the number's own unit, > 0.
    """

    behind: Problem
    ahead: Problem
    width: float


class SoftTangentError(FastsimError):
    """The tangent of a state is not positive definite: it is no stable equilibrium."""

    def __init__(self) -> None:
        super().__init__(
            "the tangent is not positive definite, so the state is no stable equilibrium and has "
            "no sensitivities; lower the load, or take another start"
        )


def has_exact_tangent(problem: Problem, strain: Strain) -> bool:
    """Whether the tangent of statics is the derivative of the force: no tools, no following load.

    Of a pressure that follows the body only the symmetric part is in the tangent.
    """
    follows = strain is Strain.GREEN and any(isinstance(x, Pressure) for x in problem.loads)
    return problem.time is None and not problem.tools and not follows


def tangent_at(
    problem: Problem, displacement: Points, strain: Strain, element: Element, what: str
) -> tuple[Newton, Points]:
    """Newton's method for solves with the tangent of an equilibrium, and the equilibrium checked.

    Args:
        problem: Static, without tools and without pressure that follows the body.
        displacement: Its equilibrium [m], shape (num_points, 3).
        strain: Strain measure of the equilibrium.
        element: Its tetrahedra.
        what: What is asked of the tangent, for the error.

    Raises:
        InputError: A problem whose tangent is not the derivative of its force.
    """
    if not has_exact_tangent(problem, strain):
        raise InputError(
            f"{what} are of statics without tools and without pressure that follows the body; take "
            "differences of solutions instead"
        )
    newton = Newton(problem, strain, _TOLERANCE, 1, element=element)
    return newton, newton.body.checked(displacement)


def find_sensitivities(
    problem: Problem,
    displacement: Points,
    changes: Sequence[Change],
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
) -> Floats:
    """Derivatives of an equilibrium's displacement by numbers of its problem.

    Args:
        problem: Static, without tools and without pressure that follows the body.
        displacement: Its equilibrium [m], shape (num_points, 3).
        changes: Each number moved down and up, on the same mesh with the same components fixed.
        strain: Strain measure of the equilibrium.
        element: Its tetrahedra.

    Returns:
        da/dp [m over the number's unit], shape (len(changes), num_points, 3).

    Raises:
        InputError: The problem has tools, a time span or a pressure that follows the body, or a
            change that moves the mesh or the fixed components.
        SoftTangentError: The state is no stable equilibrium.
    """
    newton, u = tangent_at(problem, displacement, strain, element, "sensitivities")
    fixed = FixedPoints(problem)
    forces_and_moves = []
    for change in changes:
        _require_comparable(problem, fixed, change)
        pair = (change.behind, change.ahead)
        r0, r1 = (Newton(p, strain, _TOLERANCE, 1, element=element).residual_at(u) for p in pair)
        s0, s1 = (FixedPoints(p).at(1.0) for p in pair)
        forces_and_moves.append(((r1 - r0) / change.width, (s1 - s0) / change.width))
    found = []
    for response in newton.responses_at(u, forces_and_moves):
        if response is None:
            raise SoftTangentError
        found.append(response)
    return np.array(found).reshape(len(changes), *u.shape)


def _require_comparable(problem: Problem, fixed: FixedPoints, change: Change) -> None:
    if not 0.0 < change.width < float("inf"):
        raise InputError(f"width = {change.width:g} of a change: needs a finite value above 0")
    for other in (change.behind, change.ahead):
        mesh, same = other.mesh, problem.mesh
        if mesh is not same and not (
            np.array_equal(mesh.points, same.points) and np.array_equal(mesh.cells, same.cells)
        ):
            raise InputError(
                "a change moves the mesh, which has no sensitivities here; take differences of "
                "solutions instead"
            )
        normals = ([support.normal for support in p.supports] for p in (other, problem))
        is_free = FixedPoints(other).is_free
        if next(normals) != next(normals) or not np.array_equal(is_free, fixed.is_free):
            raise InputError(
                "a change moves which components supports fix; take differences of solutions "
                "instead"
            )
