"""How far long work is, in per cent: nothing of what takes less than two seconds."""

from __future__ import annotations

import time
from collections.abc import Callable

# Seconds until the first line of a stage, and between two of its lines at most; each pause is twice
# the last, so that a log of hours has few lines.
_FIRST, _LONGEST = 2.0, 30.0


class Percent:
    """Lines such as "improving cells: 40 %", ever rarer, of one stage of work after another.

    Args:
        progress: Called with a line; None is nobody.
        clock: Seconds; None is the monotonic clock.
    """

    def __init__(
        self,
        progress: Callable[[str], None] | None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._progress, self._clock = progress, clock or time.monotonic
        self._stage, self._pause, self._next = "", _FIRST, 0.0

    def __call__(self, stage: str, done: float) -> None:
        """A part of a stage is done, 0 to 1; another name begins another stage."""
        now = self._clock()
        if stage != self._stage:
            self._stage, self._pause, self._next = stage, _FIRST, now + _FIRST
        if self._progress is None or now < self._next:
            return
        self._pause = min(2.0 * self._pause, _LONGEST)
        self._next = now + self._pause
        # Rounded down: 100 % is said by what comes next.
        self._progress(f"{stage}: {int(100.0 * min(max(done, 0.0), 0.99))} %")
