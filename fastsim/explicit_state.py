"""The present state of a body in explicit motion: read from its run when somebody asks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.contact.explicit_tools import TOOL_STEP
from palpate.fastsim.explicit_diagnosis import diagnose
from palpate.fastsim.explicit_run import ExplicitRun
from palpate.meshes.arrays import Floats, Points


class ExplicitState:
    """Of one run.

    Args:
        elastic: The body at rest.
        mass: Lumped [kg], shape (num_points,).
        run: What makes the steps.
        time_step: [s].

    Attributes:
        steps: Good steps done since the start.
        tool_steps: Where the tools' paths were at the last look, shape (num_tools,) of `TOOL_STEP`.
        read_only: The displacement as last read [m], a view that cannot be written to.
    """

    def __init__(self, elastic: Body, mass: Floats, run: ExplicitRun, time_step: float) -> None:
        self._elastic = elastic
        self._mass = mass
        self._run = run
        self._time_step = time_step
        self._displacement = np.zeros_like(elastic.mesh.points)
        self._increment = np.zeros_like(elastic.mesh.points)
        self.read_only = self._displacement.view()
        self.read_only.flags.writeable = False
        self.tool_steps: NDArray[np.void] = np.zeros(0, dtype=TOOL_STEP)
        self.steps = 0
        self._is_read, self._is_looked_at = True, False

    @property
    def is_looked_at(self) -> bool:
        """Has the run found all that pushes at this state?"""
        return self._is_looked_at

    def start(self, displacement: Points, increment: Points, energy: float) -> None:
        """Start the run from a displacement [m], the increment before it [m] and its energy [J]."""
        self.steps = 0
        self._displacement[:], self._increment[:] = displacement, increment
        self._run.set_state(self._displacement, self._increment, energy)
        self._is_read, self._is_looked_at = True, False

    def read(self) -> tuple[Points, Points]:
        """Displacement and the increment that led to it [m], always the same two arrays."""
        if not self._is_read:
            self._run.get_state(self._displacement, self._increment)
            self._is_read = True
        return self._displacement, self._increment

    def disturb(self) -> None:
        """Something else pushes from now on: what was found is found anew."""
        self._is_looked_at = False

    def look(self, factors: Points, tools: Points) -> None:
        """Find all that pushes, for these factors of the histories and steps of the tools.

        Raises:
            BlowUpError: The last step inverted a cell.
        """
        outcome = self._run.look(factors, tools)
        self._is_looked_at = True
        self._settle(*outcome)
        self.tool_steps = tools[0].view(TOOL_STEP)

    def moved(self, steps_done: int, reason: _core.StopReason, point: int) -> None:
        """Take note of steps that the run has made.

        Raises:
            BlowUpError: `reason` says that something ended them; carries the last good state.
        """
        self._is_read = self._is_looked_at = False
        self._settle(steps_done, reason, point)

    def _settle(self, steps_done: int, reason: _core.StopReason, point: int) -> None:
        """Count the steps of a call of the core; say what ended it, if anything did."""
        self.steps += steps_done
        if reason is not _core.StopReason.none:
            self._is_read = False
            displacement, increment = self.read()
            raise diagnose(
                self._elastic,
                reason,
                point,
                displacement=displacement.copy(),
                increment=increment,
                mass=self._mass,
                steps=self.steps,
                time_step=self._time_step,
            )
