"""Why an explicit run was stopped, and where in the body."""

from __future__ import annotations

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.errors import BlowUpError
from palpate.meshes.arrays import Floats, Points

_REASONS = {
    _core.StopReason.inverted_cell: "a cell inverted",
    _core.StopReason.out_of_bounds: "a displacement left all bounds",
    _core.StopReason.energy_growth: "energy grew from nothing",
    _core.StopReason.deep_in_tool: "a vertex moved so fast or deep that it may pass through a tool",
}


def diagnose(
    body: Body,
    reason: _core.StopReason,
    point: int,
    *,
    displacement: Points,
    increment: Points,
    mass: Floats,
    steps: int,
    time_step: float,
) -> BlowUpError:
    """The error that says what was seen, in which cell, and what to change.

    Args:
        body: At rest.
        reason: What the core saw.
        point: That moved fastest, or -1.
        displacement: The last good state [m], shape (num_points, 3).
        increment: That led to it or, to an inverted cell, from it [m].
        mass: Lumped [kg], shape (num_points,).
        steps: Good ones.
        time_step: [s].
    """
    mesh = body.mesh
    smallest, cell = body.smallest_det_f(displacement)
    if reason is _core.StopReason.inverted_cell:
        # The bad state is one increment ahead of the last good one.
        cell = body.smallest_det_f(displacement + increment)[1]
    elif point >= 0:
        cell = int(np.flatnonzero((mesh.cells == point).any(axis=1))[0])
    return BlowUpError(
        _REASONS[reason],
        step=steps,
        time=steps * time_step,
        cell=cell,
        place=tuple(float(x) for x in mesh.points[mesh.cells[cell]].mean(axis=0)),
        smallest_det_f=smallest,
        displacement=displacement,
        time_step=time_step,
        critical_time_step=body.critical_time_step(displacement=displacement, mass=mass),
    )
