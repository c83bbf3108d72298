"""The stable time step of explicit motion: springs, stiffness damping and contact."""

from __future__ import annotations

import math

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import BodyContact
from palpate.fastsim.contact.contact_law import ContactLaw
from palpate.fastsim.contact.explicit_tools import ExplicitTools
from palpate.fastsim.explicit_loads import ExplicitSprings, pulling_at_once
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Problem, Strain, TimeSpan


def critical_with_springs(body: Body, springs: ExplicitSprings, time_step: float | None) -> float:
    """The critical step of a body and its springs, without damping and contact [s].

    Where all springs at once are too stiff for the chosen step [s], only those that ever pull
    together count.
    """
    if not springs.springs:
        return body.critical_time_step()
    critical = body.critical_time_step(springs=springs.patches)
    if time_step is None or time_step <= critical:
        return critical
    return min(
        body.critical_time_step(springs=PatchSprings(body.mesh.points, together))
        for together in pulling_at_once(springs.springs)
    )


def bound_step(
    problem: Problem,
    mass: Floats,
    critical_time_step: float,
    *,
    time_step: float | None,
    stiffness_damping: float,
    contact: ContactLaw | None,
    body_contact: ContactLaw | None,
    tools: ExplicitTools | None,
) -> tuple[float, ExplicitTools | None, BodyContact | None]:
    """The longest stable step with damping and contact, which is made stiff enough for it.

    Args:
        problem: With tools, if any.
        mass: Lumped [kg], shape (num_points,).
        critical_time_step: Of the body and its springs [s]; infinite where none is known.
        time_step: Chosen step [s], or None.
        stiffness_damping: beta [s], >= 0; see `viscous_force`.
        contact: See `ExplicitBody`.
        body_contact: See `ExplicitBody`.
        tools: Prepared before, and then without effect on the step; None prepares them.

    Returns:
        The critical step [s], the tools and the contact of the body with itself, or None for each.
    """
    touching, critical = None, critical_time_step
    is_stiffened = time_step is not None and (bool(problem.tools) or body_contact is not None)
    if time_step is not None and is_stiffened:
        critical = stiffened_time_step(critical, stiffness_damping, time_step)
    if problem.tools and tools is None:
        tools = ExplicitTools(
            problem, contact, mass, critical_time_step=critical, time_step=time_step
        )
        critical = tools.critical_time_step
    if body_contact is not None:
        touching = BodyContact(
            problem, body_contact, mass, critical_time_step=critical, time_step=time_step
        )
        critical = touching.critical_time_step
    if not is_stiffened:
        critical = damped_time_step(critical, stiffness_damping)
    return critical, tools, touching


def divided(span: TimeSpan, wanted: float) -> tuple[float, int]:
    """The largest step up to the wanted one that divides the outputs, and the steps per output.

    Raises:
        TooManyStepsError: They would be more than 1e9.
    """
    span.require_few_steps(wanted)
    count = max(1, int(np.ceil(span.end_time / span.num_outputs / wanted * (1 - 1e-12))))
    return span.end_time / (span.num_outputs * count), count


# Stiffness damping: a viscous stress on the rate of strain, and what it leaves of the stable step.
#
#     S_v = beta C : dE/dt,   C Hooke's at rest, E the body's strain measure,
#
# with smoothed strains and stresses where the element has them (Kelvin and Voigt's solid). Explicit
# steps take dE/dt backwards, (E(a(t)) - E(a(t - dt))) / dt, and no equations are solved. For small
# strains about rest the forces are beta K a', so of a mode omega, xi = beta omega / 2, and with
# W = omega dt the increments of a step obey
#
#     z^2 - (2 - W^2 - 2 xi W) z + (1 - 2 xi W) = 0,   |z| <= 1  <=>  W^2 + 4 xi W <= 4:
#
#     dt <= 2/omega (sqrt(1 + xi^2) - xi) = sqrt(c^2 + beta^2) - beta,   c = 2/omega undamped.
#
# The highest mode of the mesh decides. Mass damping, which is central, changes nothing in it. The
# damping of a mode comes out beta omega / 2 but for the order of beta omega^2 dt.


def damped_time_step(critical_time_step: float, stiffness_damping: float) -> float:
    """The longest stable step with stiffness damping beta >= 0 [s], from 2 / omega without it [s].

    >>> damped_time_step(2.0, 0.0)
    2.0
    >>> damped_time_step(3.0, 4.0)
    1.0
    """
    if stiffness_damping == 0.0 or math.isinf(critical_time_step):
        return critical_time_step
    # Without the difference of two numbers that may be nearly equal.
    whole = math.hypot(critical_time_step, stiffness_damping) + stiffness_damping
    return critical_time_step * (critical_time_step / whole)


def stiffened_time_step(
    critical_time_step: float, stiffness_damping: float, time_step: float
) -> float:
    """2 / omega of a body as stiff as damping makes it in steps of a length [s].

    omega^2 (1 + 2 beta / dt), so that dt <= 2 / omega is the same as `damped_time_step`, and the
    stiffness of contact can be added.

    >>> stiffened_time_step(3.0, 4.0, 1.0)
    1.0
    """
    return critical_time_step / math.sqrt(1.0 + 2.0 * stiffness_damping / time_step)


def viscous_force(
    body: Body, displacement: Points, increment: Points, damping_over_step: float
) -> Points:
    """Forces of S = beta / dt C : (E(a) - E(a - d)) of a body [N], shape (num_points, 3).

    Of displacement a and increment d [m] and beta / dt [-].
    """
    H, D = body.displacement_gradients(displacement), body.displacement_gradients(increment)
    change = D
    if body.strain is Strain.GREEN:
        # Half way, where a finite turn changes no strain.
        change = D + np.swapaxes(H - 0.5 * D, 1, 2) @ D
    P = damping_over_step * body.stresses(0.5 * (change + np.swapaxes(change, 1, 2)))
    if body.strain is Strain.GREEN:
        P = P + H @ P
    forces = np.einsum("c,cij,caj->aic", body.mesh.cell_volumes, P, body.shape_gradients)
    corners, count = body.mesh.cells.T.ravel(), body.mesh.num_points
    parts = [np.bincount(corners, forces[:, i].ravel(), minlength=count) for i in range(3)]
    return np.stack(parts, axis=1)
