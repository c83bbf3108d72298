"""MuJoCo Warp (MJWarp): the flex of `mujoco_flex`, stepped on a device of Warp's, for timing alone.

As its documentation says: the model and its data are put on the device, and on a GPU a step is
captured as a graph once and launched after that. Single precision.
"""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco_warp
import warp as wp
from mujoco_flex import Flex


class Steps(Flex):  # type: ignore[misc]
    """Whole steps."""

    version, precision = f"{mujoco.__version__} (Warp {wp.__version__})", "float32"

    def __init__(self, job: dict[str, Any]) -> None:
        wp.config.log_level = wp.LOG_WARNING
        gravity = job["external_force"].sum(axis=0) / job["lumped_mass"].sum()
        super().__init__(job, float(job["time_step"]), gravity)
        # It never resets by itself, and refuses to be told so.
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        mujoco.mj_forward(self.model, self.data)
        self._device = str(job["device"])
        with wp.ScopedDevice(self._device):
            self._on_device = mujoco_warp.put_model(self.model)
            self._state = mujoco_warp.put_data(self.model, self.data)
            self._step()  # compiles
            self._graph = None
            if wp.get_device().is_cuda:
                with wp.ScopedCapture() as capture:
                    self._step()
                self._graph = capture.graph

    def _step(self) -> None:
        mujoco_warp.step(self._on_device, self._state)

    def advance(self, num_steps: int) -> dict[str, Any]:
        """Whole steps, to their end."""
        with wp.ScopedDevice(self._device):
            for _ in range(num_steps):
                if self._graph is None:
                    self._step()
                else:
                    wp.capture_launch(self._graph)
            wp.synchronize_device()
        return {"device": self._device}
