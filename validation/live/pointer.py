"""The pointer: positions of tool and anchor, tick by tick, and whether the bodies have settled.

Times are whole numbers of ticks, a tick a whole number of steps, and a step has 20 significant
bits: products and quotients of them are exact, so that a recorded path gives every step the same
pose again, bit for bit. Positions are stored in the case's unit, as in the case file.

With damping a motion dies away geometrically: after displacements d1 and d2 in two successive
windows of time, d2 q / (1 - q) with q = d2 / d1 remains (A. C. Aitken, Proc. Roy. Soc. Edinburgh
46, 1926). Heavy damping settles slower than 1 / damping: the motion itself is watched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Floats, Points

_BITS = 20
# Where a body can be pressed no further, the tool retreats at this multiple of its speed.
RETREAT = 5
# Least fraction of the tool's speed where there is little room.
_SLOWEST = 0.1


@dataclass(frozen=True)
class Clock:
    """The time step, and how many steps make a tick.

    Attributes:
        time_step: Length of a step [s], with at most 20 significant bits.
        steps: Number of steps in a tick.
    """

    time_step: float
    steps: int

    @classmethod
    def of(cls, largest_step: float, tick: float) -> Clock:
        """The longest step up to the largest one [s], and the number that best fits a tick [s]."""
        mantissa, exponent = math.frexp(largest_step)
        step = math.ldexp(math.floor(mantissa * 2**_BITS), exponent - _BITS)
        return cls(step, max(1, round(tick / step)))

    @property
    def tick(self) -> float:
        """Length of a tick [s]."""
        return self.steps * self.time_step


@dataclass
class Pointer:
    """The tool's present position, and the position that it is sent to.

    Args:
        start: Position outside of the body, in the case's unit, shape (3,).
        outwards: Unit vector away from the body there, shape (3,).
        largest_way: Largest distance moved in a tick, in the case's unit.
        digits: Decimal places of a position in the case's unit.

    Attributes:
        position: Position of the tool at the end of the present tick.
        is_held_back: Whether the tool has retreated, since the body can be pressed no further, and
            has not moved otherwise since.
    """

    start: Floats
    outwards: Floats
    largest_way: float
    digits: int
    position: Floats = field(init=False)
    is_held_back: bool = False
    _goals: list[Floats] = field(default_factory=list)
    _is_withdrawn: bool = False
    _behind: list[Floats] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.position = self.start.copy()

    def send(self, goal: Floats) -> None:
        """Send the tool to a position, in the case's unit."""
        self._goals, self._is_withdrawn = [goal], False

    def stay(self) -> None:
        """Stop the tool where it is."""
        self._goals, self._is_withdrawn = [], False

    def withdraw(self) -> None:
        """Retract the tool along `outwards`, then return it to the start."""
        out = float((self.start - self.position) @ self.outwards)
        self._goals = [self.position + max(out, 0.0) * self.outwards, self.start.copy()]
        self._is_withdrawn = True

    def next_position(self, room: float = 1.0) -> Floats:
        """The position of the tool at the end of the next tick.

        Args:
            room: Fraction of its speed that it may have; at 0 or less the body can be pressed no
                further, and the tool retreats along its own path.
        """
        if room <= 0.0 and self._behind:
            self.is_held_back = True
            *self._behind, self.position = self._behind[: 1 - RETREAT] or self._behind[:1]
            if self._is_withdrawn:
                self.withdraw()
            else:
                self.stay()
            return self.position
        largest_way = self.largest_way * min(max(room, _SLOWEST), 1.0)
        while self._goals:
            way = self._goals[0] - self.position
            length = float(np.linalg.norm(way))
            if length > largest_way:
                self._step_to(self.position + way * (largest_way / length))
                break
            self._step_to(self._goals.pop(0))
            if length > 0.0:
                break
        return self.position

    def _step_to(self, position: Floats) -> None:
        there = np.round(position, self.digits)
        if not np.array_equal(there, self.position):
            self._behind = [*self._behind[-255:], self.position]
            self.is_held_back = False
        self.position = there


# Simulated time [s]: of a window, and of all the waiting.
_WINDOW, _LONGEST = 0.1, 10.0
# Remaining motion over the largest displacement [-]: a tenth of what the verdict resolves.
RESTS = 1e-3
# Motion in a window below this fraction of the displacement is rounding.
_ROUNDING = 1e-7


class Settling:
    """Watches the bodies until they have settled.

    Args:
        tick: Simulated time between two observations [s], > 0.

    Attributes:
        each_to_go: Remaining motion over the largest displacement of each body [-], shape (n,);
            infinite where the motion does not die away.
    """

    def __init__(self, tick: float) -> None:
        self._each = max(1, round(_WINDOW / tick))
        self._most = max(self._each, round(_LONGEST / tick))
        self._ticks = 0
        self._begin: list[Points] = []
        self._ways: Floats = np.zeros(0)
        self._before: Floats | None = None
        self.each_to_go: Floats = np.array([math.inf])

    @property
    def to_go(self) -> float:
        """What the body that has farthest to go has still to go [-]; see `each_to_go`."""
        return float(self.each_to_go.max())

    @property
    def share(self) -> float:
        """Part of the longest waiting time that is over [-]."""
        return min(self._ticks / self._most, 1.0)

    @property
    def rests(self) -> bool:
        """Whether every body has come to rest."""
        return self.to_go <= RESTS

    @property
    def is_over(self) -> bool:
        """Whether every body has come to rest, or the waiting time is over."""
        return self.rests or self._ticks >= self._most

    @property
    def says(self) -> str:
        """How far from rest the bodies are, in a sentence."""
        if self.rests:
            least = f"{100.0 * RESTS:g} %"
            return f"settled: less than {least} of the largest displacement is still to go"
        left = f"{100.0 * self.to_go:.1f} % of the largest displacement is still to go"
        if self.to_go >= 1.0:
            left = "the motion does not die away"
        return f"not at rest after {_LONGEST:g} s ({left}): the static solver goes on from here"

    def note(self, displacements: Sequence[Points]) -> bool:
        """Note the present displacements [m], shape (num_points, 3) for each body.

        Returns:
            Whether a window ended with this observation.
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
            self.each_to_go = np.array(
                [_left(d1, d2) / size if d2 > _ROUNDING * size else 0.0 for d1, d2, size in rows]
            )
        self._before, self._ways = self._ways, np.zeros(len(displacements))
        self._begin = [u.copy() for u in displacements]
        return True


def _left(first: float, second: float) -> float:
    """Motion that remains after two windows [m]; infinite where the second was no smaller."""
    return second * max(1.0, second / (first - second)) if second < first else math.inf
