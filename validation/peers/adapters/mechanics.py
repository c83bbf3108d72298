"""What several adapters compute alike: Lamé's parameters, rest shapes, time steps, rest.

Rest is found by kinetic damping, for simulators that only know time steps: the body falls towards
equilibrium; whenever its kinetic energy has passed a peak it is stopped (Cundall 1976; Otter 1965
for dynamic relaxation). Time is not real then, so the step is chosen for stability alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

# Held against a growing stiffness: Green strain stiffens under stretch.
SAFETY = 0.6


class Points:
    """A job by its points, as they are: what `quadratic.Quadratic` is by its nodes."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.arrays = job

    def answer(self, displacement: Any) -> dict[str, Any]:
        """What a result file holds of their displacement [m]."""
        return {"displacement": displacement}


def lame(job: dict[str, Any]) -> tuple[float, float]:
    """Lamé's parameters lmbda and mu of a body of one material [Pa]."""
    E, nu = float(job["youngs_modulus"][0]), float(job["poissons_ratio"][0])
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def rest_shape(job: dict[str, Any]) -> tuple[Any, Any]:
    """Gradients of shape functions 1, 2, 3 as rows [1/m], (num_cells, 3, 3), and volumes [m3]."""
    points, cells = job["points"], job["cells"]
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    return np.linalg.inv(edges).transpose(0, 2, 1), np.linalg.det(edges) / 6.0


def held_points(job: dict[str, Any]) -> Any:
    """Which points are held, for tools that hold whole points where they are.

    Raises:
        ValueError: The job holds single components, or moves what it holds.
    """
    is_held = job["fixed"].astype(bool)
    if (is_held.any(axis=1) != is_held.all(axis=1)).any() or job["prescribed_displacement"].any():
        raise ValueError("only whole points can be held, where they are")
    return is_held.all(axis=1)


def force_scale(job: dict[str, Any]) -> float:
    """What a residual is measured by [N]: the load, or what a moved support takes about."""
    load = float(np.linalg.norm(np.where(job["fixed"], 0.0, job["external_force"])))
    moved = float(np.abs(job["prescribed_displacement"]).max())
    size = float(np.ptp(job["points"], axis=0).max())
    return load or float(job["youngs_modulus"][0]) * moved * size


def central_differences(job: dict[str, Any]) -> tuple[float, Any]:
    """Factors of increment <- keep increment + mobility (external - internal force)."""
    dt = float(job["time_step"])
    half = 0.5 * float(job["mass_damping"]) * dt
    mobility = dt**2 / (job["lumped_mass"][:, None] * (1.0 + half))
    return (1.0 - half) / (1.0 + half), np.where(job["fixed"], 0.0, mobility)


def stable_step(job: dict[str, Any], mass: Any) -> float:
    """A time step below 2 / sqrt(largest eigenvalue of M^-1 K), times SAFETY [s].

    Each cell bounds its own matrix by V (lmbda + 2 mu) sum |grad N_a|^2, each point adds up the
    cells around it (Gershgorin); mass [kg], (num_points,).
    """
    E, nu = job["youngs_modulus"], job["poissons_ratio"]
    modulus = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    inner, volume = rest_shape(job)
    gradients = np.concatenate([-inner.sum(axis=1)[:, None], inner], axis=1)
    sizes = np.sqrt((gradients**2).sum(axis=2))
    rows = (volume * modulus)[:, None] * sizes * sizes.sum(axis=1)[:, None]
    largest = (np.bincount(job["cells"].ravel(), rows.ravel(), len(mass)) / mass).max()
    return float(SAFETY * 2.0 / np.sqrt(largest))


def relax(
    step: Callable[[], None], velocity: Callable[[], Any], inertia: Any, force: float,
    tolerance: float, most: int, out_of_balance: Callable[[], Any] | None = None,
) -> tuple[int, float]:  # fmt: skip
    """Step to rest.

    Args:
        step: One step of semi-implicit Euler, unless `out_of_balance` is given.
        velocity: The array of velocities, which may be written to [m/s].
        inertia: Mass over time step, for each of its entries [kg/s].
        force: What is out of balance is measured by it [N].
        tolerance: On the relative residual.
        most: Steps at most.
        out_of_balance: Forces out of balance now [N]. Without it they are read from the change of
            velocity, which is the same for explicit steps alone: implicit ones that are not
            solved to the end hardly change it far from equilibrium too.

    Returns:
        Steps done and the last relative residual.
    """
    energy, before, residual = 0.0, velocity().copy(), np.inf
    for count in range(1, most + 1):
        step()
        now = velocity()
        unbalanced = inertia * (now - before) if out_of_balance is None else out_of_balance()
        residual = float(np.linalg.norm(unbalanced) / force)
        last, energy = energy, float((inertia * now**2).sum())
        if not np.isfinite(energy):
            raise SystemExit(f"the motion blew up after {count} steps")
        if residual <= tolerance:
            return count, residual
        if energy < last:
            now[:] = 0.0
            energy = 0.0
        before = now.copy()
    return most, residual


def require_rest(residual: float, tolerance: float) -> None:
    """End without an answer where the last step left more than that of the load out of balance."""
    if not residual <= tolerance:
        raise SystemExit(
            f"not at rest at its last step: {residual:.2g} of the load out of balance, which is "
            f"above {tolerance:g}"
        )


def march(
    step: Callable[[float], None], read: Callable[[], Any], times: Any, largest: float
) -> tuple[Any, float]:
    """Step through output times, with whole steps between them.

    Args:
        step: One step of so many seconds.
        read: Displacement now [m], (num_points, 3).
        times: From the start, evenly [s], (num_times,).
        largest: Step that is allowed [s].

    Returns:
        Displacement at each of the times, and the step.
    """
    interval = float(times[1] - times[0])
    count = int(np.ceil(interval / largest))
    states = [np.array(read())]
    for _ in times[1:]:
        for _ in range(count):
            step(interval / count)
        states.append(np.array(read()))
        if not np.isfinite(states[-1]).all():
            raise SystemExit(f"the motion blew up before output {len(states) - 1}")
    return np.array(states), interval / count
