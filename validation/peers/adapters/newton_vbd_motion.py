"""Newton in motion by vertex block descent; else like newton_motion.py.

palpate gate CASE --law neo-hookean-stable --simulator "python newton_vbd_motion.py {case} {result}"
"""

from __future__ import annotations

from typing import Any

import newton_motion
import newton_vbd


class Motion(newton_motion.Motion):  # type: ignore[misc]
    """Implicit Euler, as far as its sweeps get."""

    tool, laws = newton_vbd.Static.tool, newton_vbd.Static.laws

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job, newton_vbd.Static)

    def advance(self, num_steps: int) -> dict[str, Any]:
        """From rest, or the initial velocity, to the end."""
        says: dict[str, Any] = super().advance(num_steps)
        scheme = {"integrator": "backward-euler"}
        return {**says, **scheme, "iterations_per_step": newton_vbd.ITERATIONS}


if __name__ == "__main__":
    from harness import answer_motion

    answer_motion(Motion)
