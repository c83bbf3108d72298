"""A batch of bodies on a device: plans in, states out, all steps of a call without a stop.

On a GPU a block of `BLOCK` steps with the monitor's look is captured as a CUDA graph once and
replayed: the rows of the plan are counted on the device, so that a graph contains no step's number.
On the processor Warp records and replays the same launches, by which tests verify this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.gpu.device_arrays import BodyData, load_arrays, scheme_arrays
from palpate.fastsim.gpu.devices import load_warp, warp_name
from palpate.fastsim.gpu.kernels.stepping import NONE
from palpate.fastsim.gpu.launches import BLOCK, Launches
from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element

_REASONS = tuple(_core.StopReason)
_TOOL_STEP = 13  # numbers


@dataclass(frozen=True, eq=False)
class Plan:
    """Factors and tools for the steps of a body: a row before each step, and one for the end.

    Factors of its histories [-], (num_steps + 1, num_histories); poses and drives of its tools,
    (num_steps + 1, 13 num_tools).
    """

    factors: Floats
    tools: Floats

    @property
    def num_steps(self) -> int:
        """Number of steps between the rows."""
        return len(self.factors) - 1


@dataclass(frozen=True)
class Outcome:
    """Number of accepted steps of a call, why it ended, and the fastest point, or -1."""

    steps_done: int
    reason: _core.StopReason
    point: int


class BatchRun:
    """Bodies on one mesh, with the same strain and element, in explicit motion on a device.

    Args:
        bodies: One or more.
        device: "warp:cpu" or "cuda:0".
        precision: "float32" or "float64".
        is_repeatable: Two runs have the same bits; else forces are added in any order, which
            needs a launch less and no memory for the forces of single cells.
        tracks_energy: Whether to compute the balance of energy.

    Attributes:
        uses_graphs: Whether blocks of steps are captured as graphs; by default on a GPU.
        launches: The launches and their arrays.

    Raises:
        InputError: Bodies that differ too much for a batch.
    """

    def __init__(
        self,
        bodies: Sequence[BodyData],
        *,
        device: str,
        precision: str,
        is_repeatable: bool = True,
        tracks_energy: bool = False,
    ) -> None:
        first = bodies[0].body
        for data in bodies:
            _require_alike(data.body, first)
        kinds, moduli = moduli_of([b.body for b in bodies])
        wp = load_warp(device)
        self._wp, self._bodies = wp, list(bodies)
        self.launches = Launches(
            wp,
            warp_name(device),
            precision,
            bodies,
            kinds,
            moduli,
            is_atomic=not is_repeatable,
            tracks_energy=tracks_energy,
        )
        self.uses_graphs = wp.get_device(warp_name(device)).is_cuda
        self._graphs: dict[bool, Any] = {}
        self._room = 0

    def __len__(self) -> int:
        return len(self._bodies)

    def advance(self, plans: Sequence[Plan]) -> list[Outcome]:
        """The steps of each body's plan, or fewer if it leaves its bounds."""
        counts = [plan.num_steps for plan in plans]
        self._upload(plans)
        self._begin(np.array(counts, dtype=np.int32))
        changes = self._loads_change(plans)
        if not changes:
            self.launches.combine_loads()
        left = max(counts)
        while left >= BLOCK and self.uses_graphs:
            self._replay(changes)
            left -= BLOCK
        while left > 0:
            self.launches.step_block(min(left, BLOCK), loads_change=changes)
            left -= BLOCK
        return self._outcomes()

    def look(self, plans: Sequence[Plan], bodies: Sequence[int]) -> list[Outcome]:
        """Find all forces at the present state of some bodies, for records and energies."""
        self._upload(plans)
        going = np.zeros(len(self), dtype=np.int32)
        going[list(bodies)] = 1
        self._begin(going)
        self.launches.find_forces(loads_change=True)
        self.launches.sum_energies(begins=False)
        m = self.launches.motion
        inverted = m.inverted.numpy()
        found = []
        for body in bodies:
            reason = _core.StopReason.none
            steps = 0
            if inverted[body] != 0:
                reason = _core.StopReason.inverted_cell
                steps = self._step_back(body)
            found.append(Outcome(steps, reason, -1))
        return found

    def find_internal_forces(self) -> None:
        """Compute R(a) of all bodies into `force`, by the kernels."""
        self._begin(np.ones(len(self), dtype=np.int32))
        self.launches.find_internal_force()

    def renew_scheme(self) -> None:
        """Compute anew what depends on the damping of the bodies."""
        new, old = scheme_arrays(self.launches.make, self._bodies), self.launches.scheme
        for name, array in vars(new).items():
            self._wp.copy(getattr(old, name), array)

    def add_history(self) -> None:
        """Make the arrays of dead loads anew, for a history that had none in any body."""
        self.launches.replace(loads=load_arrays(self.launches.make, self._bodies))
        self._graphs = {}

    def _upload(self, plans: Sequence[Plan]) -> None:
        """Upload the rows of all plans, stacked; when buffers grow, the graphs are discarded."""
        rows = max(len(plan.factors) for plan in plans)
        histories = max(plan.factors.shape[1] for plan in plans)
        num_tools = 0 if self.launches.tools is None else self.launches.tools.count
        many, make, common = len(self), self.launches.make, self.launches.common
        if rows > self._room:
            self._room = max(rows, 2 * self._room, BLOCK + 1)
            shape = (many, self._room, histories)
            vec13 = self._wp.types.vector(_TOOL_STEP, self._wp.float64)
            self.launches.replace(
                factors=make.zeros(shape, make.real),
                changes=make.zeros(shape, make.real),
                tool_steps=make.zeros((many, self._room, num_tools), vec13),
            )
            self._graphs = {}
        for body, plan in enumerate(plans):
            count, width = plan.factors.shape
            given, ahead = np.zeros((2, count, histories))
            given[:, :width] = plan.factors
            ahead[:-1, :width] = np.diff(plan.factors, axis=0)
            common.factors[body][:count].assign(given)
            common.changes[body][:count].assign(ahead)
            if num_tools:
                steps_of = plan.tools.reshape(-1, num_tools, _TOOL_STEP)
                common.tool_steps[body][:count].assign(steps_of)

    def _begin(self, counts: Indices) -> None:
        m = self.launches.motion
        for name in ("row", "status", "since_good", "inverted", "outside", "unknown"):
            getattr(m, name).zero_()
        m.last_row.assign(counts)
        m.go.assign((counts > 0).astype(np.int32))

    def _loads_change(self, plans: Sequence[Plan]) -> bool:
        """Whether the factor of a dead load differs from one step of a plan to the next."""
        numbers = self.launches.loads.numbers
        return any(
            (plan.factors[:-1, h] != plan.factors[0, h]).any()
            for plan in plans
            for h in numbers
            if h < plan.factors.shape[1] and plan.num_steps > 0
        )

    def _replay(self, changes: bool) -> None:
        """Run a block of steps as a graph, which is captured at first use."""
        wp, device = self._wp, self.launches.device
        if changes not in self._graphs:
            for module in self.launches.modules:
                module.load(wp.get_device(device))  # nothing may be compiled while capturing
            with wp.ScopedCapture(device=device) as capture:
                self.launches.step_block(BLOCK, loads_change=changes)
            self._graphs[changes] = capture.graph
        wp.capture_launch(self._graphs[changes])

    def _outcomes(self) -> list[Outcome]:
        m = self.launches.motion
        status, rows, since = (a.numpy() for a in (m.status, m.row, m.since_good))
        found = []
        for body in range(len(self)):
            done, point = int(rows[body]), -1
            if status[body] != NONE:
                if _REASONS[status[body]] is _core.StopReason.inverted_cell:
                    done += self._step_back(body)
                else:
                    point = self._fastest(body)
                    done -= int(since[body])
                    self._wp.copy(m.displacement[body], m.good_displacement[body])
                    self._wp.copy(m.increment[body], m.good_increment[body])
            found.append(Outcome(done, _REASONS[status[body]], point))
        return found

    def _step_back(self, body: int) -> int:
        """Return to the state before the last step, if any; minus the number of steps."""
        m = self.launches.motion
        if m.begun.numpy()[body] == 0:
            return 0
        back = m.displacement[body].numpy() - m.increment[body].numpy()
        m.displacement[body].assign(back)
        return -1

    def _fastest(self, body: int) -> int:
        """The point that moves fastest; the first NaN counts as such."""
        d = self.launches.motion.increment[body].numpy().astype(np.float64)
        return int(np.argmax((d**2 * (self._bodies[body].is_free != 0)).sum(axis=1)))


