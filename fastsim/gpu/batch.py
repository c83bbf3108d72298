"""Several bodies in one launch: one mesh with other materials, loads, supports or steps.

For parameter studies and learning: a small body does not fill a GPU, many of them do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate.fastsim.dynamics import DynamicResult, Recorder
from palpate.fastsim.errors import BlowUpError
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.fastsim.gpu.batch_run import BatchRun, Plan
from palpate.fastsim.gpu.device_run import DeviceRun
from palpate.fastsim.gpu.devices import CORE, UnsupportedOnDeviceError
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain


def simulate_batch(
    problems: Sequence[Problem],
    *,
    device: str,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
    precision: Precision = Precision.DOUBLE,
    is_repeatable: bool = True,
    tracks_energy: bool = False,
) -> tuple[DynamicResult | BlowUpError, ...]:
    """Run several problems side by side, each over its own time span with its own step.

    Each result is that of `simulate` on the same device, bit for bit if repeatable.

    Args:
        problems: All on one mesh, each with a time span of as many outputs. Tools may have
            other paths, but touch the same facets.
        device: "cuda:0", or "warp:cpu".
        strain: Engineering or finite strain.
        element: Linear tetrahedra, plain or smoothed.
        precision: Precision of the step.
        is_repeatable: Sums in one order, bit for bit; else in any order.
        tracks_energy: Sum up work and losses at every step.

    Returns:
        A trajectory for each, or the error that ended it: a blow-up does not end the others.

    Raises:
        InputError: No problems, or ones that differ too much; see `simulate` for each.
        UnsupportedOnDeviceError: The compiled core ("cpu") runs no batches.

    Example:
        >>> import dataclasses, numpy as np
        >>> from palpate.meshes.boundary_conditions import BodyForce, Support
        >>> from palpate.meshes.bricks import brick_box
        >>> from palpate.meshes.problem import Material, TimeSpan
        >>> mesh = brick_box((2, 1, 1), size=(2.0, 1.0, 1.0))
        >>> held = Support(np.flatnonzero(mesh.points[:, 0] == 0.0).astype(np.int32))
        >>> one = Problem(mesh, Material(1e4, 0.3, 1e3), (held,), (BodyForce((0, 0, -9.8)),),
        ...               TimeSpan(0.05))
        >>> other = dataclasses.replace(one, material=Material(2e4, 0.4, 1e3))
        >>> from palpate.fastsim.gpu.devices import known_devices
        >>> if "warp:cpu" in known_devices():
        ...     results = simulate_batch([one, other], device="warp:cpu")
        ...     assert results[0].displacements.shape == results[1].displacements.shape
    """
    if device == CORE:
        raise UnsupportedOnDeviceError("a batch", 'device="cpu"; for the same kernels, "warp:cpu"')
    if not problems or any(problem.time is None for problem in problems):
        raise InputError("a batch needs at least one problem, and each a time span")
    counts = {problem.time.num_outputs for problem in problems if problem.time is not None}
    if len(counts) > 1:
        raise InputError(f"the problems of a batch have {sorted(counts)} outputs; give one number")
    bodies = [
        ExplicitBody(
            problem,
            strain=strain,
            element=element,
            precision=precision,
            device=device,
            is_repeatable=is_repeatable,
            tracks_energy=tracks_energy,
        )
        for problem in problems
    ]
    runs = [body.run for body in bodies if isinstance(body.run, DeviceRun)]
    batch = BatchRun([run.data for run in runs], **runs[0].options)  # type: ignore[arg-type]
    for number, run in enumerate(runs):
        run.join(batch, number)
    recorders = [Recorder(body, tracks_energy=tracks_energy) for body in bodies]
    ended: dict[int, BlowUpError] = {}
    for output in range(counts.pop() + 1):
        if output > 0:
            _step(bodies, batch, ended)
        for number, recorder in enumerate(recorders):
            if number not in ended:
                try:
                    recorder.record(output)
                except BlowUpError as error:
                    ended[number] = error
    return tuple(
        ended[number] if number in ended else recorder.result()
        for number, recorder in enumerate(recorders)
    )


def _step(bodies: Sequence[ExplicitBody], batch: BatchRun, ended: dict[int, BlowUpError]) -> None:
    """Step all bodies to their next output; those that have ended stay."""
    plans = [
        Plan(*body.rows(0 if number in ended else body.steps_per_output))
        for number, body in enumerate(bodies)
    ]
    for number, (body, outcome) in enumerate(zip(bodies, batch.advance(plans), strict=True)):
        if number not in ended:
            try:
                body.moved(outcome.steps_done, outcome.reason, outcome.point)
            except BlowUpError as error:
                ended[number] = error


def shared_state(body: ExplicitBody) -> dict[str, Any]:
    """The arrays of the steps, by DLPack (`torch.from_dlpack`, `jax.dlpack.from_dlpack`).

    Always the same memory, in the precision of the step and the order of the mesh's points, which
    each step updates. On a GPU the steps run on Warp's stream; wait for them, or use
    that one. Not to be written to, since the sums of energy would miss it; use `set_state`.

    Args:
        body: With device "warp:cpu" or "cuda:0".

    Returns:
        `displacement` and `increment` (over the last step) [m], `force` (internal, less all
        but dead loads) and `external_force` (the dead loads) [N], shape (num_points, 3).

    Raises:
        InputError: A body of the compiled core, whose arrays have another order.
    """
    if not isinstance(body.run, DeviceRun):
        raise InputError('this body runs on the core; give it a device ("warp:cpu", "cuda:0")')
    return body.run.shared()
