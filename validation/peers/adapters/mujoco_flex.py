"""A MuJoCo flex: Saint-Venant-Kirchhoff, semi-implicit Euler; to rest by kinetic damping.

    palpate gate CASE --simulator "python mujoco_flex.py {case} {result}"

It knows motion alone; what does not come to rest has no answer. What is held, but not pinned, is
put back after each step: with a diagonal mass that is the same.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mechanics import force_scale, relax, require_rest, stable_step

LARGEST = 100_000  # cells; beyond, compiling the model does not end
TOLERANCE, ENOUGH, MOST_STEPS = 1e-7, 1e-6, 200_000
RISE = 2000  # steps over which what holds the body is moved to its place


class Flex:
    """One slide joint for each component of each free point."""

    version, precision = mujoco.__version__, "float64"

    def __init__(self, job: dict[str, Any], time_step: float, gravity: Any) -> None:
        points, cells = job["points"], job["cells"]
        if len(cells) > LARGEST:
            raise ValueError(f"models of more than {LARGEST} cells do not compile in minutes")

        def text(values: Any) -> str:
            return " ".join(f"{v:.17g}" for v in np.ravel(values))

        held = job["fixed"].all(axis=1) & ~job["prescribed_displacement"].any(axis=1)
        self.model = mujoco.MjModel.from_xml_string(
            f"""<mujoco>
            <option timestep="{time_step:.17g}" gravity="{text(gravity)}">
              <flag contact="disable" constraint="disable" autoreset="disable"/></option>
            <size memory="2G"/>
            <worldbody><flexcomp name="body" type="direct" dim="3" radius="1e-6"
                mass="{job["lumped_mass"].sum():.17g}"
                point="{text(points)}" element="{" ".join(map(str, cells.ravel()))}">
              <elasticity young="{job["youngs_modulus"][0]:.17g}"
                poisson="{job["poissons_ratio"][0]:.17g}"
                damping="{job.get("stiffness_damping", 0)}"/>
              <contact selfcollide="none" contype="0" conaffinity="0"/>
              <pin id="{text(np.flatnonzero(held))}"/></flexcomp></worldbody></mujoco>"""
        )
        self.data = mujoco.MjData(self.model)
        self.free = ~held

    def at_points(self, values: Any, at_held: float) -> Any:
        """Values of the free points as rows of all."""
        rows = np.full((len(self.free), 3), at_held)
        rows[self.free] = np.array(values).reshape(-1, 3)
        return rows


class Steps(Flex):
    """Whole steps."""

    def __init__(self, job: dict[str, Any]) -> None:
        gravity = job["external_force"].sum(axis=0) / job["lumped_mass"].sum()
        super().__init__(job, float(job["time_step"]), gravity)
        self.data.qpos[:] = job["test_displacement"][self.free].ravel()
        mujoco.mj_forward(self.model, self.data)
        self.answer = {"force": self.at_points(-self.data.qfrc_passive, np.nan)}
        mujoco.mj_resetData(self.model, self.data)

    def advance(self, num_steps: int) -> None:
        """Whole mj_step calls."""
        mujoco.mj_step(self.model, self.data, num_steps)


class Static(Flex):
    """Stepped until it rests, its mass spread evenly over its points."""

    tool = "MuJoCo flex"

    def __init__(self, job: dict[str, Any]) -> None:
        if str(job["strain"]) == "linear":
            raise ValueError("a flex knows Green strain only")
        mass = np.full(len(job["points"]), job["lumped_mass"].mean())
        super().__init__(job, 0.5 * stable_step(job, mass), np.zeros(3))
        self._inertia = mass[0] / self.model.opt.timestep
        self._held = job["fixed"][self.free].ravel() == 1
        self._moved = job["prescribed_displacement"][self.free].ravel()
        applied = job["external_force"][self.free].ravel()
        self.data.qfrc_applied[:] = np.where(self._held, 0.0, applied)
        self._scale = force_scale(job)

    def _step(self, share: float) -> None:
        """One step; what is held, but not pinned, is put where it belongs."""
        mujoco.mj_step(self.model, self.data)
        self.data.qpos[self._held] = share * self._moved[self._held]
        self.data.qvel[self._held] = 0.0

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From the undeformed body to rest."""
        rise = RISE if self._moved.any() else 0
        shares = iter(np.linspace(0.0, 1.0, rise) if rise else ())
        for tolerance, most in ((-1.0, rise), (TOLERANCE, MOST_STEPS)):
            num_steps, residual = relax(
                lambda: self._step(next(shares, 1.0)), lambda: self.data.qvel, self._inertia,
                self._scale, tolerance, most,
            )  # fmt: skip
        require_rest(residual, ENOUGH)
        self.answer = {"displacement": self.at_points(self.data.qpos, 0.0)}
        return {
            "method": f"time steps to rest by kinetic damping, {num_steps} steps",
            "relative_residual": residual,
            "time_step": self.model.opt.timestep,
        }


if __name__ == "__main__":
    from harness import answer_case

    answer_case(Static)
