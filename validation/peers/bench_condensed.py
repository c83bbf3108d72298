"""`palpate bench condensed`: the condensed linear model under a ball, timed tick by tick.

A kidney fixed on its back; a ball is pressed 5 mm into it and drawn in a circle, 0.03 mm a tick.
Rows have, over the ticks of the circle: seconds (processor time of a tick, median) with rate, its
reciprocal; contacts (median); tick_99_ms; share_above the limit of LIMIT_MS. Besides: late_of_1khz,
the fraction of ticks not done in their millisecond by the clock, which feels what else the machine
does; build_seconds; said_mb, the memory stated beforehand, found_mb, by how much the process grew
while the model was made, and kept_mb; full_seconds, of a linear solve on the whole mesh under the
last tick's forces, and times_full; difference of the two solutions, over the largest displacement.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from palpate.fastsim.condensed import (
    CompliancePrecision,
    CondensedBody,
    CondensedModel,
    condense,
    condensed_size,
)
from palpate.fastsim.mesher import mesh_surface
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.validation.peers.bench import Row
from palpate.validation.states import Progress
from palpate.validation.versions import version_of

# Approximate number of points that may be touched -> edge length [m].
SIZES = {1_000: 5.15e-3, 2_000: 3.64e-3, 3_000: 2.98e-3}
# A tick of a haptic device is 1 ms; this is the time that contact may take of it [ms].
LIMIT_MS = 0.3
# Number of ticks of one circle; a quarter of this number presses the ball in.
TICKS = 1_600
# Ticks that are timed by the clock, one per millisecond.
CLOCKED = 3_000
_RADIUS, _DEPTH, _CIRCLE = 12e-3, 5e-3, 8e-3  # [m]


def kidney(edge_length: float) -> Problem:
    """A kidney fixed on its back, a ball above its front; edges of this length [m]."""
    mesh = mesh_surface(shape_kidney(edge_length=edge_length))
    surface = np.unique(mesh.boundary_facets)
    fixed = surface[mesh.points[surface, 1] < -0.024].astype(np.int32)
    middle = surface[np.hypot(*mesh.points[surface][:, ::2].T) < 1.5 * edge_length]
    start = np.array([[0.0, mesh.points[middle, 1].max() + _RADIUS, 0.0]])
    ball = RigidTool(SphereShape(_RADIUS), ToolPath(np.zeros(1), start))
    return Problem(mesh, Material(1e4, 0.45, 1000.0), (Support(fixed),), (), tools=(ball,))


def _way(start: Points, num_ticks: int) -> Points:
    """Positions of the ball by tick [m]: a quarter of `num_ticks` down, then a full circle."""
    down = _DEPTH * np.linspace(0.0, 1.0, num_ticks // 4)
    turned = np.linspace(0.0, 2.0 * np.pi, num_ticks)
    positions = np.tile(start, (len(down) + num_ticks, 1))
    positions[: len(down), 1] -= down
    positions[len(down) :, 1] -= _DEPTH
    positions[len(down) :, 0] += _CIRCLE * np.sin(turned)
    positions[len(down) :, 2] += _CIRCLE * (1.0 - np.cos(turned))
    return positions


def measured(
    problem: Problem, progress: Progress, *, num_ticks: int = TICKS, clocked: int = CLOCKED
) -> list[Row]:
    """Condense a body, and touch it with its tool: a row for each precision of the compliance.

    A circle has `num_ticks`; `clocked` ticks are timed by the clock, one per millisecond.
    """
    size = condensed_size(problem)
    before = _memory(peak=False)
    begin = time.process_time()
    model = condense(problem, progress=progress)
    build = time.process_time() - begin
    about = {
        "size": size.num_touched,
        "cells": problem.mesh.num_cells,
        "build_seconds": build,
        "said_mb": size.peak_bytes / 1e6,
        "found_mb": (_memory(peak=True) - before) / 1e6 if before else None,
    }
    single = CompliancePrecision.SINGLE
    rounded = dataclasses.replace(model, precision=single, blocks=model.blocks.astype(single.dtype))
    return [{**about, **_touched(each, progress, num_ticks, clocked)} for each in (model, rounded)]


def _touched(model: CondensedModel, progress: Progress, num_ticks: int, clocked: int) -> Row:
    body = CondensedBody(model)
    (ball,) = body.tools
    positions = _way(ball.position, num_ticks)
    num_down = len(positions) - num_ticks
    progress(f"{len(positions)} ticks of {len(model.touched)} points, {model.precision} precision")
    spent, contacts = np.zeros(len(positions)), np.zeros(len(positions))
    # The first circle fills caches and gathers columns, as a user's first second does.
    for _ in range(2):
        for tick, position in enumerate(positions):
            begin = time.thread_time()
            ball.move_to(position)
            body.step()
            force = ball.force
            spent[tick] = time.thread_time() - begin
            contacts[tick] = body.touching
    circle = 1e3 * spent[num_down:]
    progress(f"{clocked} ticks by the clock, one a millisecond")
    late = _late(body, positions, clocked)
    progress("a linear solve on the whole mesh under the same forces")
    begin = time.process_time()
    full = _solved_in_full(model, body.contact_forces)[body.points]
    full_seconds = time.process_time() - begin
    median = float(np.median(circle))
    return {
        "tool": "palpate",
        "version": version_of("palpate"),
        "threads": 1,
        "precision": str(model.precision.dtype),
        "seconds": 1e-3 * median,
        "rate": 1e3 / median,
        "rate_unit": "ticks per second",
        "contacts": float(np.median(contacts[num_down:])),
        "most_contacts": int(contacts.max()),
        "tick_99_ms": float(np.percentile(circle, 99.0)),
        "worst_tick_ms": float(circle.max()),
        "share_above": float(np.mean(circle > LIMIT_MS)),
        "late_of_1khz": late,
        "kept_mb": model.num_bytes / 1e6,
        "full_seconds": full_seconds,
        "times_full": 1e3 * full_seconds / median,
        "difference": float(np.abs(body.displacement - full).max() / np.abs(full).max()),
        "force": float(np.linalg.norm(force)),
    }


def _solved_in_full(model: CondensedModel, forces: Points) -> Points:
    problem = model.problem
    pushed = (PointForce(model.touched, forces),)
    return solve_static(
        Problem(problem.mesh, problem.material, problem.supports, pushed),
        strain=Strain.LINEAR,
        relative_tolerance=1e-12,
    ).displacement


def _late(body: CondensedBody, positions: Points, count: int) -> float:
    """The fraction of ticks that are not done when the next one begins, after a millisecond."""
    (ball,) = body.tools
    late = 0
    begin = time.perf_counter()
    for tick in range(count):
        due = begin + 1e-3 * tick
        while (left := due - time.perf_counter()) > 0.0:
            # Sleep may end a tenth of a millisecond late.
            if left > 4e-4:
                time.sleep(left - 3e-4)
        # Forwards and backwards, so that the ball never jumps.
        step = tick % (2 * len(positions))
        ball.move_to(positions[-1 - min(step, 2 * len(positions) - 1 - step)])
        body.step()
        late += time.perf_counter() > due + 1e-3
    return late / count


def _memory(*, peak: bool) -> int:
    """Memory of this process [bytes], or its peak since the last call; 0 where it is unknown."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        if not peak:
            # Linux: forget the peak so far.
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return 0
    name = "VmHWM:" if peak else "VmRSS:"
    for line in status.splitlines():
        if line.startswith(name):
            return 1024 * int(line.split()[1])
    return 0


def summary(found: Sequence[Row]) -> list[str]:
    """The limit, and the time of a tick beside that of the full solve."""
    return [
        f"{row['size']} points, {row['precision']}: {1e3 * row['seconds']:.3f} ms a tick (median), "
        f"{row['tick_99_ms']:.3f} ms at 99 %, {row['share_above']:.2%} above {LIMIT_MS} ms, "
        f"by processor time; {row['late_of_1khz']:.2%} late at 1 kHz by the clock; "
        f"{row['times_full']:.0f} times quicker than a solve on the whole mesh"
        for row in found
    ]


BENCHMARK = SimpleNamespace(
    sizes=tuple(SIZES),
    measure=lambda size, progress: measured(kidney(SIZES[size]), progress),
    summary=summary,
    table=("contacts", "tick_99_ms", "share_above", "late_of_1khz", "build_seconds", "said_mb",
           "found_mb", "times_full", "difference"),
)  # fmt: skip
