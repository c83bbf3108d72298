"""The launches of a step, in their order, for all bodies of a batch; see `palpate.fastsim.gpu`."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from palpate.fastsim.gpu import device_arrays as arrays
from palpate.fastsim.gpu.device_arrays import BodyData
from palpate.fastsim.gpu.kernels.kit import make_kernels
from palpate.fastsim.gpu.kernels.touching import CHUNK
from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.problem import Strain

# Steps between two looks of the monitor, and in one graph of a GPU.
BLOCK = 16
# As in core/explicit/energy.cpp: increments up to so many roundings of the displacement are zero.
_MOST_ROUNDINGS = 1e4


@cache
def kernels_of(wp: Any, precision: str) -> SimpleNamespace:
    """All kernels of a precision, made once."""
    return make_kernels(wp, precision)


class Launches:
    """Arrays of a batch on a device, by its name in Warp, and the launches over them.

    `kinds` is for each cell its row of the moduli: lmbda and mu of each body and kind [Pa], shape
    (num_bodies, 2 num_kinds). If `is_atomic`, forces are added in any order.
    """

    def __init__(
        self,
        wp: Any,
        device: str,
        precision: str,
        bodies: Sequence[BodyData],
        kinds: Indices,
        moduli: Floats,
        *,
        is_atomic: bool,
        tracks_energy: bool,
    ) -> None:
        self._wp, self.device = wp, device
        self._inputs: dict[tuple[Any, ...], list[Any]] = {}  # of launches, found once
        self._kernels = kernels_of(wp, precision)
        self.make = make = arrays.Maker(wp, device, precision)
        body, self.num_bodies, num_points = bodies[0].body, len(bodies), len(bodies[0].mass)
        self.mesh = arrays.mesh_arrays(make, body, kinds, len(bodies), is_atomic=is_atomic)
        self.motion = arrays.motion_arrays(make, bodies)
        self.scheme = arrays.scheme_arrays(make, bodies)
        self.loads = arrays.load_arrays(make, bodies)
        self.pressure = arrays.pressure_arrays(make, bodies)
        self.supports = arrays.support_arrays(make, bodies)
        self.slides = arrays.slide_arrays(make, bodies)
        self.tools = arrays.tool_arrays(make, bodies, self._kernels.Tool)
        lists = [part.on for part in (self.pressure, self.tools) if part is not None]
        pushed = np.unique(np.concatenate(lists)) if lists else np.zeros(0, dtype=np.int32)
        self.balance: Any = None
        if tracks_energy:
            shape = (self.num_bodies, num_points)
            self.balance = SimpleNamespace(
                kinetic=make.zeros(shape, wp.float64),
                work=make.zeros(shape, wp.vec2d),
                loss=make.zeros(shape, wp.vec2d),
            )
        # What has one value for a whole batch, and the rows of the plans, uploaded before a call.
        self.common = SimpleNamespace(
            is_green=int(body.strain is Strain.GREEN),
            is_atomic=int(is_atomic),
            moduli=make.array(moduli, make.real),
            num_points=num_points,
            num_pushed=len(pushed),
            pushed=make.array(pushed, int),
            limit=bodies[0].displacement_limit,
            rounding=_MOST_ROUNDINGS * float(np.finfo(precision).eps),
            factors=None,
            changes=None,
            tool_steps=None,
        )

    def replace(self, **arrays: Any) -> None:
        """Put others instead of arrays of `common`, or of the dead loads."""
        for name, array in arrays.items():
            setattr(self if name == "loads" else self.common, name, array)
        self._inputs.clear()

    def _launch(self, name: str, count: int | None, *parts: Any, **given: Any) -> None:
        """Launch a kernel over bodies, and `count` things of each where it is not None.

        Its arguments are what has their names: in `given`, then in `parts`, which are some of this
        object's, then in those that every kernel may read.
        """
        kernel, key = getattr(self._kernels, name), (name, *given.values())
        inputs = self._inputs.get(key)
        if inputs is None:
            spaces = [given, *map(vars, (*parts, self.motion, self.scheme, self.common))]
            inputs = self._inputs[key] = [
                next(space[argument.label] for space in spaces if argument.label in space)
                for argument in kernel.adj.args
            ]
        dim = self.num_bodies if count is None else (self.num_bodies, count)
        self._wp.launch(kernel, dim=dim, inputs=inputs, device=self.device)

    def find_internal_force(self) -> None:
        """Compute R(a) into `force`."""
        cells, p = self.mesh, self.mesh.patches
        if self.common.is_atomic:
            self.motion.force.zero_()
        if p is None:
            self._launch("force_cells", cells.count, cells)
        else:
            self._launch("strain_cells", cells.count, p, cells)
            self._launch("smooth_edges", p.edges.count, p.edges, p, cells)
            self._launch("smooth_nodes", p.nodes.count, p.nodes, p)
            self._launch("force_smoothed_cells", cells.count, p, cells)
        if not self.common.is_atomic:
            self._launch("gather_forces", cells.gather.count, cells.gather, cells)

    def combine_loads(self) -> None:
        """Combine the dead loads at the present row."""
        if self.loads.numbers:
            self._launch("combine_loads", self.common.num_points, self.loads)

    def find_forces(self, *, loads_change: bool) -> None:
        """Compute the residual F - R(a) of eq. 12, with all forces."""
        self.find_internal_force()
        if (p := self.pressure) is not None:
            self._launch("press_facets", p.count, p)
            self._launch("press_points", p.at.count, p.at, corner_forces=p.corner_forces)
        if loads_change:
            self.combine_loads()
        if (s := self.supports) is not None:
            self._launch("look_at_supports", s.count, s)
        if (s := self.slides) is not None:
            self._launch("hold_slides", s.count, s)
        if self.tools is not None:
            self._touch(self.tools)

    def _touch(self, t: Any) -> None:
        self._launch("clear_touch", len(t.vertices), t)
        for number in range(t.count):
            first, last = t.starts[number], t.starts[number + 1]
            chunks = -(-(last - first) // CHUNK)
            self._launch("touch_vertices", last - first, t, number=number, first=first)
            self._launch("sum_touch_chunks", chunks, t, first=first, last=last)
            self._launch("sum_touch", None, t, number=number, num_chunks=chunks)

    def sum_energies(self, *, begins: bool) -> None:
        """Once all forces are known, complete the sums of the last step and begin the next."""
        if (b := self.balance) is None:
            return
        on = int(begins)
        self._launch("balance_points", self.common.num_points, b, begins=on)
        if (s := self.supports) is not None:
            self._launch("balance_supports", s.count, s, b, begins=on)
        if (s := self.slides) is not None:
            self._launch("balance_slides", s.count, s, b, begins=on)
        self._launch("open_balance", None, begins=on)

    def move(self) -> None:
        """Eq. 12 itself, and the count of accepted steps."""
        self.sum_energies(begins=True)
        self._launch("move_points", self.common.num_points)
        if (s := self.supports) is not None:
            self._launch("move_supports", s.count, s)
        if (s := self.slides) is not None:
            self._launch("settle_slides", s.count, s)
        if self.common.num_pushed:
            self._launch("count_pushes", self.common.num_pushed)
        if (t := self.tools) is not None:
            self._launch("move_tools", t.count, t)
        self._launch("finish_step", None)

    def monitor(self) -> None:
        """Check whether energy grew from nothing; store the state if it did not."""
        self._launch("sum_chunks", self.motion.num_chunks)
        self._launch("judge_growth", None)
        self._launch("keep_good", self.common.num_points)

    def step_block(self, num_steps: int, *, loads_change: bool) -> None:
        """Make some steps, then run the monitor."""
        for _ in range(num_steps):
            self.find_forces(loads_change=loads_change)
            self.move()
        self.monitor()

    @property
    def modules(self) -> list[Any]:
        """The modules that are compiled for these launches."""
        unused = {
            "smoothing": self.mesh.patches is None,
            "touching": self.tools is None,
            "gathering": bool(self.common.is_atomic),
            "elasticity": self.mesh.patches is not None,
        }
        return [m for topic, m in self._kernels.modules.items() if not unused.get(topic, False)]

    def copy_bandwidth(self, num_bytes: int) -> float:
        """Bandwidth of a copy of so many bytes, read and written [bytes/s]; the best of five."""
        wp, best = self._wp, math.inf
        source = self.make.zeros(num_bytes // 4, wp.float32)
        target = self.make.zeros(num_bytes // 4, wp.float32)
        for _ in range(5):
            wp.synchronize_device(self.device)
            start = time.perf_counter()
            wp.copy(target, source)
            wp.synchronize_device(self.device)
            best = min(best, time.perf_counter() - start)
        return 2.0 * num_bytes / best
