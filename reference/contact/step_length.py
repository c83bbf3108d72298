"""How much of a Newton step to take where nodes come to a tool and leave it.

Full steps go to and fro there.
"""

from __future__ import annotations

from collections.abc import Callable

# Of the force along a step, what may be left at its end.
_NEARLY = 0.5
_MOST_TRIALS = 6


def step_length(along: Callable[[float], float | None], first: float) -> float:
    """The part of a step after which the balance of forces along it is nearly met, at most 1.

    Args:
        along: What is out of balance along the step after a part of it [J]; None where a cell
            would be inverted.
        first: The same at its start.
    """
    low, high, length = 0.0, 1.0, 1.0
    for _ in range(_MOST_TRIALS):
        left = along(length)
        if left is None:
            high = length
        elif abs(left) <= _NEARLY * abs(first) or (length == 1.0 and left > 0.0):
            return length
        else:
            low, high = (length, high) if left > 0.0 else (low, length)
        length = 0.5 * (low + high)
    return length
