"""Rest by kinetic damping, for simulators that only know time steps.

The body falls towards equilibrium; whenever its kinetic energy has passed a peak it is stopped
(Cundall 1976; Otter 1965 for dynamic relaxation). Time is not real then, so the step is chosen
for stability alone. For the adapters beside this file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

# Held against a growing stiffness: Green strain stiffens under stretch.
SAFETY = 0.6


def stable_step(rest: dict[str, Any], mass: Any) -> float:
    """A time step below 2 / sqrt(largest eigenvalue of M^-1 K), times SAFETY [s].

    Each cell bounds its own matrix by V (lmbda + 2 mu) sum |grad N_a|^2, each point adds up the
    cells around it (Gershgorin); mass [kg], (num_points,).
    """
    points, cells = rest["points"], rest["cells"]
    E, nu = rest["youngs_modulus"], rest["poissons_ratio"]
    modulus = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    edges = (points[cells[:, 1:]] - points[cells[:, :1]]).transpose(0, 2, 1)
    inner = np.linalg.inv(edges)
    gradients = np.concatenate([-inner.sum(axis=1)[:, None], inner], axis=1)
    sizes = np.sqrt((gradients**2).sum(axis=2))
    volume = np.linalg.det(edges) / 6.0
    rows = (volume * modulus)[:, None] * sizes * sizes.sum(axis=1)[:, None]
    largest = (np.bincount(cells.ravel(), rows.ravel(), len(points)) / mass).max()
    return float(SAFETY * 2.0 / np.sqrt(largest))


def relax(
    step: Callable[[], tuple[float, float]], stop: Callable[[], None], tolerance: float, most: int
) -> tuple[int, float]:
    """Step to rest.

    Args:
        step: One step; gives kinetic energy and relative residual.
        stop: Sets all velocities to zero.
        tolerance: On the relative residual.
        most: Steps at most.

    Returns:
        Steps done and the last relative residual.
    """
    before, residual = 0.0, np.inf
    for count in range(1, most + 1):
        energy, residual = step()
        if not np.isfinite(energy):
            raise SystemExit(f"the motion blew up after {count} steps")
        if residual <= tolerance:
            return count, residual
        if energy < before:
            stop()
            energy = 0.0
        before = energy
    return most, residual
