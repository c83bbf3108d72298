"""One body on a device, with the interface of the core's explicit run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.gpu.batch_run import BatchRun, Plan
from palpate.fastsim.gpu.device_arrays import BodyData, require_supported, shape_numbers
from palpate.fastsim.gpu.devices import UnsupportedOnDeviceError
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Problem

if TYPE_CHECKING:
    from palpate.fastsim.body import Body


class DeviceRun:
    """Collects loads, supports and tools, and becomes a batch of one body at its first use.

    In a batch of several bodies, `join` gives it its number instead. Options: see `BatchRun`.

    Raises:
        UnsupportedOnDeviceError: A law, contact or tool that only the core has.
    """

    def __init__(
        self,
        problem: Problem,
        body: Body,
        mass: Floats,
        is_free: NDArray[np.uint8],
        *,
        device: str,
        precision: str,
        is_repeatable: bool,
        tracks_energy: bool,
        time_step: float,
        mass_damping: float,
        displacement_limit: float,
    ) -> None:
        require_supported(body, device)
        self._problem, self._device = problem, device
        self.options = {
            "device": device,
            "precision": precision,
            "is_repeatable": is_repeatable,
            "tracks_energy": tracks_energy,
        }
        self.data = BodyData(
            body, mass, is_free.astype(np.float64), time_step, mass_damping, displacement_limit
        )
        self._batch: BatchRun | None = None
        self._start: tuple[Points, Points, float] | None = None  # until there is a batch
        self._number = 0
        self.instruction_set = device

    @property
    def batch(self) -> BatchRun:
        """The batch that runs it; made at first use."""
        if self._batch is None:
            self.join(BatchRun([self.data], **self.options), 0)  # type: ignore[arg-type]
        assert self._batch is not None
        return self._batch

    def join(self, batch: BatchRun, number: int) -> None:
        """Run in a batch of several, as one of them."""
        self._batch, self._number = batch, number
        if self._start is not None:
            self.set_state(*self._start)
            self._start = None

    def set_state(self, displacement: Points, increment: Points, energy: float) -> None:
        """Start afresh. `energy` is that of the state [J], for the monitor."""
        if self._batch is None:
            self._start = (displacement.copy(), increment.copy(), energy)
            return
        launches, k = self._batch.launches, self._number
        m, start = launches.motion, np.where(self.data.is_free == 0, 0.0, increment)
        for name, rows in (
            ("displacement", displacement), ("good_displacement", displacement),
            ("counted", displacement), ("increment", start), ("good_increment", start),
        ):  # fmt: skip
            getattr(m, name)[k].assign(rows)
        for name in ("pressure", "touch", "force", "external", "given"):
            getattr(m, name)[k].zero_()
        m.at_start[k : k + 1].fill_(energy)
        for name in ("begun", "open_sums"):
            getattr(m, name)[k : k + 1].zero_()
        if (t := launches.tools) is not None:
            for name in ("begins", "is_known", "impulses", "increments", "offsets"):
                getattr(t, name)[k].zero_()
        if (b := launches.balance) is not None:
            for array in (b.kinetic, b.work, b.loss):
                array[k].zero_()

    def get_state(self, displacement: Points, increment: Points) -> None:
        """Copy the state into arrays of the caller's."""
        self._read("displacement", displacement)
        self._read("increment", increment)

    def _read(self, name: str, target: Points) -> None:
        target[:] = getattr(self.batch.launches.motion, name)[self._number].numpy()

    def set_dead_load(self, history: int, forces: Points) -> None:
        """Forces of a history [N]; they replace those set before."""
        self.data.dead[history] = forces.copy()
        if self._batch is None:
            return
        loads = self._batch.launches.loads
        if history in loads.numbers:
            loads.dead[self._number][loads.numbers.index(history)].assign(forces)
        elif forces.any():
            self._batch.add_history()

    def set_pressure(
        self,
        points: Points,  # noqa: ARG002
        facets: NDArray[np.int32],
        pressures: Floats,
        histories: NDArray[np.int32],
    ) -> None:
        """Follower pressures [Pa]."""
        self.data.facets = facets
        self.data.pressures, self.data.pressure_histories = pressures, histories

    def set_springs(
        self,
        facets: NDArray[np.int32],
        stiffnesses: Floats,  # noqa: ARG002
        histories: NDArray[np.int32],  # noqa: ARG002
    ) -> None:
        """Raise UnsupportedOnDeviceError: only the core has them."""
        if len(facets):
            raise UnsupportedOnDeviceError("a spring over a patch", self._device)

    def set_moving_supports(self, values: Floats, histories: NDArray[np.int32]) -> None:
        """Terms for all points, one after another; history -1 for components without."""
        self.data.support_values, self.data.support_histories = values, histories

    def set_sliding_supports(
        self,
        points: NDArray[np.int32],
        directions: Floats,
        values: Floats,
        histories: NDArray[np.int32],
    ) -> None:
        """Points fixed along one or two directions."""
        self.data.slides = (points, directions, values, histories)

    def set_mass_damping(self, mass_damping: float) -> None:
        """Change D = mass_damping M [1/s]."""
        self.data.mass_damping = mass_damping
        if self._batch is not None:
            self._batch.renew_scheme()

    def add_tool(self, *shape_of_core: object, points: Points, **given: Any) -> None:  # noqa: ARG002
        """The problem's next tool, with the arguments of the core's run."""
        shape = self._problem.tools[len(self.data.tools)].shape
        kind, size = shape_numbers(shape, self._device)
        self.data.tools.append(SimpleNamespace(shape=kind, size=size, **given))

    def add_tool_over_facets(self, *args: object, **kwargs: object) -> None:  # noqa: ARG002
        """Only the core has it."""
        raise UnsupportedOnDeviceError("contact over facets", self._device)

    add_constraint_over_facets = add_tool_over_facets

    def set_self_contact(self, *args: object, **kwargs: object) -> None:  # noqa: ARG002
        """Only the core has it."""
        raise UnsupportedOnDeviceError("contact of a body with itself", self._device)

    def advance(self, factors: Floats, tools: Floats) -> tuple[int, _core.StopReason, int]:
        """The steps between the rows, or fewer if the run leaves its bounds."""
        (outcome,) = self.batch.advance([Plan(factors, tools)])
        return outcome.steps_done, outcome.reason, outcome.point

    def look(self, factors: Floats, tools: Floats) -> tuple[int, _core.StopReason, int]:
        """Find all forces at the present state."""
        plans = [Plan(factors, tools)] * len(self.batch)
        (outcome,) = self.batch.look(plans, [self._number])
        return outcome.steps_done, outcome.reason, outcome.point

    def shared(self) -> dict[str, Any]:
        """Arrays as they are on the device; see `shared_state`."""
        m, k = self.batch.launches.motion, self._number
        return {
            "displacement": m.displacement[k],
            "increment": m.increment[k],
            "force": m.force[k],
            "external_force": m.external[k],
        }

    def energies(self) -> tuple[float, float, float]:
        """Kinetic energy, external work and damping loss so far [J]; zero if not tracked."""
        if (b := self.batch.launches.balance) is None:
            return 0.0, 0.0, 0.0
        kinetic, work, loss = (a[self._number].numpy() for a in (b.kinetic, b.work, b.loss))
        return float(kinetic.sum()), float(work[:, 0].sum()), float(loss[:, 0].sum())

    def take_tool_records(self) -> Floats:
        """Loads on the tools, (num_tools, 11) as the core's; impulses restart from zero."""
        if (t := self.batch.launches.tools) is None:
            return np.zeros((0, 11))
        arrays = (t.forces, t.moments, t.impulses, t.offsets, t.gaps)
        records: Floats = np.column_stack([array[self._number].numpy() for array in arrays])
        t.impulses[self._number].zero_()
        return records

    def get_contact_force(self, force: Points) -> None:
        """Copy the force of the tools on the points [N]."""
        self._read("touch", force)

    def self_overlap(self) -> tuple[int, float]:
        """None: see `set_self_contact`."""
        return 0, 0.0

    def internal_force(self, force: Points) -> None:
        """Copy R(a) as computed by the kernels [N]."""
        self.batch.find_internal_forces()
        self._read("force", force)
