"""Whether bodies that are held still have come to rest, and how far they still have to go.

With damping the last of a motion dies away geometrically: of the ways d1, d2 in two windows of
time, one after the other, d2 q / (1 - q) with q = d2 / d1 is left (A. C. Aitken, Proc. Roy. Soc.
Edinburgh 46, 1926). Heavy damping settles slower than 1 / damping: the motion itself is watched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.meshes.arrays import Floats, Points

# Of the bodies' time [s]: a window, and all of it.
_WINDOW, _LONGEST = 0.1, 10.0
# Way that is left of the largest displacement [-]: a tenth of what the verdict can tell.
_RESTS = 1e-3
# Less than this part of the displacement in a window is rounding.
_ROUNDING = 1e-7


class Settling:
    """One hold.

    Args:
        tick: Of the bodies' time between two looks [s], > 0.

    Attributes:
        to_go: Way that is left over the largest displacement, of the body that has farthest to go
            [-]; infinite before the second window, and where the motion does not die away.
    """

    def __init__(self, tick: float) -> None:
        self._each = max(1, round(_WINDOW / tick))
        self._most = max(self._each, round(_LONGEST / tick))
        self._ticks = 0
        self._begin: list[Points] = []
        self._ways: Floats = np.zeros(0)
        self._before: Floats | None = None
        self.to_go = math.inf

    @property
    def rests(self) -> bool:
        """Whether every body has come to rest."""
        return self.to_go <= _RESTS

    @property
    def is_over(self) -> bool:
        """Whether they rest, or were waited for long enough."""
        return self.rests or self._ticks >= self._most

    @property
    def says(self) -> str:
        """How far from rest they are, in a sentence."""
        if self.rests:
            return f"settled: less than {_RESTS:.1%} of the largest displacement is still to go"
        left = "it does not die away" if math.isinf(self.to_go) else f"{self.to_go:.1%} is to go"
        return f"not at rest after {_LONGEST:g} s: of the largest displacement {left}"

    def note(self, displacements: Sequence[Points]) -> bool:
        """Look at the bodies once more [m], shape (num_points, 3) each.

        Returns:
            Whether a window ended with this look.
        """
        if not self._begin:
            self._begin = [u.copy() for u in displacements]
            self._ways = np.zeros(len(self._begin))
        self._ticks += 1
        ways = [np.abs(u - b).max() for u, b in zip(displacements, self._begin, strict=True)]
        self._ways = np.maximum(self._ways, ways)
        if self._ticks % self._each:
            return False
        if self._before is not None:
            sizes = [float(np.abs(u).max()) for u in displacements]
            rows = zip(self._before, self._ways, sizes, strict=True)
            self.to_go = max(
                _left(d1, d2) / size if d2 > _ROUNDING * size else 0.0 for d1, d2, size in rows
            )
        self._before, self._ways = self._ways, np.zeros(len(displacements))
        self._begin = [u.copy() for u in displacements]
        return True


def _left(first: float, second: float) -> float:
    """Way after two windows [m]; infinite where the second was no shorter."""
    return second * max(1.0, second / (first - second)) if second < first else math.inf
