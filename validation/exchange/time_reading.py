"""A motion at the times it is compared at, from the states that were sent.

A state that was sent at such a time is taken as it is. Elsewhere the motion is read by the cubic
through the four states around; the parabolas through three of them say how far that may be off
(the error estimate of embedded rules: one order less). A motion that is sampled too coarsely for
its own content so has a large error, whatever the cubic says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.states import Trajectory

_MOST_NODES = 4


@dataclass(frozen=True, eq=False)
class TimeReading:
    """States at the times asked for.

    Attributes:
        states: Best reading, (num_times, num_points, 3).
        others: The reading of one order less that is farther from it; the same where sent.
        were_sent: Whether a state was sent at that time, (num_times,).
    """

    states: NDArray[np.float64]
    others: NDArray[np.float64]
    were_sent: NDArray[np.bool_]


def read_at(
    times: Points, states: NDArray[np.float64], wanted: Points, *, slack: float
) -> TimeReading:
    """Read a motion at times within its own; it is never extrapolated.

    Args:
        times: [s], increasing, (n,).
        states: (n, num_points, 3).
        wanted: [s], between the first and the last of `times`, give or take `slack`.
        slack: Times that differ by no more are the same [s].
    """
    after = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
    is_before = wanted - times[after - 1] <= times[np.minimum(after, len(times) - 1)] - wanted
    nearest = np.where(is_before | (len(times) == 1), after - 1, after)
    were_sent = np.abs(times[nearest] - wanted) <= slack
    best, others = states[nearest].copy(), states[nearest].copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for k in np.flatnonzero(~were_sent):
            best[k], others[k] = _read(times, states, float(wanted[k]))
    return TimeReading(best, others, were_sent)


def to_the_end(
    times: Points, states: NDArray[np.float64], last: NDArray[np.float64], end: float, slack: float
) -> Trajectory:
    """The states sent from the start to the end, and the last one where none was sent there."""
    is_inside = (times >= -slack) & (times <= end + slack)
    if times[is_inside][-1] >= end - slack:
        return Trajectory(times[is_inside], states[is_inside])
    return Trajectory(np.append(times[is_inside], end), np.concatenate([states[is_inside], last]))


def _read(
    times: Points, states: NDArray[np.float64], time: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    count = min(_MOST_NODES, len(times))
    after = int(np.searchsorted(times, time))
    first = min(max(after - count // 2, 0), len(times) - count)
    nodes = np.arange(first, first + count)
    best = _polynomial(times, states, nodes, time)
    lower = [_polynomial(times, states, part, time) for part in (nodes[1:], nodes[:-1])]
    return best, lower[int(np.linalg.norm(lower[1] - best) > np.linalg.norm(lower[0] - best))]


def _polynomial(
    times: Points, states: NDArray[np.float64], nodes: NDArray[np.int64], time: float
) -> NDArray[np.float64]:
    """Lagrange's through the states at some nodes."""
    t = times[nodes]
    weights = [
        np.prod((time - np.delete(t, k)) / (t[k] - np.delete(t, k))) for k in range(len(nodes))
    ]
    found: NDArray[np.float64] = np.tensordot(np.array(weights), states[nodes], axes=1)
    return found
