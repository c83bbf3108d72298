"""Static equilibrium: linear strain (eq. 5) and finite strain by Newton-Raphson (eq. 9-10).

The matrix of eq. 10 as printed is the secant matrix K + P(a), a fixed-point iteration; the default
here is the consistent tangent dR/da, which converges quadratically. The steps are driven from
here, so that progress can be shown and Ctrl-C works between them; assembly and conjugate
gradients are in the core.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.fastsim.contact.contact_law import ContactLaw
from palpate.fastsim.contact.errors import ContactLostError
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.errors import EquilibriumLostError, NotConvergedError
from palpate.fastsim.newton import (
    MULTIGRID_FROM_POINTS,
    SOFT,
    Iteration,
    Newton,
    NewtonOutcome,
    find_softening,
)
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.rigid_modes import require_supported

__all__ = ["MULTIGRID_FROM_POINTS", "Iteration", "StaticResult", "solve_static"]

# The load at which equilibrium ends is found to this fraction of the full load.
SMALLEST_LOAD_STEP = 1.0 / 8192.0


@dataclass(frozen=True, eq=False)
class StaticResult:
    """A static equilibrium.

    Attributes:
        displacement: [m], shape (num_points, 3).
        strain: The strain measure used.
        iterations: Newton iterations in all (1 for linear strain).
        linear_iterations: Conjugate-gradient iterations in all.
        residual_history: Relative residual after each Newton iteration of the last load step.
        load_steps: Accepted load factors, the last is 1.
        smallest_det_f: Smallest det F of all cells [-], > 0 for Green strain.
    """

    displacement: Points
    strain: Strain
    iterations: int
    linear_iterations: int
    residual_history: tuple[float, ...]
    load_steps: tuple[float, ...]
    smallest_det_f: float


def solve_static(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
    start: Points | None = None,
    relative_tolerance: float = 1e-10,
    max_iterations: int = 30,
    iteration: Iteration = Iteration.NEWTON,
    contact: ContactLaw | None = None,
    progress: Callable[[str], None] | None = None,
) -> StaticResult:
    """Find R(a) = F (eq. 1) with the supports' displacements prescribed.

    With tools, the equilibrium at the end of their paths; `contact.static_contact.solve_contact`
    gives those at every knot, and the forces on the tools.

    Args:
        problem: Mesh, material, supports, loads and springs, whose anchors are where their paths
            end.
        strain: Engineering strain (one linear solve) or finite strain (Newton).
        element: Linear tetrahedra, plain or smoothed: nearer the truth on the same mesh.
        start: A displacement near the solution [m], shape (num_points, 3), to begin from at full
            load (warm start), with the tools where their paths end; where that does not converge,
            and where None, the load is raised from rest and the tools go along their paths.
        relative_tolerance: Residual over the load's norm (or the reaction's, without loads).
        max_iterations: Newton iterations per load step.
        iteration: Consistent tangent, or the secant matrix of eq. 10 (slow: give it more).
        contact: How contact is enforced: None is the constraint.
        progress: Called with one line per load step.

    Returns:
        The equilibrium; its relative residual is at most the tolerance, or, in a slender body, the
        rounding error of its nodal forces; it is the last of `residual_history`.

    Raises:
        UnsupportedBodyError: The body can float.
        EquilibriumLostError: Finite strain has no stable equilibrium at the full load; states up
            to which load, where the body softens, and carries the last good state.
        NotConvergedError: The iteration failed for another reason; carries the last good state.
        ContactLostError: No equilibrium with the tools beyond a time of their paths.

    Note:
        An equilibrium whose tangent is not positive definite is not accepted (not tested under
        follower pressure, nor for the secant iteration).
        Plain linear tetrahedra are too stiff in bending and lock as Poisson's ratio nears 0.5;
        smoothed ones hardly, unless the body is only a cell or two thick.
    """
    if problem.tools:
        at = functools.partial(
            solve_contact,
            problem,
            strain=strain,
            element=element,
            law=contact,
            relative_tolerance=relative_tolerance,
            progress=progress,
        )
        try:
            found = at(start=None if problem.tools[0].drive else start)
        except ContactLostError:
            if start is None:
                raise
            found = at()
        return StaticResult(
            displacement=found.displacements[-1],
            strain=strain,
            iterations=found.iterations,
            linear_iterations=found.linear_iterations,
            residual_history=found.residual_history,
            load_steps=(1.0,),
            smallest_det_f=float(found.smallest_det_f[-1]),
        )
    require_supported(problem)
    newton = Newton(problem, strain, relative_tolerance, max_iterations, iteration, element=element)
    factor, step = 0.0, 1.0
    displacement = np.zeros_like(problem.mesh.points)
    accepted: list[float] = []
    outcome = NewtonOutcome(None)
    if start is not None:
        outcome = newton.solve(newton.body.checked(start), 1.0)
        if outcome.displacement is not None:
            displacement, factor = outcome.displacement, 1.0
            accepted.append(1.0)
        if progress:
            progress(f"warm start: {outcome.reason or 'converged'}, {newton.iterations} iterations")
    while factor < 1.0:
        target = min(1.0, factor + step)
        if target > 1.0 - 1e-9:
            target = 1.0
        outcome = newton.solve(displacement, target)
        if outcome.displacement is not None:
            displacement, factor = outcome.displacement, target
            accepted.append(target)
            if progress:
                progress(f"load {target:.4g} reached, {newton.iterations} iterations")
            if len(outcome.history) <= 6:
                step *= 2.0
            continue
        step *= 0.5
        if progress:
            progress(f"load {target:.4g} not reached ({outcome.reason}); trying smaller steps")
        if strain is Strain.LINEAR or step < SMALLEST_LOAD_STEP:
            raise _failure(newton, outcome, factor, displacement)
    return StaticResult(
        displacement=displacement,
        strain=strain,
        iterations=newton.iterations,
        linear_iterations=newton.linear_iterations,
        residual_history=tuple(outcome.history),
        load_steps=tuple(accepted),
        smallest_det_f=newton.body.smallest_det_f(displacement)[0],
    )


def _failure(
    newton: Newton, outcome: NewtonOutcome, factor: float, displacement: Points
) -> NotConvergedError:
    """The error at the end of the path: a limit of the material, or a failed iteration."""
    smallest, cell = newton.body.smallest_det_f(displacement)
    known: dict[str, Any] = {
        "reason": outcome.reason,
        "load_factor": factor,
        "residual": outcome.history[-1] if outcome.history else float("nan"),
        "iterations": newton.iterations,
        "smallest_det_f": smallest,
        "displacement": displacement,
    }
    if newton.body.strain is Strain.GREEN:
        solver = newton.solver_at(displacement, factor)
        softening = find_softening(newton.body, displacement, solver)
        if softening.stiffness < SOFT:
            return EquilibriumLostError(
                **known,
                cell=softening.cell,
                position=softening.position,
                smallest_stretch=softening.smallest_stretch,
                stiffness=softening.stiffness,
            )
    return NotConvergedError(**known, cell=cell)
