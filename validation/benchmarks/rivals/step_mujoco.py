"""Explicit steps of a MuJoCo flex: whole mj_step calls."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

LARGEST = 100_000  # cells; beyond, compiling the model does not end


class Rival:
    """StVK, as ours; semi-implicit Euler, one slide joint a component."""

    tool, version, precision = "mujoco", mujoco.__version__, "float64"

    def __init__(self, body: dict[str, Any]) -> None:
        points, cells = body["points"], body["cells"]
        if len(cells) > LARGEST:
            raise ValueError(f"models of more than {LARGEST} cells do not compile in minutes")

        def text(values: Any) -> str:
            return " ".join(f"{v:.17g}" for v in np.ravel(values))

        gravity = body["external_force"].sum(axis=0) / body["lumped_mass"].sum()
        self._model = mujoco.MjModel.from_xml_string(
            f"""<mujoco>
            <option timestep="{float(body["time_step"]):.17g}" gravity="{text(gravity)}">
              <flag contact="disable" constraint="disable" energy="disable"/></option>
            <size memory="2G"/>
            <worldbody><flexcomp name="body" type="direct" dim="3" radius="1e-6"
                mass="{float(body["lumped_mass"].sum()):.17g}"
                point="{text(points)}" element="{" ".join(map(str, cells.ravel()))}">
              <elasticity young="{float(body["youngs_modulus"]):.17g}"
                poisson="{float(body["poissons_ratio"]):.17g}" damping="0"/>
              <contact selfcollide="none" contype="0" conaffinity="0"/>
              <pin id="{" ".join(map(str, body["held"]))}"/>
            </flexcomp></worldbody></mujoco>"""
        )
        self._data = mujoco.MjData(self._model)
        free = np.ones(len(points), bool)
        free[body["held"]] = False
        self._data.qpos[:] = body["test_displacement"][free].ravel()
        mujoco.mj_forward(self._model, self._data)
        self.force = np.full(points.shape, np.nan)  # not known at held points
        self.force[free] = -np.array(self._data.qfrc_passive).reshape(-1, 3)
        mujoco.mj_resetData(self._model, self._data)

    def advance(self, num_steps: int) -> None:
        """Whole steps."""
        mujoco.mj_step(self._model, self._data, num_steps)


def prepare(body: dict[str, Any]) -> Rival:
    """Compile the model."""
    return Rival(body)
