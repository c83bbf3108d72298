"""A soft body in Newton (Warp) on the processor: its particles, and its way to rest.

Whoever subclasses it says which solver steps it, and what constants its law is given.
"""

from __future__ import annotations

from typing import Any

import newton
import numpy as np
import warp as wp
from mechanics import force_scale, lame, relax, require_rest

TOLERANCE, MOST_STEPS = 1e-3, 40_000  # single precision carries no more
RISE = 2000  # steps over which what holds the body is moved to its place


class SoftMesh:
    """Points, cells and what holds them."""

    model: Any
    version, precision = f"{newton.__version__} (Warp {wp.__version__})", "float32"

    def __init__(self, job: dict[str, Any], time_step: float, gravity: Any) -> None:
        wp.config.log_level = wp.LOG_WARNING
        wp.init()
        k_mu, k_lambda = self.constants(*lame(job))
        builder = newton.ModelBuilder(gravity=tuple(map(float, gravity)))
        builder.add_soft_mesh(
            pos=(0.0, 0.0, 0.0),
            rot=wp.quat_identity(),
            scale=1.0,
            vel=(0.0, 0.0, 0.0),
            vertices=[tuple(map(float, p)) for p in job["points"]],
            indices=job["cells"].ravel().tolist(),
            density=float(job["density"][0]),
            k_mu=k_mu,
            k_lambda=k_lambda,
            k_damp=0.0,
            add_surface_mesh_edges=False,
        )
        self.held = job["fixed"].astype(bool)
        self._rest, self._moved = job["points"], job["prescribed_displacement"]
        for index in np.flatnonzero(self.held.all(axis=1)).tolist():
            builder.particle_mass[index] = 0.0
        self._solver = self.make_solver(builder)
        self._states, self._control = [self.model.state() for _ in range(2)], self.model.control()
        self.time_step = time_step

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """k_mu and k_lambda of a body with Lame's parameters at rest [Pa]."""
        raise NotImplementedError

    def make_solver(self, builder: Any) -> Any:
        """Finalize the model as `self.model`, and what steps it."""
        raise NotImplementedError

    @property
    def now(self) -> Any:
        """The present state."""
        return self._states[0]

    def step(self, applied: Any = None, share: float = 1.0) -> None:
        """One step, with forces on the points where given; what is held stays, or is moved."""
        self.now.clear_forces()
        if applied is not None:
            self.now.particle_f.numpy()[:] = applied
        self._solver.step(*self._states, self._control, None, self.time_step)
        self._states.reverse()
        self.now.particle_q.numpy()[self.held] = (self._rest + share * self._moved)[self.held]
        self.now.particle_qd.numpy()[self.held] = 0.0


class Rested(SoftMesh):
    """Stepped until it rests."""

    law = "neo-Hookean"
    laws = ("saint-venant-kirchhoff", "neo-hookean-stable")
    out_of_balance: Any = None  # a function of nothing, where the steps are not explicit

    def __init__(self, job: dict[str, Any]) -> None:
        if str(job["strain"]) == "linear":
            raise ValueError("it knows no linear strain")
        self._job = job
        super().__init__(job, self.choose_step(job), np.zeros(3))
        self.step(share=0.0)  # compiles the kernels
        self._velocity()[:] = 0.0

    def choose_step(self, job: dict[str, Any]) -> float:
        """A time step [s]."""
        raise NotImplementedError

    def reset(self, velocity: Any = None) -> None:
        """To its places at rest, with a velocity [m/s]."""
        self.now.particle_q.numpy()[:] = self._job["points"]
        self._velocity()[:] = 0.0 if velocity is None else np.where(self.held, 0.0, velocity)

    def _velocity(self) -> Any:
        return self.now.particle_qd.numpy()

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From the undeformed body to rest."""
        job = self._job
        applied = np.where(self.held, 0.0, job["external_force"]).astype(np.float32)
        inertia = job["lumped_mass"][:, None] / self.time_step
        shares = iter(np.linspace(0.0, 1.0, rise := RISE if self._moved.any() else 0))
        for limit, most in ((-1.0, rise), (TOLERANCE, MOST_STEPS)):
            num_steps, residual = relax(
                lambda: self.step(applied, next(shares, 1.0)), self._velocity, inertia,
                force_scale(job), limit, most, self.out_of_balance,
            )  # fmt: skip
        require_rest(residual, TOLERANCE)
        places = self.now.particle_q.numpy().astype(np.float64)
        self.answer = {"displacement": places - job["points"]}
        return {
            "method": f"time steps to rest by kinetic damping, {num_steps} steps, single precision",
            "relative_residual": residual,
            "time_step": self.time_step,
        }
