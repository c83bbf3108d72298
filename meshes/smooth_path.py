"""A tool's path without jolts: it comes to rest at every pose that was given."""

from __future__ import annotations

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.rigid_tool import ToolPath

# Straight pieces from one pose to the next: their jumps of speed are below 5 % of its largest.
_PIECES = 64
_STEP = TabularAmplitude((0.0, 1.0), (0.0, 1.0), is_smooth=True)


def smooth_path(path: ToolPath) -> ToolPath:
    """The same poses at the same times, with the speed of the smooth amplitude between them.

    From pose to pose the part 10 s^3 - 15 s^4 + 6 s^5 of the way, s of the time, as knots that are
    near enough to each other: so every simulator reads a path of straight pieces, whichever it
    was made from.

    Args:
        path: Straight from pose to pose.

    Returns:
        A path with 64 pieces in the place of each, through the same poses.

    >>> import numpy as np
    >>> path = ToolPath(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    >>> smooth_path(path).pose_at(0.25)[0].round(4).tolist()
    [0.1035, 0.0, 0.0]
    """
    parts = np.arange(_PIECES) / _PIECES
    steps = np.array([_STEP(float(s)) for s in parts])
    times, along, rotations = [], [], []
    for k, (begin, end) in enumerate(zip(path.times, path.times[1:], strict=False)):
        times.append(begin + (end - begin) * parts)
        start, way = path.positions[k], path.positions[k + 1] - path.positions[k]
        along.append(start + steps[:, None] * way)
        rotations += [path.quaternion_at(float(begin + (end - begin) * s)) for s in steps]
    return ToolPath(
        np.concatenate([*times, path.times[-1:]]),
        np.concatenate([*along, path.positions[-1:]]),
        np.array([*rotations, path.rotations[-1]]),
    )
