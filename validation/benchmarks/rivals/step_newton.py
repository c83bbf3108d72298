"""Explicit steps of Newton's semi-implicit solver, on the processor by Warp."""

from __future__ import annotations

from typing import Any

import newton
import warp as wp


class Rival:
    """Neo-Hookean by its own choice, so forces are not compared."""

    tool, precision, force = "newton", "float32", None
    version = f"{newton.__version__} (warp {wp.__version__})"

    def __init__(self, body: dict[str, Any]) -> None:
        wp.config.quiet = True
        wp.init()
        E, nu = float(body["youngs_modulus"]), float(body["poissons_ratio"])
        density = float(body["density"])
        gravity = body["external_force"].sum(axis=0) / body["lumped_mass"].sum()
        builder = newton.ModelBuilder(gravity=tuple(map(float, gravity)))
        builder.add_soft_mesh(
            pos=(0.0, 0.0, 0.0),
            rot=wp.quat_identity(),
            scale=1.0,
            vel=(0.0, 0.0, 0.0),
            vertices=[tuple(map(float, p)) for p in body["points"]],
            indices=body["cells"].ravel().tolist(),
            density=density,
            k_mu=E / (2.0 * (1.0 + nu)),
            k_lambda=E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
            k_damp=0.0,
            add_surface_mesh_edges=False,
        )
        for i in body["held"].tolist():
            builder.particle_mass[i] = 0.0
        self._model = builder.finalize(device="cpu")
        # Neither triangles nor contacts: the tetrahedra and the update alone.
        self._model.particle_grid = None
        self._solver = newton.solvers.SolverSemiImplicit(self._model, enable_tri_contact=False)
        self._now, self._next = self._model.state(), self._model.state()
        self._control = self._model.control()
        self._dt = float(body["time_step"])
        self.advance(2)

    def advance(self, num_steps: int) -> None:
        """Whole steps."""
        for _ in range(num_steps):
            self._now.clear_forces()
            self._solver.step(self._now, self._next, self._control, None, self._dt)
            self._now, self._next = self._next, self._now


def prepare(body: dict[str, Any]) -> Rival:
    """Build the model and its kernels."""
    return Rival(body)
