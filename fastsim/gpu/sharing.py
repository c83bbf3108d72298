"""Arrays of a body on a device for PyTorch, JAX and NumPy, without copies."""

from __future__ import annotations

from typing import Any

from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.gpu.device_run import DeviceRun
from palpate.meshes.errors import InputError


def shared_state(body: ExplicitBody) -> dict[str, Any]:
    """What the steps read and write, by DLPack (`torch.from_dlpack`, `jax.dlpack.from_dlpack`).

    Always the same memory, in the precision of the step and the numbers of the mesh's points: what
    a step makes of it is seen in it. On a GPU the steps run on Warp's stream; wait for them, or use
    that one. Not to be written to: the sums of energy would not know (`set_state` does).

    Args:
        body: With device "warp:cpu" or "cuda:0".

    Returns:
        `displacement` and `increment` (over the last step) [m], `force` (internal, less what
        pushes besides dead loads) and `external_force` (the dead loads) [N], shape (num_points, 3).

    Raises:
        InputError: A body of the compiled core, whose arrays have another order.
    """
    if not isinstance(body.run, DeviceRun):
        raise InputError('this body runs on the core; give it a device ("warp:cpu", "cuda:0")')
    return body.run.shared()