def moduli_of(bodies: Sequence[Body]) -> tuple[Indices, Floats]:
    """Kinds of cells, alike in all bodies, and of each body and kind lmbda and mu [Pa].

    Raises:
        InputError: Smoothed cells that are of one material in a body and of two in another.
    """
    moduli = np.array([np.column_stack([b.lmbda, b.mu]) for b in bodies])
    columns = moduli.transpose(1, 0, 2).reshape(moduli.shape[1], -1)
    table, kinds = np.unique(columns, axis=0, return_inverse=True)
    if bodies[0].element is Element.SMOOTHED:
        for body in moduli:
            if len(np.unique(body, axis=0)) != len(table):
                raise InputError(
                    "smoothed cells are averaged within one material: bodies of a batch need "
                    "their inclusions in the same cells"
                )
    of_bodies = table.reshape(len(table), len(bodies), 2).transpose(1, 0, 2)
    return kinds.reshape(-1).astype(np.int32), of_bodies.reshape(len(bodies), -1)


def _require_alike(body: Body, first: Body) -> None:
    same_mesh = body.mesh is first.mesh or (
        np.array_equal(body.mesh.points, first.mesh.points)
        and np.array_equal(body.mesh.cells, first.mesh.cells)
    )
    if not (same_mesh and body.strain is first.strain and body.element is first.element):
        raise InputError("bodies of a batch need the same mesh, strain and element")
