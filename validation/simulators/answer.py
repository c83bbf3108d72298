"""What a candidate gives, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.states import CandidateFailedError, Progress, Trajectory

__all__ = ["Answer", "CandidateFailedError", "Progress"]


@dataclass(frozen=True, eq=False)
class Answer:
    """A candidate's displacement, and how it got there.

    Attributes:
        displacement: [m], (num_points, 3); of a motion its last state.
        seconds: Time the solve took.
        details: As in `State`.
        trajectory: Of a motion.
        tool_forces: [N], as in `State`.
    """

    displacement: Points
    seconds: float
    details: dict[str, object]
    trajectory: Trajectory | None = None
    tool_forces: NDArray[np.float64] | None = None
