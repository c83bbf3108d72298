"""A factor over time as plain data: how a load or a support's motion is switched on."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

from palpate.meshes.errors import InputError


@dataclass(frozen=True)
class TabularAmplitude:
    """A factor given at knots, constant before the first and after the last.

    Between knots it is linear, or, where `is_smooth`, the step 10 s^3 - 15 s^4 + 6 s^5, whose
    first two time derivatives vanish at the knots, which excites little vibration.

    Args:
        times: Knots [s], increasing, at least one.
        factors: Factor at each [-], finite.
        is_smooth: Whether to use these smooth steps instead of straight lines.

    Raises:
        InputError: Different lengths, times that do not increase, NaN or infinity.

    >>> import palpate
    >>> palpate.TabularAmplitude((0.0, 0.2), (0.0, 1.0))(0.05)
    0.25
    """

    times: tuple[float, ...]
    factors: tuple[float, ...]
    is_smooth: bool = False

    def __post_init__(self) -> None:
        if not self.times or len(self.times) != len(self.factors):
            raise InputError(
                f"an amplitude needs as many factors as times, at least one; got "
                f"{len(self.times)} times and {len(self.factors)} factors"
            )
        for k, (time, factor) in enumerate(zip(self.times, self.factors, strict=True)):
            if not (math.isfinite(time) and math.isfinite(factor)):
                raise InputError(f"amplitude, knot {k}: ({time:g}, {factor:g}) is not finite")
            if k and not time > self.times[k - 1]:
                raise InputError(
                    f"amplitude, knot {k}: time {time:g} s does not come after "
                    f"{self.times[k - 1]:g} s; times must increase"
                )

    def __call__(self, time: float) -> float:
        """The factor at a time [s]."""
        after = bisect_right(self.times, time)
        if after == 0:
            return self.factors[0]
        if after == len(self.times):
            return self.factors[-1]
        start, end = self.times[after - 1], self.times[after]
        s = (time - start) / (end - start)
        if self.is_smooth:
            s = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        return self.factors[after - 1] + s * (self.factors[after] - self.factors[after - 1])
