"""What a candidate gives: a displacement, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.states import Trajectory

Progress = Callable[[str], None]


class CandidateFailedError(RuntimeError):
    """The candidate gave no usable answer; the message says why.

    >>> import dataclasses
    >>> import palpate
    >>> problem = palpate.load_case("block").problem
    >>> jelly = palpate.Material(youngs_modulus=1.0, poissons_ratio=0.4)
    >>> try:
    ...     palpate.solve(dataclasses.replace(problem, material=jelly))
    ... except palpate.CandidateFailedError as error:
    ...     print(str(error)[:8])
    fastsim:
    """


@dataclass(frozen=True, eq=False)
class Answer:
    """A candidate's displacement [m] with how it got there, and over time in dynamic cases.

    `tool_forces` as in `State`.
    """

    displacement: Points
    seconds: float
    details: dict[str, object]
    trajectory: Trajectory | None = None
    tool_forces: NDArray[np.float64] | None = None
