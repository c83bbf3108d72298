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
from palpate.fastsim.gpu.device_arrays import BodyData, MeshArrays
from palpate.fastsim.gpu.kernels.kit import make_kernels
from palpate.fastsim.gpu.kernels.touching import CHUNK
from palpate.meshes.arrays import Floats

# Steps between two looks of the monitor, and in one graph of a GPU.
BLOCK = 16
# As in core/explicit/energy.cpp: increments up to so many roundings of the displacement are zero.
_MOST_ROUNDINGS = 1e4


@cache
def kernels_of(wp: Any, precision: str) -> SimpleNamespace:
    """All kernels of a precision, made once."""
    return make_kernels(wp, precision)


class Launches:
    """Arrays of a batch on a device, and the launches over them.

    Args:
        wp: Warp.
        device: Its name in Warp.
        precision: "float32" or "float64".
        bodies: All on one mesh.
        mesh: The mesh at rest.
        moduli: lmbda and mu of each body and kind [Pa], shape (num_bodies, 2 num_kinds).
        is_green: Finite strain, else engineering strain.
        is_atomic: Forces are added by atomic operations, in any order.
        tracks_energy: Whether to compute the balance of energy.
    """

    def __init__(
        self,
        wp: Any,
        device: str,
        precision: str,
        bodies: Sequence[BodyData],
        mesh: MeshArrays,
        moduli: Floats,
        *,
        is_green: bool,
        is_atomic: bool,
        tracks_energy: bool,
    ) -> None:
        self._wp, self.device = wp, device
        self._k = kernels_of(wp, precision)
        self.make = make = arrays.Maker(wp, device, precision)
        self.num_bodies, self.num_points = len(bodies), len(bodies[0].mass)
        self.num_cells = len(mesh.corners)
        self._is_green, self._is_atomic = int(is_green), int(is_atomic)
        self._limit = bodies[0].displacement_limit
        self._rounding = _MOST_ROUNDINGS * float(np.finfo(precision).eps)
        self.mesh = arrays.mesh_arrays(make, mesh, len(bodies), is_atomic=is_atomic)
        self.moduli = arrays.moduli_array(make, moduli)
        self.motion = arrays.motion_arrays(make, bodies)
        self.scheme = arrays.scheme_arrays(make, bodies)
        self.loads = arrays.load_arrays(make, bodies)
        self.pressure = arrays.pressure_arrays(make, bodies)
        self.supports = arrays.support_arrays(make, bodies)
        self.slides = arrays.slide_arrays(make, bodies)
        self.tools = arrays.tool_arrays(make, bodies, self._k.Tool)
        lists = [p.pressed for p in (self.pressure,) if p is not None]
        lists += [t.touched for t in (self.tools,) if t is not None]
        self._pushed = make.array(np.unique(np.concatenate(lists)), int) if lists else None
        self.balance: Any = None
        if tracks_energy:
            shape = (self.num_bodies, self.num_points)
            self.balance = SimpleNamespace(
                kinetic=make.zeros(shape, wp.float64),
                work=make.zeros(shape, wp.vec2d),
                loss=make.zeros(shape, wp.vec2d),
            )
        self.factors: Any = None
        self.changes: Any = None
        self.tool_steps: Any = None

    def _launch(self, name: str, count: int | None, *inputs: Any) -> None:
        dim = self.num_bodies if count is None else (self.num_bodies, count)
        kernel = getattr(self._k, name)
        self._wp.launch(kernel, dim=dim, inputs=list(inputs), device=self.device)

    def find_internal_force(self) -> None:
        """Compute R(a) into `force`."""
        m, cells = self.motion, self.mesh
        if self._is_atomic:
            m.force.zero_()
        rest = (cells.corners, cells.gradients, cells.volumes)
        ends = (self._is_green, self._is_atomic, cells.cell_forces, m.force)
        if cells.patches is None:
            self._launch(
                "force_cells", self.num_cells, m.go, m.displacement, *rest, cells.kinds,
                cells.num_kinds, self.moduli, *ends, m.inverted,
            )  # fmt: skip
        else:
            p = cells.patches
            self._launch(
                "strain_cells", self.num_cells, m.go, m.displacement, *rest, self._is_green,
                p.strains, m.inverted,
            )  # fmt: skip
            self._launch(
                "smooth_edges", p.num_edges, m.go, p.strains, *p.edges, p.edge_weights,
                p.edge_kinds, self.moduli, p.stresses,
            )  # fmt: skip
            self._launch(
                "smooth_nodes", p.num_nodes, m.go, p.strains, *p.nodes, p.node_weights,
                p.node_kinds, self.moduli, p.pressures,
            )  # fmt: skip
            self._launch(
                "force_smoothed_cells", self.num_cells, m.go, m.displacement, *rest,
                p.cell_edges, p.cell_nodes, p.stresses, p.pressures, *ends,
            )  # fmt: skip
        if not self._is_atomic:
            self._launch(
                "gather_forces", self.num_points, m.go, *cells.gather, cells.cell_forces, m.force
            )

    def combine_loads(self) -> None:
        """Combine the dead loads at the present row."""
        m = self.motion
        if self.loads.numbers:
            self._launch(
                "combine_loads", self.num_points, m.go, m.row, self.factors,
                self.loads.histories, self.loads.dead, m.is_free, m.displacement, m.counted,
                m.given, m.external,
            )  # fmt: skip

    def find_forces(self, *, loads_change: bool) -> None:
        """Compute the residual F - R(a) of eq. 12, with all forces."""
        m = self.motion
        self.find_internal_force()
        if (p := self.pressure) is not None:
            self._launch(
                "press_facets", len(p.facets), m.go, m.row, self.factors, p.points,
                m.displacement, p.facets, p.pressures, p.histories, p.shares,
            )  # fmt: skip
            self._launch(
                "press_points", len(p.on), m.go, p.on, *p.at, p.shares, m.pressure, m.force
            )
        if loads_change:
            self.combine_loads()
        if (s := self.supports) is not None:
            self._launch(
                "look_at_supports", len(s.moving), m.go, m.row, m.begun, self.changes, s.moving,
                s.num_terms, s.values, s.histories, m.force, m.pressure, m.increment, s.last,
                s.ahead, s.inner, m.given,
            )  # fmt: skip
        if (s := self.slides) is not None:
            self._launch(
                "hold_slides", len(s.points), m.go, m.row, m.begun, self.changes,
                self.scheme.keep, self.scheme.speed_share, s.points, s.directions, s.values,
                s.histories, m.external, self.scheme.mobility, m.increment, m.force, s.last,
                s.ahead, s.pull, m.given,
            )  # fmt: skip
        if self.tools is not None:
            self._touch(self.tools)

    def _touch(self, t: Any) -> None:
        m = self.motion
        self._launch("clear_touch", len(t.vertices), m.go, t.vertices, m.unknown, m.touch)
        for number in range(t.count):
            first, last = t.first[number], t.first[number + 1]
            num_chunks = -(-(last - first) // CHUNK)
            self._launch(
                "touch_vertices", last - first, m.go, m.row, number, t.tools, self.tool_steps,
                t.increments, t.offsets, first, t.vertices, t.stiffness, self.scheme.keep, t.rest,
                m.displacement, m.increment, m.external, self.scheme.mobility, t.begins,
                t.is_known, m.force, m.touch, t.acting, t.vertex_moments, t.extremes,
            )  # fmt: skip
            self._launch(
                "sum_touch_chunks", num_chunks, m.go, first, last, t.acting, t.vertex_moments,
                t.extremes, t.chunk_forces, t.chunk_moments, t.chunk_extremes,
            )  # fmt: skip
            self._launch(
                "sum_touch", None, m.go, number, num_chunks, t.tools, t.chunk_forces,
                t.chunk_moments, t.chunk_extremes, t.forces, t.moments, t.gaps, m.unknown,
            )  # fmt: skip

    def sum_energies(self, *, begins: bool) -> None:
        """Once all forces are known, complete the sums of the last step and begin the next."""
        m, b, on = self.motion, self.balance, int(begins)
        if b is None:
            return
        about = (m.go, m.open_sums, on)
        of_steps = (m.time_step, self.scheme.damping, m.mass)
        self._launch(
            "balance_points", self.num_points, *about, *of_steps, self.scheme.keep, m.is_free,
            m.external, m.pressure, m.touch, m.force, self.scheme.mobility, m.increment,
            b.kinetic, b.work, b.loss,
        )  # fmt: skip
        if (s := self.supports) is not None:
            self._launch(
                "balance_supports", len(s.moving), *about, *of_steps, s.moving, s.last, s.ahead,
                s.inner, b.kinetic, b.work, b.loss,
            )  # fmt: skip
        if (s := self.slides) is not None:
            self._launch(
                "balance_slides", len(s.points), *about, s.points, s.last, s.ahead, s.pull, b.work
            )
        self._launch("open_balance", None, m.go, on, m.open_sums)

    def move(self) -> None:
        """Eq. 12 itself, and the count of accepted steps."""
        m = self.motion
        self.sum_energies(begins=True)
        self._launch(
            "move_points", self.num_points, m.go, m.inverted, self.scheme.keep, self._limit,
            m.external, m.force, self.scheme.mobility, m.increment, m.displacement, m.outside,
        )  # fmt: skip
        if (s := self.supports) is not None:
            self._launch(
                "move_supports", len(s.moving), m.go, m.inverted, m.row, self.factors, s.moving,
                s.num_terms, s.values, s.histories, s.ahead, m.increment, m.displacement,
            )  # fmt: skip
        if (s := self.slides) is not None:
            self._launch(
                "settle_slides", len(s.points), m.go, m.inverted, m.row, self.factors, s.points,
                s.directions, s.values, s.histories, m.displacement,
            )  # fmt: skip
        if self._pushed is not None:
            self._launch(
                "count_pushes", len(self._pushed), m.go, m.inverted, self._pushed, m.is_free,
                m.pressure, m.touch, m.increment, m.given,
            )  # fmt: skip
        if (t := self.tools) is not None:
            self._launch(
                "move_tools", t.count, m.go, m.inverted, m.row, m.begun, m.time_step, t.tools,
                self.tool_steps, t.forces, t.impulses, t.increments, t.offsets,
            )  # fmt: skip
        self._launch(
            "finish_step", None, m.go, m.inverted, m.outside, m.unknown, m.row, m.last_row,
            m.since_good, m.begun, m.status,
        )  # fmt: skip

    def monitor(self) -> None:
        """Check whether energy grew from nothing; store the state if it did not."""
        m = self.motion
        self._launch(
            "sum_chunks", m.num_chunks, m.status, m.num_chunks, self.num_points, m.mass,
            m.is_free, m.external, m.increment, m.displacement, m.counted, m.given, m.sums,
        )  # fmt: skip
        self._launch(
            "judge_growth", None, m.num_chunks, m.sums, m.time_step, m.at_start, m.total_mass,
            self._rounding, m.status, m.since_good, m.go, m.is_good,
        )  # fmt: skip
        self._launch(
            "keep_good", self.num_points, m.is_good, m.increment, m.displacement,
            m.good_increment, m.good_displacement,
        )  # fmt: skip

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
            "gathering": bool(self._is_atomic),
            "elasticity": self.mesh.patches is not None,
        }
        return [m for topic, m in self._k.modules.items() if not unused.get(topic, False)]

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
