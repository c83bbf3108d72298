"""Balls that touch a flex of MuJoCo: spheres of mocap bodies, and what their contacts carry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from harness import place_of

OFF = 'contact="disable" constraint="disable"'
SOLVER = 'solver="Newton" tolerance="1e-14" ccd_tolerance="1e-10"'
# Impedance 0.9999 (mjMAXIMP) at every depth: what a body at rest sinks in is 1e-4 of what the
# force would move the points in a time constant.
_STIFFEST = "0.9999 0.9999 0.001 0.5 2"
_IMMOVABLE = 1e5  # times the mass of a point; at 1e9 the solver loses digits


def contact(time_step: float) -> str:
    """Attributes of contact, of both sides: the shortest time constant that refsafe lets by."""
    return f'condim="1" solref="{2.0 * time_step:.17g} 1" solimp="{_STIFFEST}"'


def balls(tools: Sequence[dict[str, Any]], time_step: float) -> str:
    """The bodies of the tools, as XML."""
    sizes = [f'type="sphere" size="{tool["shape"]["radius"]:.17g}"' for tool in tools]
    each = contact(time_step)
    return "".join(f'<body mocap="true"><geom {size} {each}/></body>' for size in sizes)


class Balls:
    """The tools of a job on their paths."""

    def __init__(self, job: dict[str, Any], model: Any, data: Any, fixed: Any) -> None:
        """`fixed` are joints that contact may not move, either, (num_joints,)."""
        self._tools, self._outputs = job["tools"], job.get("output_times")
        self._model, self._data = model, data
        self._carried: list[Any] = []  # in each step of a motion
        model.dof_M0[fixed] *= _IMMOVABLE

    def step(self, part: float) -> None:
        """Take a step, in statics with the tools at this fraction of their paths."""
        for number, tool in enumerate(self._tools):
            first, last = (tool["path"]["times"][k] for k in (0, -1))
            at_rest = first + part * (last - first)
            then = at_rest if self._outputs is None else self._data.time
            self._data.mocap_pos[number] = place_of(tool, then)
        mujoco.mj_step(self._model, self._data)
        if self._outputs is not None:
            self._carried.append(self.forces())

    def found(self) -> dict[str, Any]:
        """What the contacts carry: at rest, or means in motion; and how deep the tools sank in."""
        mujoco.mj_forward(self._model, self._data)
        depth = max([0.0, *(-self._data.contact.dist)])
        forces = self.forces() if self._outputs is None else self._means(self._outputs)
        return {"tool_forces": forces.tolist(), "penetration": depth}

    def _means(self, outputs: Any) -> Any:
        """Mean forces since the output before, also where steps do not divide the outputs [N].

        (num_tools, num_outputs, 3), the first of them 0.
        """
        carried = np.array(self._carried).reshape(len(self._carried), -1)
        impulse = np.vstack([np.zeros(carried.shape[1]), carried.cumsum(axis=0)])
        steps = np.array(outputs) / self._model.opt.timestep
        at = [np.interp(steps, np.arange(len(impulse)), column) for column in impulse.T]
        means = np.diff(at, axis=1, prepend=0.0) / np.diff(steps, prepend=-1.0)
        return means.reshape(len(self._tools), 3, -1).transpose(0, 2, 1)

    def forces(self) -> Any:
        """Force on each tool [N], (num_tools, 3): the sum over its contacts, in the world's frame.

        A contact's first axis goes from its first geom to its second, and what mj_contactForce
        returns acts on the second.
        """
        forces, carried = np.zeros((len(self._tools), 3)), np.zeros(6)
        for number in range(self._data.ncon):
            one = self._data.contact[number]
            mujoco.mj_contactForce(self._model, self._data, number, carried)
            on_second = one.frame.reshape(3, 3).T @ carried[:3]
            is_first = one.geom[0] >= 0
            forces[max(one.geom)] += -on_second if is_first else on_second
        return forces
