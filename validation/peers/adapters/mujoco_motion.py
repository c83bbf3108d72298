"""A MuJoCo flex in motion: Saint-Venant-Kirchhoff, semi-implicit Euler; else like mujoco_flex.py.

    palpate gate CASE --simulator "python mujoco_motion.py {case} {result}"

Mass damping is the damping of its slide joints, which its Euler integrator takes implicitly;
stiffness damping is the flex's own, on the rate of its edges' squares, and so of Green strain.
A flex spreads its mass evenly over its points.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mechanics import march, stable_step
from mujoco_flex import Flex


class Motion(Flex):  # type: ignore[misc]
    """Stepped from output to output."""

    tool = "MuJoCo flex"
    has_stiffness_damping = True

    def __init__(self, job: dict[str, Any]) -> None:
        if str(job["strain"]) == "linear":
            raise ValueError("a flex knows Green strain only")
        mass = np.full(len(job["points"]), job["lumped_mass"].mean())
        beta, longest = job["stiffness_damping"], stable_step(job, mass)
        super().__init__(job, 0.5 * (np.hypot(longest, beta) - beta), np.zeros(3))
        self.model.dof_damping[:] = job["mass_damping"] * mass[0]
        held = job["fixed"][self.free].ravel() == 1
        self.data.qfrc_applied[:] = np.where(held, 0.0, job["external_force"][self.free].ravel())
        if "initial_velocity" in job:
            self.data.qvel[:] = np.where(held, 0.0, job["initial_velocity"][self.free].ravel())
        self._held, self._times = held, job["output_times"]

    def _step(self, time_step: float) -> None:
        """What is held, but not pinned, is put back."""
        self.model.opt.timestep = time_step
        mujoco.mj_step(self.model, self.data)
        self.data.qpos[self._held] = self.data.qvel[self._held] = 0.0

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From rest, or the initial velocity, to the end."""
        states, time_step = march(
            self._step, lambda: self.at_points(self.data.qpos, 0.0), self._times,
            self.model.opt.timestep,
        )  # fmt: skip
        self.answer = {"displacement": states, "times": self._times}
        scheme = {"integrator": "semi-implicit-euler", "time_step": time_step}
        return {"method": "semi-implicit Euler", **scheme}


if __name__ == "__main__":
    from harness import answer_motion

    answer_motion(Motion)
