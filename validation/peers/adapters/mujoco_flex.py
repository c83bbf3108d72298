"""A MuJoCo flex: Saint-Venant-Kirchhoff, semi-implicit Euler; in motion, or to rest.

    palpate gate CASE --simulator "python mujoco_flex.py {case} {result}"

Checks of a motion on the same mesh also need `--integrator semi-implicit-euler --time-step DT` with
the step that its result states, which is its own stable one.

MuJoCo only computes motions: statics are brought to rest by kinetic damping, and a body that does
not come to rest has no result. Components that are fixed, but not pinned, are put back after each
step: with a diagonal mass that is equivalent. Mass damping is that of the slide joints, which the
Euler integrator takes implicitly; stiffness damping is the flex's own, on the rate of its edges'
squares, and so of Green strain. A flex spreads its mass evenly over its points.

Tools are balls without friction (mujoco_balls.py). Contact is MuJoCo's own, soft and at the nearest
point of each outer tetrahedron; `penetration` states by how much a ball sinks in [m].

`turned=60` puts the flex into a body that is turned by 60 degrees about (1, 2, 2), and its points
turned back in that body: the same problem. The joints then move along the axes of that body.

`Steps` on a device are those of MuJoCo Warp (MJWarp), for timing alone. As its documentation says,
the model and its data are put on the device, and on a GPU a step is captured as a graph once and
launched after that. It computes in single precision.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from harness import Stepped, gravity_of, require_fixed_points, solve_case, stable_step
from mujoco_balls import OFF, SOLVER, Balls, balls, contact

LARGEST = 100_000  # cells; with more, compiling the model does not end


class Flex:
    """One slide joint for each component of each free point."""

    tool, version, precision = "MuJoCo flex", mujoco.__version__, "float64"

    def __init__(self, job: dict[str, Any], time_step: float, gravity: Any) -> None:
        cells = job["cells"]
        quaternion, self.turn = turned(float(job.get("turned", 0.0)))
        points = job["points"] @ self.turn  # R^T x of each
        if len(cells) > LARGEST:
            raise ValueError(f"models of more than {LARGEST} cells do not compile in minutes")

        def text(values: Any) -> str:
            return " ".join(f"{v:.17g}" for v in np.ravel(values))

        tools = job.get("tools", ())
        touches = f'conaffinity="{len(tools[:1])}"'
        pinned = job["fixed"].all(axis=1) & ~job["prescribed_displacement"].any(axis=1)
        self.model = mujoco.MjModel.from_xml_string(
            f"""<mujoco>
            <option timestep="{time_step:.17g}" gravity="{text(gravity)}" {SOLVER}>
              <flag {"" if tools else OFF} autoreset="disable"/></option>
            <size memory="2G"/>
            <worldbody>{balls(tools, time_step)}<body name="turned" quat="{text(quaternion)}">
              <flexcomp name="body" type="direct" dim="3" radius="1e-6"
                mass="{job["lumped_mass"].sum():.17g}"
                point="{text(points)}" element="{" ".join(map(str, cells.ravel()))}">
              <elasticity young="{job["youngs_modulus"][0]:.17g}"
                poisson="{job["poissons_ratio"][0]:.17g}"
                damping="{job.get("stiffness_damping", 0)}"/>
              <contact selfcollide="none" contype="0" {touches} {contact(time_step)}/>
              <pin id="{text(np.flatnonzero(pinned))}"/></flexcomp></body></worldbody></mujoco>"""
        )
        self.data = mujoco.MjData(self.model)
        self.free = ~pinned

    def at_points(self, values: Any, at_pinned: float) -> Any:
        """Values of the free points as rows of all points."""
        rows = np.full((len(self.free), 3), at_pinned)
        rows[self.free] = np.array(values).reshape(-1, 3) @ self.turn.T
        return rows


def turned(degrees: float) -> tuple[Any, Any]:
    """Quaternion and matrix of a turn about (1, 2, 2)."""
    axis, half = np.array([1.0, 2.0, 2.0]) / 3.0, 0.5 * np.deg2rad(degrees)
    w, v = np.cos(half), np.sin(half) * axis
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.array([w, *v]), np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


class Steps(Flex):
    """Whole steps."""

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job, float(job["time_step"]), gravity_of(job))
        self._device = str(job.get("device", ""))
        if self._device:
            self._put_on_device()
            return
        self.data.qpos[:] = job["test_displacement"][self.free].ravel()
        mujoco.mj_forward(self.model, self.data)
        self.result = {"force": self.at_points(-self.data.qfrc_passive, np.nan)}
        mujoco.mj_resetData(self.model, self.data)

    def _put_on_device(self) -> None:
        import mujoco_warp
        import warp as wp

        wp.config.log_level = wp.LOG_WARNING
        self.version, self.precision = f"{mujoco.__version__} (Warp {wp.__version__})", "float32"
        # MJWarp never resets by itself, and rejects the option that says so.
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        mujoco.mj_forward(self.model, self.data)
        self._warp, self._mujoco_warp = wp, mujoco_warp
        with wp.ScopedDevice(self._device):
            self._on_device = mujoco_warp.put_model(self.model)
            self._state = mujoco_warp.put_data(self.model, self.data)
            self._launch()  # compiles
            self._graph = None
            if wp.get_device().is_cuda:
                with wp.ScopedCapture() as capture:
                    self._launch()
                self._graph = capture.graph

    def _launch(self) -> None:
        self._mujoco_warp.step(self._on_device, self._state)

    def advance(self, num_steps: int) -> dict[str, Any]:
        """Call mj_step; on a device, until the steps are done."""
        if not self._device:
            mujoco.mj_step(self.model, self.data, num_steps)
            return {}
        wp = self._warp
        with wp.ScopedDevice(self._device):
            for _ in range(num_steps):
                if self._graph is None:
                    self._launch()
                else:
                    wp.capture_launch(self._graph)
            wp.synchronize_device()
        return {"device": self._device}


class Loaded(Flex, Stepped):  # type: ignore[misc]
    """A flex with forces on its free points, and with fixed components among them."""

    takes, shapes = ("stiffness damping",), ("SphereShape",)

    def __init__(self, job: dict[str, Any]) -> None:
        if str(job["strain"]) == "linear":
            raise ValueError("a flex knows Green strain only")
        if "turned" in job:
            require_fixed_points(job)  # components are those of the turned body
        self.job = job
        mass = np.full(len(job["points"]), job["lumped_mass"].mean())
        # Undamped motions take half of the stable step, for a law that stiffens.
        beta, longest = float(job.get("stiffness_damping", 0.0)), stable_step(job, mass)
        self.time_step = 0.5 * (np.hypot(longest, beta) - beta)
        super().__init__(job, self.time_step, np.zeros(3))
        self.inertia = mass[0] / self.time_step
        self._fixed = job["fixed"][self.free].ravel() == 1
        self.balls = None
        if "tools" in job:
            self.remark = "; contact at the nearest point of each outer tetrahedron"
            self.balls = Balls(job, self.model, self.data, self._fixed)
        self._moved = job["prescribed_displacement"][self.free].ravel()[self._fixed]
        applied = (job["external_force"] @ self.turn)[self.free].ravel()
        self.data.qfrc_applied[:] = np.where(self._fixed, 0.0, applied)
        self.model.dof_damping[:] = job.get("mass_damping", 0.0) * mass[0]
        if "initial_velocity" in job:
            velocity = (job["initial_velocity"] @ self.turn)[self.free].ravel()
            self.data.qvel[:] = np.where(self._fixed, 0.0, velocity)

    def step(self, part: float = 1.0) -> None:
        """Take a step; components that are fixed, but not pinned, are put back."""
        self.model.opt.timestep = self.time_step
        if self.balls is None:
            mujoco.mj_step(self.model, self.data)
        else:
            self.balls.step(part)
        self.data.qpos[self._fixed] = part * self._moved
        self.data.qvel[self._fixed] = 0.0

    def advance(self, num_steps: int) -> dict[str, Any]:
        """As others do, and what is found of the tools."""
        says: dict[str, Any] = super().advance(num_steps)
        return says if self.balls is None else says | self.balls.found()

    def velocity(self) -> Any:
        """Velocities of the free points' components."""
        return self.data.qvel

    def displacement(self) -> Any:
        """Displacement of all points."""
        return self.at_points(self.data.qpos, 0.0)


if __name__ == "__main__":
    solve_case(Loaded, Loaded)
