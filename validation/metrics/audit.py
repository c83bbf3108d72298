"""How far is a displacement from equilibrium on its own mesh? By the judge, without FEniCSx.

What the numbers mean stands at `palpate.reference.result.Audit`; `palpate.reference.audit` finds
the same ones in its own way, and those of a higher degree.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Element, Problem, Strain, require_no_tools
from palpate.meshes.rigid_modes import require_supported
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference.result import Audit
from palpate.validation.metrics.body import Body, load_force
from palpate.validation.metrics.laws import Array, hooke, strain_of
from palpate.validation.metrics.linear_solver import (
    NotPositiveDefiniteError,
    conjugate_gradients,
    stabilised_gradients,
)
from palpate.validation.metrics.tangent import Tangent

_SOLVE_TOLERANCE = 1e-10
# A random right-hand side has more than this of every mode.
_SIGN_TOLERANCE = 1e-6


def audit_on_own_mesh(
    problem: Problem, displacement: Points, strain: Strain, element: Element = Element.LINEAR
) -> Audit:
    """Measure a displacement against the equations of its own tetrahedra.

    Args:
        problem: Mesh, material, supports and loads, without tools.
        displacement: At the mesh's points [m], (num_points, 3), finite.
        strain: Strain measure of the model.
        element: What the tetrahedra are.

    Returns:
        The audit, of degree 1.

    Raises:
        InputError: A body that floats, or a problem with tools.
        ReferenceFailedError: The linear solver did not converge.

    Note:
        See `palpate.reference.audit.audit_displacement`.
    """
    require_supported(problem)
    require_no_tools(problem, "the audit")
    body, linear = Body(problem, strain, element), Body(problem, Strain.LINEAR, element)
    residual, _ = body.out_of_balance(displacement)
    lifted = _solve(Tangent(linear, displacement), residual)
    residual_norm = math.sqrt(max(float(np.vdot(residual, lifted)), 0.0))
    cell_errors = _cell_errors(linear, lifted)
    if element is Element.SMOOTHED:
        # The energy of averages has no places: by that of the cells themselves.
        cell_errors *= residual_norm / (np.linalg.norm(cell_errors) or 1.0)
    energy = body.energy(displacement)
    scale = math.sqrt(2.0 * energy) if energy > 0.0 else 0.0
    places = body.mesh.points + displacement
    volumes = signed_volumes(places, body.mesh.cells)
    tangent, smallest_det_f = Tangent(body, displacement), float((volumes / body.volumes).min())
    errors = _estimate_errors(tangent, displacement, residual, smallest_det_f)
    arms = places if strain is Strain.GREEN else body.mesh.points
    return Audit(
        degree=1,
        strain=strain,
        residual_norm=residual_norm,
        relative_residual_norm=residual_norm / scale if scale else math.inf,
        support_gap=float(np.abs(body.to_supports(displacement)).max(initial=0.0)),
        largest_displacement=float(np.linalg.norm(displacement, axis=1).max(initial=0.0)),
        force_imbalance=float(np.linalg.norm(residual.sum(axis=0))),
        moment_imbalance=float(np.linalg.norm(np.cross(arms, residual).sum(axis=0))),
        strain_energy=energy,
        volume=float(volumes.sum()),
        smallest_det_f=smallest_det_f,
        is_stable=_is_stable(tangent, smallest_det_f),
        displacement_error=errors[0],
        volume_error=errors[1],
        cell_errors=cell_errors,
    )


def _solve(tangent: Tangent, right: Points) -> Points:
    way = conjugate_gradients if tangent.is_symmetric else stabilised_gradients
    # Near equilibrium what rounding of large forces left across slanted planes would stay.
    right = tangent.body.freed(right)
    return way(tangent.times, right, _diagonal(tangent.body), tolerance=_SOLVE_TOLERANCE)


def _diagonal(body: Body) -> Points:
    """That scales a linear system: one number for a point that slides along a slanted plane.

    What is divided by it then stays in that plane.
    """
    diagonal = body.stiffness_diagonal
    if body.slopes is None:
        return diagonal
    scaled = diagonal.copy()
    scaled[body.slopes.points] = diagonal[body.slopes.points].mean(axis=1, keepdims=True)
    return scaled


def _cell_errors(body: Body, lifted: Points) -> Array:
    """Root of twice each cell's elastic energy in a displacement."""
    E = strain_of(body.gradient(lifted), Strain.LINEAR)
    density = np.einsum("cij,cij->c", E, hooke(E, body.lmbda, body.mu))
    errors: Array = np.sqrt(body.volumes * density)
    return errors


def _is_stable(tangent: Tangent, smallest_det_f: float) -> bool | None:
    body = tangent.body
    if body.strain is Strain.LINEAR or body.has_followers or not smallest_det_f > 0.0:
        return None
    right = body.freed(np.random.default_rng(0).standard_normal(body.held.shape))
    try:
        conjugate_gradients(tangent.times, right, _diagonal(body), tolerance=_SIGN_TOLERANCE)
    except NotPositiveDefiniteError:
        return False
    return True


def _estimate_errors(
    tangent: Tangent, displacement: Points, residual: Points, smallest_det_f: float
) -> tuple[float | None, float | None]:
    """One Newton step from the displacement: what it changes is the estimate."""
    body, mesh = tangent.body, tangent.body.mesh
    if body.strain is Strain.GREEN and not smallest_det_f > 0.0:
        return None, None
    held = body.to_supports(displacement)
    try:
        step = held + _solve(tangent, residual - tangent.times(held))
    except NotPositiveDefiniteError:
        return None, None
    size = float(np.linalg.norm(displacement + step))
    displacement_error = float(np.linalg.norm(step)) / size if size else None

    def volume_change(moved: Points) -> float:
        return float((signed_volumes(mesh.points + moved, mesh.cells) - body.volumes).sum())

    before = volume_change(displacement)
    if body.strain is Strain.LINEAR:
        after = volume_change(displacement + step)
    else:
        # To first order: a finite step turns sections along their tangent, which adds volume that
        # the body does not gain. The derivative of volume is the force of a unit suction.
        suction = Pressure(mesh.boundary_facets, -1.0)
        gradient = load_force(mesh, suction, displacement, Strain.GREEN)
        after = before + float(np.vdot(gradient, step))
    return displacement_error, before / after - 1.0 if after else None
