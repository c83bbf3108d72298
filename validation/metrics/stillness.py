"""Whether anything moves at all: what is lost when it is added to the body's places is rounding."""

from __future__ import annotations

import numpy as np

from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import State

# Of the body's size.
_ROUNDING = float(np.finfo(np.float64).eps)


def is_still(mesh: TetMesh, state: State) -> bool:
    """Whether a state moves nowhere, at no time, by more than the rounding of the body's places."""
    size = float(np.ptp(mesh.points, axis=0).max())
    motions = [motion for motion in (state.trajectory, state.sent) if motion is not None]
    moved = [state.displacement, *(motion.displacements for motion in motions)]
    if state.own is not None:
        moved.append(state.own.displacements)
    return all(bool((np.abs(u) <= _ROUNDING * size).all()) for u in moved)
