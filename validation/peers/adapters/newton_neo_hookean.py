"""Newton (Warp), semi-implicit: stable neo-Hookean with its logarithm; on the processor, to rest.

    palpate gate CASE --law neo-hookean-stable-log --simulator "python newton_neo_hookean.py ..."

Single precision. Asked for Saint-Venant-Kirchhoff it answers by its own law: what differs is the
model, not the solver. No follower pressure, tools, time or inclusions here.
"""

from __future__ import annotations

from typing import Any

import newton
import warp as wp
from mechanics import stable_step
from newton_soft import Rested, SoftMesh


class _SemiImplicit(SoftMesh):  # type: ignore[misc]
    device = "cpu"

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """Its energy's derivatives at rest are 3/4 k_mu and k_lambda - 5/8 k_mu (Smith 2018).

        Given Lame's parameters as they are, a body bends 41 % too far even where it is stiff.
        """
        return 4.0 / 3.0 * mu, lmbda + 5.0 / 6.0 * mu

    def make_solver(self, builder: Any) -> Any:
        """Neither triangles nor contacts: the tetrahedra and the update alone."""
        self.model = builder.finalize(device=self.device)
        self.model.particle_grid = None
        return newton.solvers.SolverSemiImplicit(self.model, enable_tri_contact=False)

    def choose_step(self, job: dict[str, Any]) -> float:
        """Half of what is stable, for a law that stiffens [s]."""
        return 0.5 * float(stable_step(job, job["lumped_mass"]))


class Steps(_SemiImplicit):
    """Its law is not ours, so forces are not compared."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.device = str(job.get("device", self.device))
        gravity = job["external_force"].sum(axis=0) / job["lumped_mass"].sum()
        super().__init__(job, float(job["time_step"]), gravity)

    def advance(self, num_steps: int) -> dict[str, Any]:
        """Whole steps, to their end."""
        for _ in range(num_steps):
            self.step()
        wp.synchronize_device(self.model.device)
        return {"device": self.device}


class Static(_SemiImplicit, Rested):  # type: ignore[misc]
    """Stepped until it rests."""

    tool = "Newton"
    laws = ("saint-venant-kirchhoff", "neo-hookean-stable-log")


if __name__ == "__main__":
    from harness import answer_case

    answer_case(Static)
