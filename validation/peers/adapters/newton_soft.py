"""Newton (Warp) on the processor: soft bodies of stable neo-Hookean laws, in motion or to rest.

    palpate gate CASE --law neo-hookean-stable-log \
        --simulator "python newton_soft.py {case} {result}"
    palpate gate CASE --law neo-hookean-stable \
        --simulator "python newton_soft.py {case} {result} solver=vbd"

It steps semi-implicitly, or by vertex block descent: implicit Euler, each step by sweeps of block
descent. With too few sweeps a stiff body creeps at a velocity that hardly changes, wherever it is:
so it counts as at rest where the forces of its law, computed here at its positions in double
precision, balance the load. Positions in single precision may be too coarse for that: rounding
those of a slender beam leaves some per cent of its load. A body that does not get there has no
result. For Saint-Venant-Kirchhoff it solves its own law: the difference is one of model, not of
solver. Its bodies have no mass damping: that is a force on the points, from the previous step.
"""

from __future__ import annotations

import sys
from typing import Any

import newton
import numpy as np
import warp as wp
from harness import (
    all_gradients,
    force_scale,
    gravity_of,
    lame,
    march,
    relax_with_rise,
    require_fixed_points,
    require_rest,
    solve_case,
    stable_step,
)

TOLERANCE, MOST_STEPS = 1e-3, 40_000  # single precision carries no more
RISE = 2000  # steps in which supports are moved to their positions
ITERATIONS = 10  # sweeps of block descent: Newton's default
TIME_STEP = 1.0 / 600.0  # 60 frames of 10 steps each


class SoftMesh:
    """A soft body with its supports; a subclass chooses the solver that steps it."""

    model: Any
    device = "cpu"
    law = "neo-Hookean"
    version, precision = f"{newton.__version__} (Warp {wp.__version__})", "float32"

    def __init__(self, job: dict[str, Any], time_step: float, gravity: Any) -> None:
        wp.config.log_level = wp.LOG_WARNING
        wp.init()
        self._job = job
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
        self.fixed = job["fixed"].astype(bool)
        self._rest, self._moved = job["points"], job["prescribed_displacement"]
        for index in np.flatnonzero(self.fixed.all(axis=1)).tolist():
            builder.particle_mass[index] = 0.0
        self._solver = self.make_solver(builder)
        self._states, self._control = [self.model.state() for _ in range(2)], self.model.control()
        self.time_step = time_step

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """k_mu and k_lambda of a body with Lame's parameters at rest [Pa]."""
        raise NotImplementedError

    def make_solver(self, builder: Any) -> Any:
        """Finalize the model as `self.model`, and return its solver."""
        raise NotImplementedError

    def choose_step(self, job: dict[str, Any]) -> float:
        """A time step [s]."""
        raise NotImplementedError

    @property
    def now(self) -> Any:
        """The present state."""
        return self._states[0]

    def step(self, applied: Any = None, part: float = 1.0) -> None:
        """Take a step, with forces on points where given; supports stay, or are moved."""
        self.now.clear_forces()
        if applied is not None:
            self.now.particle_f.numpy()[:] = applied
        self._solver.step(*self._states, self._control, None, self.time_step)
        self._states.reverse()
        self.now.particle_q.numpy()[self.fixed] = (self._rest + part * self._moved)[self.fixed]
        self.now.particle_qd.numpy()[self.fixed] = 0.0


class SemiImplicit(SoftMesh):
    """A body of the stable neo-Hookean law with its logarithm, stepped semi-implicitly."""

    tool, laws = "Newton", ("saint-venant-kirchhoff", "neo-hookean-stable-log")
    scheme: tuple[str, dict[str, Any]] = ("semi-implicit-euler", {})

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """Its energy's derivatives at rest are 3/4 k_mu and k_lambda - 5/8 k_mu (Smith 2018).

        Given Lame's parameters as they are, a body bends 41 % too far even where it is stiff.
        """
        return 4.0 / 3.0 * mu, lmbda + 5.0 / 6.0 * mu

    def make_solver(self, builder: Any) -> Any:
        """Step without triangles and contacts: only the tetrahedra and the update."""
        self.model = builder.finalize(device=self.device)
        self.model.particle_grid = None
        return newton.solvers.SolverSemiImplicit(self.model, enable_tri_contact=False)

    def choose_step(self, job: dict[str, Any]) -> float:
        """Half of the stable step, for a law that stiffens [s]."""
        return 0.5 * float(stable_step(job, job["lumped_mass"]))


