"""Newton (Warp) on the processor, vertex block descent: stable neo-Hookean; to rest.

    palpate gate CASE --law neo-hookean-stable --simulator "python newton_vbd.py {case} {result}"

Implicit Euler, each step by sweeps of block descent. Too few of them let a stiff body creep at a
velocity that hardly changes, wherever it is: so it rests where the forces of its law, computed here
at its places in double precision, balance the load. Places in single precision may be too coarse
for that: those of a slender beam, rounded, leave some per cent of its load. Who does not get there
has no answer. Else like newton_neo_hookean.py.
"""

from __future__ import annotations

from typing import Any

import newton
import numpy as np
from mechanics import held_points, lame, rest_shape
from newton_soft import Rested

ITERATIONS = 10  # its default
TIME_STEP = 1.0 / 600.0  # 60 frames of 10 steps each


class Static(Rested):  # type: ignore[misc]
    """Stepped until it rests."""

    tool = "Newton VBD"

    def __init__(self, job: dict[str, Any]) -> None:
        held_points(job)  # a component that is put back after a step was free in its sweeps
        self._lame, (inner, self._volumes) = lame(job), rest_shape(job)
        self._gradients = np.concatenate([-inner.sum(axis=1)[:, None], inner], axis=1)
        super().__init__(job)

    def out_of_balance(self) -> Any:
        """Forces of the load and of its law (Smith 2018, without the logarithm) [N]."""
        cells, (lmbda, mu) = self._job["cells"], self._lame
        places = self.now.particle_q.numpy().astype(np.float64)
        F = np.einsum("cai,caj->cij", places[cells], self._gradients)
        cofactor = np.cross(F[:, [1, 2, 0]], F[:, [2, 0, 1]])
        pressure = (lmbda + mu) * (np.linalg.det(F) - 1.0) - mu
        stress = mu * F + pressure[:, None, None] * cofactor
        force = np.array(self._job["external_force"])
        of_corners = np.einsum("c,cij,caj->cai", self._volumes, stress, self._gradients)
        np.subtract.at(force, cells, of_corners)
        return np.where(self.held, 0.0, force)

    def constants(self, lmbda: float, mu: float) -> tuple[float, float]:
        """Lame's parameters: the solver makes its law's own of them by itself."""
        return mu, lmbda

    def make_solver(self, builder: Any) -> Any:
        """Sweeps go over points of one color at a time."""
        builder.color()
        self.model = builder.finalize(device="cpu")
        return newton.solvers.SolverVBD(
            self.model, iterations=ITERATIONS, particle_enable_self_contact=False
        )

    def choose_step(self, _job: dict[str, Any]) -> float:
        """Stable at any step; larger ones need more sweeps."""
        return TIME_STEP

    def advance(self, num_steps: int) -> dict[str, Any]:
        """From the undeformed body to rest."""
        says: dict[str, Any] = super().advance(num_steps)
        return {**says, "iterations_per_step": ITERATIONS}


if __name__ == "__main__":
    from harness import answer_case

    answer_case(Static)
