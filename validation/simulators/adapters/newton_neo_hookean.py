"""Newton (Warp) on the processor: neo-Hookean by its own choice, single precision; to rest.

    palpate gate CASE --simulator "python newton_neo_hookean.py {case} {result}"

Another law than Saint-Venant-Kirchhoff: what it differs by is the model, not the solver. Whole
points held where they are; no follower pressure, tools, time or inclusions here.
"""

from __future__ import annotations

from typing import Any

import newton
import numpy as np
import warp as wp
from mechanics import held_points, lame, relax, stable_step

# Single precision carries no more.
TOLERANCE = 1e-3
MOST_STEPS = 40_000


class _SoftMesh:
    """Its semi-implicit solver."""

    version, precision = f"{newton.__version__} (Warp {wp.__version__})", "float32"

    def __init__(self, job: dict[str, Any], time_step: float, gravity: Any) -> None:
        wp.config.quiet = True
        wp.init()
        lmbda, mu = lame(job)
        # Its energy's derivatives at rest are 3/4 k_mu and k_lambda - 5/8 k_mu (Smith, de Goes and
        # Kim 2018): given Lamé's parameters as they are, a body bends 41 % too far even where it
        # is stiff.
        builder = newton.ModelBuilder(gravity=tuple(map(float, gravity)))
        builder.add_soft_mesh(
            pos=(0.0, 0.0, 0.0),
            rot=wp.quat_identity(),
            scale=1.0,
            vel=(0.0, 0.0, 0.0),
            vertices=[tuple(map(float, p)) for p in job["points"]],
            indices=job["cells"].ravel().tolist(),
            density=float(job["density"][0]),
            k_mu=4.0 / 3.0 * mu,
            k_lambda=lmbda + 5.0 / 6.0 * mu,
            k_damp=0.0,
            add_surface_mesh_edges=False,
        )
        held = held_points(job)
        for index in np.flatnonzero(held).tolist():
            builder.particle_mass[index] = 0.0
        model = builder.finalize(device="cpu")
        # Neither triangles nor contacts: the tetrahedra and the update alone.
        model.particle_grid = None
        self._solver = newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)
        self._states = [model.state(), model.state()]
        self._control = model.control()
        self._time_step = time_step
        self.free = ~held

    @property
    def now(self) -> Any:
        """The present state."""
        return self._states[0]

    def step(self, applied: Any = None) -> None:
        """One step, with forces on the points where given."""
        self.now.clear_forces()
        if applied is not None:
            self.now.particle_f.numpy()[:] = applied
        self._solver.step(*self._states, self._control, None, self._time_step)
        self._states.reverse()


class Steps(_SoftMesh):
    """Its law is not ours, so forces are not compared."""

    def __init__(self, job: dict[str, Any]) -> None:
        gravity = job["external_force"].sum(axis=0) / job["lumped_mass"].sum()
        super().__init__(job, float(job["time_step"]), gravity)

    def advance(self, num_steps: int) -> None:
        """Whole steps."""
        for _ in range(num_steps):
            self.step()


class Static(_SoftMesh):
    """Stepped until it rests."""

    tool, law = "Newton", "neo-Hookean"

    def __init__(self, job: dict[str, Any]) -> None:
        self._job = job
        super().__init__(job, 0.5 * stable_step(job, job["lumped_mass"]), np.zeros(3))
        self.step()  # compiles the kernels
        self._velocity()[:] = 0.0

    def _velocity(self) -> Any:
        return self.now.particle_qd.numpy()

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From the undeformed body to rest."""
        applied = np.where(self.free[:, None], self._job["external_force"], 0.0).astype(np.float32)
        inertia = self._job["lumped_mass"][:, None] / self._time_step
        num_steps, residual = relax(
            lambda: self.step(applied), self._velocity, inertia, applied, TOLERANCE, MOST_STEPS
        )
        places = self.now.particle_q.numpy().astype(np.float64)
        self.answer = {"displacement": places - self._job["points"]}
        return {
            "method": f"time steps to rest by kinetic damping, {num_steps} steps, single precision",
            "relative_residual": residual,
        }


if __name__ == "__main__":
    from harness import answer_case

    answer_case(Static)
