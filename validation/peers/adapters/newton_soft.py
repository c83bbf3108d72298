"""Newton (Warp) on the processor: soft bodies of stable neo-Hookean laws, in motion or to rest.

    palpate gate CASE --law neo-hookean-stable-log \
        --simulator "python newton_soft.py {case} {result}"
    palpate gate CASE --law neo-hookean-stable \
        --simulator "python newton_soft.py {case} {result} solver=vbd"   (or solver=xpbd)

It steps semi-implicitly, or by vertex block descent: implicit Euler, each step by sweeps of block
descent; or by XPBD, with the semi-implicit solver's step, at which its compliant constraints are
solved to the end by few sweeps. `constants=lame` hands k_mu and k_lambda to the semi-implicit
solver as its documentation names them, which are not those of its law. With too few sweeps a stiff
body creeps at a velocity that hardly changes, wherever it is: so it counts as at rest where the
forces of its law, computed here at its positions in double precision, balance the load. Positions
in single precision may be too coarse for that: rounding those of a slender beam leaves some per
cent of its load. A body that does not get there has no result. For Saint-Venant-Kirchhoff it solves
its own law: the difference is one of model, not of solver. Its bodies have no mass damping: that is
a force on the points, from the previous step.
"""

from __future__ import annotations

import inspect
import sys
from abc import abstractmethod
from typing import Any

import numpy as np
import warp as wp
from harness import (
    Stepped,
    all_gradients,
    gravity_of,
    lame,
    require_fixed_points,
    solve_case,
    stable_step,
)

if not hasattr(wp.config, "verbose"):
    wp.config.verbose = False  # Newton before 1.3 reads it, and newer Warp has none
import newton

ITERATIONS = 10  # sweeps of block descent: Newton's default


class SoftMesh(Stepped):  # type: ignore[misc]
    """A soft body with supports and loads; a subclass chooses the solver that steps it."""

    model: Any
    device, law = "cpu", "neo-Hookean"
    version, precision = f"{newton.__version__} (Warp {wp.__version__})", "float32"
    tolerance = enough = 1e-3  # single precision carries no more
    most_steps, remark = 40_000, ", single precision"
    _force: Any = None

    def __init__(self, job: dict[str, Any]) -> None:
        if str(job["strain"]) == "linear":
            raise ValueError("it knows no linear strain")
        self.build(job, np.zeros(3))
        self.step(part=0.0)  # compiles the kernels
        self.now.particle_q.numpy()[:] = job["points"]
        self.velocity()[:] = np.where(self.fixed, 0.0, job.get("initial_velocity", 0.0))
        self._force = np.where(self.fixed, 0.0, job["external_force"])
        mass = job["lumped_mass"][:, None]
        self._resisting = job.get("mass_damping", 0.0) * mass
        self.inertia = mass / self.time_step

    def build(self, job: dict[str, Any], gravity: Any) -> None:
        """Make the model and its solver."""
        if hasattr(wp, "LOG_WARNING"):  # Warp before 1.13 has `quiet` instead
            wp.config.log_level = wp.LOG_WARNING
        else:
            wp.config.quiet = True
        wp.init()
        self.job = job
        k_mu, k_lambda = self.constants(*lame(job))
        builder = newton.ModelBuilder(**_gravity(gravity))
        # Newton 0 and 1.0 do not know every argument.
        known = inspect.signature(builder.add_soft_mesh).parameters
        edges = {name: False for name in ("add_surface_mesh_edges",) if name in known}
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
            **edges,
        )
        self.fixed = job["fixed"].astype(bool)
        self._rest, self._moved = job["points"], job["prescribed_displacement"]
        for index in np.flatnonzero(self.fixed.all(axis=1)).tolist():
            builder.particle_mass[index] = 0.0
        self._solver = self.make_solver(builder)
        self.now, self._next = self.model.state(), self.model.state()
        self._control = self.model.control()

    @abstractmethod
    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """k_mu and k_lambda of a body with Lame's parameters at rest [Pa]."""

    @abstractmethod
    def make_solver(self, builder: Any) -> Any:
        """Finalize the model as `self.model`, and return its solver."""

    def step(self, part: float = 1.0) -> None:
        """Take a step; what is fixed is put where it belongs."""
        self.now.clear_forces()
        if self._force is not None:
            resisted = self._force - self._resisting * self.velocity()
            self.now.particle_f.numpy()[:] = resisted.astype(np.float32)
        self._solver.step(self.now, self._next, self._control, None, self.time_step)
        self.now, self._next = self._next, self.now
        self.now.particle_q.numpy()[self.fixed] = (self._rest + part * self._moved)[self.fixed]
        self.velocity()[self.fixed] = 0.0

    def velocity(self) -> Any:
        """Velocities of the points."""
        return self.now.particle_qd.numpy()

    def displacement(self) -> Any:
        """Displacement of the points in double precision."""
        return self.now.particle_q.numpy().astype(np.float64) - self._rest


