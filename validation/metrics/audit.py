"""How far is a displacement from equilibrium on its own mesh? By the judge, without FEniCSx.

What the numbers mean stands at `palpate.reference.result.Audit`; `palpate.reference.audit` finds
the same numbers in its own way, and those of a higher degree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from inspect import signature

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Element, Problem, Strain, require_no_tools
from palpate.meshes.rigid_modes import require_supported
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference.errors import ReferenceFailedError
from palpate.reference.result import Audit
from palpate.validation.metrics.body import Body, load_force, spring_stiffness_times
from palpate.validation.metrics.laws import along, hooke, strain_of
from palpate.validation.metrics.smoothing import Array

# Rounding ends any hope of convergence long before.
_MOST_ITERATIONS = 20_000
_SOLVE_TOLERANCE = 1e-10
# A random right-hand side has a larger component along every mode.
_SIGN_TOLERANCE = 1e-6


def audit_on_own_mesh(
    problem: Problem, displacement: Points, strain: Strain, element: Element = Element.LINEAR
) -> Audit:
    """Measure a finite displacement [m] against the equations of its own tetrahedra.

    The audit is of degree 1; see `palpate.reference.audit.audit_displacement`.

    Raises:
        InputError: A body that floats, or a problem with tools.
        ReferenceFailedError: The linear solver did not converge.
    """
    require_supported(problem)
    require_no_tools(problem, "the audit")
    body, linear = Body(problem, strain, element), Body(problem, Strain.LINEAR, element)
    residual, _ = body.out_of_balance(displacement)
    lifted = Tangent(linear, displacement).solve(residual, _SOLVE_TOLERANCE)
    residual_norm = math.sqrt(max(float(np.vdot(residual, lifted)), 0.0))
    cell_errors = _cell_errors(linear, lifted)
    if element is Element.SMOOTHED:
        # The energy of averages belongs to no cell: distribute it as that of the cells themselves.
        cell_errors *= residual_norm / (np.linalg.norm(cell_errors) or 1.0)
    energy = body.energy(displacement)
    scale = math.sqrt(2.0 * energy) if energy > 0.0 else 0.0
    positions = body.mesh.points + displacement
    volumes = signed_volumes(positions, body.mesh.cells)
    tangent, smallest_det_f = Tangent(body, displacement), float((volumes / body.volumes).min())
    errors = _estimate_errors(tangent, displacement, residual, smallest_det_f)
    arms = positions if strain is Strain.GREEN else body.mesh.points
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
    right = np.random.default_rng(0).standard_normal(body.fixed.shape)
    try:
        tangent.solve(right, _SIGN_TOLERANCE)
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
    to_supports = body.to_supports(displacement)
    try:
        right = residual - tangent.times(to_supports)
        step = to_supports + tangent.solve(right, _SOLVE_TOLERANCE)
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


class NotPositiveDefiniteError(ArithmeticError):
    """A symmetric matrix has a direction of no or negative curvature, or one has no inverse."""


class Tangent:
    """Derivative of internal less external force by the displacement, fixed components left out."""

    def __init__(self, body: Body, displacement: Points) -> None:
        self.body, self._displacement = body, displacement
        self._H = body.gradient(displacement)

    @property
    def is_symmetric(self) -> bool:
        """Whether it is: not where a load follows the surface."""
        return not self.body.has_followers

    def times(self, change: Points) -> Points:
        """The forces [N] of a change [m], both (num_points, 3), 0 where fixed; exact."""
        body = self.body
        dH = body.gradient(change)
        if body.strain is Strain.LINEAR:
            stress = body.first_stress(dH)
        else:
            stress = along(body.first_stress, self._H, dH)
        force = body.force_of(stress)
        if body.has_followers:
            force -= self._load_change(change)
        if body.problem.springs:
            force = force + spring_stiffness_times(body.mesh, body.problem.springs, change)
        return body.freed(force)

    def solve(self, right: Points, tolerance: float) -> Points:
        """The change [m] that forces [N] make, both (num_points, 3); see `solve_scaled`."""
        # Near equilibrium what rounding of large forces left across slanted planes would stay.
        right = self.body.freed(right)
        return solve_scaled(
            self.times,
            right,
            _diagonal(self.body),
            tolerance=tolerance,
            is_symmetric=self.is_symmetric,
        )

    def _load_change(self, change: Points) -> Points:
        """Change of pressure forces; they are quadratic: central differences are exact."""
        far = float(np.abs(change).max())
        if not far > 0.0:
            return np.zeros_like(change)
        length = float(np.ptp(self.body.mesh.points, axis=0).max()) / far
        body, ends = self.body, []
        for sign in (1.0, -1.0):
            ends.append(body.total(body.loads(self._displacement + sign * length * change)))
        found: Points = (ends[0] - ends[1]) / (2.0 * length)
        return found


def _diagonal(body: Body) -> Points:
    """Scales of a linear system: one number for a point that slides along a slanted plane.

    What is divided by them stays in that plane.
    """
    diagonal = body.stiffness_diagonal
    if body.slopes is None:
        return diagonal
    scaled = diagonal.copy()
    scaled[body.slopes.points] = diagonal[body.slopes.points].mean(axis=1, keepdims=True)
    return scaled


def solve_scaled(
    product: Callable[[Points], Points],
    right: Points,
    diagonal: Points,
    *,
    tolerance: float,
    is_symmetric: bool = True,
) -> Points:
    """Solve A x = b without a matrix, scaled by a diagonal, or find that A is not definite.

    By conjugate gradients where A is symmetric (J. R. Shewchuk, An introduction to the conjugate
    gradient method without the agonizing pain, 1994, section B3), else by stabilised bi-conjugate
    gradients (H. A. van der Vorst, SIAM J. Sci. Stat. Comput. 13, 1992, 631-644). `product` is A x;
    `right` is b, (num_points, 3), as x 0 where fixed; `diagonal` is positive, near A's own;
    `tolerance` is of the residual over b, both scaled by the diagonal.

    Raises:
        NotPositiveDefiniteError: A direction p on the way has p . A p <= 0, or the recurrence of an
            A that is not symmetric breaks down. From a random b any negative eigenvalue shows
            before the residual is small.
        ReferenceFailedError: No convergence.
    """
    from scipy.sparse.linalg import LinearOperator, bicgstab, cg

    root = np.sqrt(diagonal)

    def scaled(flat: Points) -> Points:
        along = flat.reshape(right.shape)
        image: Points = (product(along / root) / root).ravel()
        if is_symmetric and flat.any() and not float(flat @ image) > 0.0:
            raise NotPositiveDefiniteError
        return image

    # Scaled to unit size: scipy takes products below eps^2 for a breakdown.
    size = float(np.linalg.norm(right / root))
    if size == 0.0:
        return np.zeros_like(right)
    solver = cg if is_symmetric else bicgstab
    # scipy 1.12 renamed it.
    name = "rtol" if "rtol" in signature(solver).parameters else "tol"
    found, status = solver(
        LinearOperator((right.size, right.size), matvec=scaled, dtype=np.float64),
        (right / root).ravel() / size,
        maxiter=_MOST_ITERATIONS,
        atol=0.0,
        **{name: tolerance},
    )
    if status > 0:
        raise ReferenceFailedError(
            f"the audit's linear solver found nothing in {_MOST_ITERATIONS} iterations: the mesh "
            "or material is too badly conditioned for it; audit on degree 2, which needs FEniCSx"
        )
    if status < 0 or not np.isfinite(found).all():
        raise NotPositiveDefiniteError
    solution: Points = size * found.reshape(right.shape) / root
    return solution
