"""What a candidate gives: a displacement, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from palpate.meshes.arrays import Points
from palpate.validation.judging.results import Trajectory

Progress = Callable[[str], None]


class CandidateFailedError(RuntimeError):
    """The candidate gave no usable answer; the message says why."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A candidate's displacement [m] with how it got there, and over time in dynamic cases."""

    displacement: Points
    seconds: float
    details: dict[str, object]
    trajectory: Trajectory | None = None