class SemiImplicit(SoftMesh):
    """A body of the stable neo-Hookean law with its logarithm, stepped semi-implicitly."""

    tool, laws = "Newton", ("saint-venant-kirchhoff", "neo-hookean-stable-log")

    def __init__(self, job: dict[str, Any]) -> None:
        # Half of the stable step, for a law that stiffens.
        self.time_step = 0.5 * float(stable_step(job, job["lumped_mass"]))
        super().__init__(job)

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """Its energy's derivatives at rest are 3/4 k_mu and k_lambda - 5/8 k_mu (Smith 2018).

        Given Lame's parameters as they are, a body bends 41 % too far even where it is stiff.
        """
        if self.job.get("constants") == "lame":
            return mu, lmbda
        return 4.0 / 3.0 * mu, lmbda + 5.0 / 6.0 * mu

    def make_solver(self, builder: Any) -> Any:
        """Step without triangles and contacts: only the tetrahedra and the update."""
        self.model = builder.finalize(device=self.device)
        self.model.particle_grid = None
        return newton.solvers.SolverSemiImplicit(self.model, enable_tri_contact=False)


class BlockDescent(SoftMesh):
    """A body of the stable neo-Hookean law, stepped by sweeps of block descent."""

    tool, laws = "Newton VBD", ("saint-venant-kirchhoff", "neo-hookean-stable")
    integrator, about = "backward-euler", {"iterations_per_step": ITERATIONS}
    # 60 frames of 10 steps each second: any is stable, but larger ones need more sweeps.
    time_step = 1.0 / 600.0

    def __init__(self, job: dict[str, Any]) -> None:
        require_fixed_points(job)  # a component that is put back after a step is free in the sweeps
        self._lame, (self._gradients, self._volumes) = lame(job), all_gradients(job)
        super().__init__(job)

    def out_of_balance(self) -> Any:
        """Residual of the load and the forces of its law (Smith 2018, without logarithm) [N]."""
        cells, (lmbda, mu) = self.job["cells"], self._lame
        positions = self.now.particle_q.numpy().astype(np.float64)
        F = np.einsum("cai,caj->cij", positions[cells], self._gradients)
        cofactor = np.cross(F[:, [1, 2, 0]], F[:, [2, 0, 1]])
        pressure = (lmbda + mu) * (np.linalg.det(F) - 1.0) - mu
        stress = mu * F + pressure[:, None, None] * cofactor
        force = np.array(self.job["external_force"])
        of_corners = np.einsum("c,cij,caj->cai", self._volumes, stress, self._gradients)
        np.subtract.at(force, cells, of_corners)
        return np.where(self.fixed, 0.0, force)

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """Lame's parameters: the solver converts them to those of its law by itself.

        Not in 1.0.0: `constants=smith` hands it those of its law.
        """
        return (mu, lmbda + mu) if self.job.get("constants") == "smith" else (mu, lmbda)

    def make_solver(self, builder: Any) -> Any:
        """Sweeps go over points of one color at a time."""
        builder.color()
        self.model = builder.finalize(device="cpu")
        return newton.solvers.SolverVBD(
            self.model, iterations=ITERATIONS, particle_enable_self_contact=False
        )


class PositionBased(SemiImplicit):
    """A body of two compliant constraints for each cell, of k_mu and k_lambda."""

    tool, laws = "Newton XPBD", ("saint-venant-kirchhoff", "neo-hookean-stable")

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """Lame's parameters, which its documentation says that they are."""
        return mu, lmbda

    def make_solver(self, builder: Any) -> Any:
        """Without contacts, its iterations and relaxation as they are by default."""
        self.model = builder.finalize(device=self.device)
        # No contact of points with one another.
        self.model.particle_grid, self.model.particle_max_radius = None, 0.0
        return newton.solvers.SolverXPBD(self.model)


def _gravity(vector: Any) -> dict[str, Any]:
    """The argument of ModelBuilder: a number along its axis up in Newton before 1.6."""
    default = inspect.signature(newton.ModelBuilder).parameters["gravity"].default
    if isinstance(default, float):
        if np.any(vector):
            raise ValueError("this version takes gravity along one axis alone")
        return {"gravity": 0.0}
    return {"gravity": tuple(map(float, vector))}


class Steps(SemiImplicit):
    """Explicit steps; the law is not ours, so forces are not compared."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.device, self.time_step = str(job.get("device", self.device)), float(job["time_step"])
        self.build(job, gravity_of(job))

    def advance(self, num_steps: int) -> dict[str, Any]:
        """Take whole steps, and wait until they are done."""
        for _ in range(num_steps):
            self.step()
        wp.synchronize_device(self.model.device)
        return {"device": self.device}


if __name__ == "__main__":
    solvers = {"solver=vbd": BlockDescent, "solver=xpbd": PositionBased}
    body = next((solvers[word] for word in sys.argv if word in solvers), SemiImplicit)
    solve_case(body, body)
