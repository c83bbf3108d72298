"""Stiffness damping: a viscous stress on the rate of strain, and what it leaves of the stable step.

    S_v = beta C : dE/dt,   C Hooke's at rest, E the body's strain measure,

with smoothed strains and stresses where the element has them (Kelvin and Voigt's solid). Explicit
steps take dE/dt backwards, (E(a(t)) - E(a(t - dt))) / dt, and no equations are solved. For small
strains about rest the forces are beta K a', so of a mode omega, xi = beta omega / 2, and with
W = omega dt the increments of a step obey

    z^2 - (2 - W^2 - 2 xi W) z + (1 - 2 xi W) = 0,   |z| <= 1  <=>  W^2 + 4 xi W <= 4:

    dt <= 2/omega (sqrt(1 + xi^2) - xi) = sqrt(c^2 + beta^2) - beta,   c = 2/omega undamped.

The highest mode of the mesh decides. Mass damping, which is central, changes nothing in it. The
damping of a mode comes out beta omega / 2 but for the order of beta omega^2 dt.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.fastsim.body import Body
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain


def damped_time_step(critical_time_step: float, stiffness_damping: float) -> float:
    """The longest stable step with stiffness damping [s].

    Args:
        critical_time_step: Without it, 2 / omega [s]; infinite where none is known.
        stiffness_damping: beta [s], >= 0.

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

    omega^2 (1 + 2 beta / dt), so that dt <= 2 / omega says the same as `damped_time_step`, and the
    stiffness of contact can be added.

    >>> stiffened_time_step(3.0, 4.0, 1.0)
    1.0
    """
    return critical_time_step / math.sqrt(1.0 + 2.0 * stiffness_damping / time_step)


def viscous_force(
    body: Body, displacement: Points, increment: Points, damping_over_step: float
) -> Points:
    """Forces of S = beta / dt C : (E(a) - E(a - d)) [N], shape (num_points, 3).

    Args:
        body: Whose moduli at rest, strain measure and element these are.
        displacement: a [m], shape (num_points, 3).
        increment: d [m], likewise.
        damping_over_step: beta / dt [-].
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