class BlockDescent(SoftMesh):
    """A body of the stable neo-Hookean law, stepped by sweeps of block descent."""

    tool, laws = "Newton VBD", ("saint-venant-kirchhoff", "neo-hookean-stable")
    scheme = ("backward-euler", {"iterations_per_step": ITERATIONS})

    def __init__(self, job: dict[str, Any], *rest: Any) -> None:
        require_fixed_points(job)  # a component that is put back after a step is free in the sweeps
        self._lame, (self._gradients, self._volumes) = lame(job), all_gradients(job)
        super().__init__(job, *rest)

    def out_of_balance(self) -> Any:
        """Residual of the load and the forces of its law (Smith 2018, without logarithm) [N]."""
        cells, (lmbda, mu) = self._job["cells"], self._lame
        positions = self.now.particle_q.numpy().astype(np.float64)
        F = np.einsum("cai,caj->cij", positions[cells], self._gradients)
        cofactor = np.cross(F[:, [1, 2, 0]], F[:, [2, 0, 1]])
        pressure = (lmbda + mu) * (np.linalg.det(F) - 1.0) - mu
        stress = mu * F + pressure[:, None, None] * cofactor
        force = np.array(self._job["external_force"])
        of_corners = np.einsum("c,cij,caj->cai", self._volumes, stress, self._gradients)
        np.subtract.at(force, cells, of_corners)
        return np.where(self.fixed, 0.0, force)

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """Lame's parameters: the solver converts them to those of its law by itself."""
        return mu, lmbda

    def make_solver(self, builder: Any) -> Any:
        """Sweeps go over points of one color at a time."""
        builder.color()
        self.model = builder.finalize(device="cpu")
        return newton.solvers.SolverVBD(
            self.model, iterations=ITERATIONS, particle_enable_self_contact=False
        )

    def choose_step(self, _job: dict[str, Any]) -> float:
        """The fixed step: any step is stable, but larger ones need more sweeps."""
        return TIME_STEP


class Steps(SemiImplicit):
    """Explicit steps; the law is not ours, so forces are not compared."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.device = str(job.get("device", self.device))
        super().__init__(job, float(job["time_step"]), gravity_of(job))

    def advance(self, num_steps: int) -> dict[str, Any]:
        """Take whole steps, and wait until they are done."""
        for _ in range(num_steps):
            self.step()
        wp.synchronize_device(self.model.device)
        return {"device": self.device}


class Rested(SoftMesh):
    """A body that is stepped until it rests."""

    scheme: tuple[str, dict[str, Any]]
    out_of_balance: Any = None  # a function without arguments, unless steps are explicit

    def __init__(self, job: dict[str, Any]) -> None:
        if str(job["strain"]) == "linear":
            raise ValueError("it knows no linear strain")
        super().__init__(job, self.choose_step(job), np.zeros(3))
        self.step(part=0.0)  # compiles the kernels
        self._velocity()[:] = 0.0

    def _velocity(self) -> Any:
        return self.now.particle_qd.numpy()

    def _displacement(self) -> Any:
        return self.now.particle_q.numpy().astype(np.float64) - self._job["points"]

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From the undeformed body to rest."""
        job = self._job
        applied = np.where(self.fixed, 0.0, job["external_force"]).astype(np.float32)
        num_steps, residual = relax_with_rise(
            lambda part: self.step(applied, part), self._moved, RISE, self._velocity,
            job["lumped_mass"][:, None] / self.time_step, force_scale(job), TOLERANCE, MOST_STEPS,
            self.out_of_balance,
        )  # fmt: skip
        require_rest(residual, TOLERANCE)
        self.result = {"displacement": self._displacement()}
        return {
            "method": f"time steps to rest by kinetic damping, {num_steps} steps, single precision",
            "relative_residual": residual,
            "time_step": self.time_step,
            **self.scheme[1],
        }


class Moved(Rested):
    """A body that is stepped from output to output."""

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job)
        self._force = np.where(self.fixed, 0.0, job["external_force"])
        self._resisting = job["mass_damping"] * job["lumped_mass"][:, None]
        self.now.particle_q.numpy()[:] = job["points"]
        velocity = job.get("initial_velocity")
        self._velocity()[:] = 0.0 if velocity is None else np.where(self.fixed, 0.0, velocity)

    def _step(self, time_step: float) -> None:
        self.time_step = time_step
        self.step((self._force - self._resisting * self._velocity()).astype(np.float32))

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From rest, or the initial velocity, to the end."""
        times, (integrator, more) = self._job["output_times"], self.scheme
        states, time_step = march(self._step, self._displacement, times, self.time_step)
        self.result = {"displacement": states, "times": times}
        scheme = {"integrator": integrator, "time_step": time_step}
        return {"method": "its own steps, single precision", **scheme, **more}


class Static(SemiImplicit, Rested):
    """A semi-implicit body, at rest."""


class Motion(SemiImplicit, Moved):
    """A semi-implicit body, in motion."""


class DescentStatic(BlockDescent, Rested):
    """By block descent, at rest."""


class DescentMotion(BlockDescent, Moved):
    """By block descent, in motion."""


if __name__ == "__main__":
    if "solver=vbd" in sys.argv:
        solve_case(DescentStatic, DescentMotion)
    else:
        solve_case(Static, Motion)
