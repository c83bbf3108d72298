"""Newton in motion, semi-implicit or by vertex block descent; else like newton_neo_hookean.py.

    palpate gate CASE --law neo-hookean-stable-log \
        --simulator "python newton_motion.py {case} {result}"

Mass damping, which its bodies do not have, is a force on the points, of the step before.
"""

from __future__ import annotations

from typing import Any

import newton_neo_hookean
import numpy as np
from mechanics import march


class Motion:
    """A resting body's class, stepped from output to output instead."""

    tool, laws = newton_neo_hookean.Static.tool, newton_neo_hookean.Static.laws

    def __init__(self, job: dict[str, Any], kind: Any = newton_neo_hookean.Static) -> None:
        self._body = body = kind(job)
        self.version, self.law = body.version, body.law
        self._job, mass = job, job["lumped_mass"][:, None]
        self._force = np.where(body.held, 0.0, job["external_force"])
        self._resisting = job["mass_damping"] * mass
        body.reset(job.get("initial_velocity"))

    def _step(self, time_step: float) -> None:
        self._body.time_step = time_step
        velocity = self._body.now.particle_qd.numpy()
        self._body.step((self._force - self._resisting * velocity).astype(np.float32))

    def _read(self) -> Any:
        return self._body.now.particle_q.numpy().astype(np.float64) - self._job["points"]

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From rest, or the initial velocity, to the end."""
        times = self._job["output_times"]
        states, time_step = march(self._step, self._read, times, self._body.time_step)
        self.answer = {"displacement": states, "times": times}
        scheme = {"integrator": "semi-implicit-euler", "time_step": time_step}
        return {"method": "its own steps, single precision", **scheme}


if __name__ == "__main__":
    from harness import answer_motion

    answer_motion(Motion)
