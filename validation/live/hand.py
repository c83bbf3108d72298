"""The hand: where the tool is sent, tick by tick, slow enough for the bodies to follow.

Times are whole numbers of ticks, a tick a whole number of steps, and a step has 20 significant
bits: products and quotients of them are exact, so that a recorded path gives every step the same
pose again, bit for bit. Places are kept in the case's unit, as they will stand in the case file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Floats

_BITS = 20
# Where a body takes no more, the tool goes back so many times as fast as it may come.
RETREAT = 5
# Of its speed, where there is little room.
_SLOWEST = 0.1


@dataclass(frozen=True)
class Clock:
    """Steps and ticks.

    Attributes:
        time_step: [s], with at most 20 significant bits.
        steps: In a tick.
    """

    time_step: float
    steps: int

    @classmethod
    def of(cls, largest_step: float, tick: float) -> Clock:
        """The longest step up to one [s], and as many as come nearest to a tick [s]."""
        mantissa, exponent = math.frexp(largest_step)
        step = math.ldexp(math.floor(mantissa * 2**_BITS), exponent - _BITS)
        return cls(step, max(1, round(tick / step)))

    @property
    def tick(self) -> float:
        """Length of a tick [s]."""
        return self.steps * self.time_step


@dataclass
class Hand:
    """Where the tool is and is to be.

    Args:
        start: Outside of the body, in the case's unit, shape (3,).
        outwards: Unit vector away from the body there, shape (3,).
        largest_way: In a tick, in the case's unit.
        digits: Of a place behind the point, in the case's unit.

    Attributes:
        place: Where the tool is at the end of the present tick.
        is_held_back: The body took no more, and the tool went back a little.
    """

    start: Floats
    outwards: Floats
    largest_way: float
    digits: int
    place: Floats = field(init=False)
    is_held_back: bool = False
    _goals: list[Floats] = field(default_factory=list)
    _behind: list[Floats] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.place = self.start.copy()

    def send(self, goal: Floats) -> None:
        """Go to a place, in the case's unit."""
        self._goals = [goal]

    def stay(self) -> None:
        """Stop where it is."""
        self._goals = []

    def withdraw(self) -> None:
        """Go out along the way back out, then to the start."""
        out = float((self.start - self.place) @ self.outwards)
        self._goals = [self.place + max(out, 0.0) * self.outwards, self.start.copy()]

    def next_place(self, room: float = 1.0) -> Floats:
        """Where the tool is to be at the end of the next tick.

        Args:
            room: Part of its speed that it may have; 0 or less: the body takes no more, and the
                tool goes back on its own way.
        """
        self.is_held_back = room <= 0.0 and bool(self._behind)
        if self.is_held_back:
            *self._behind, self.place = self._behind[: 1 - RETREAT] or self._behind[:1]
            self._goals = []
            return self.place
        largest_way = self.largest_way * min(max(room, _SLOWEST), 1.0)
        while self._goals:
            way = self._goals[0] - self.place
            length = float(np.linalg.norm(way))
            if length > largest_way:
                self._step_to(self.place + way * (largest_way / length))
                break
            self._step_to(self._goals.pop(0))
            if length > 0.0:
                break
        return self.place

    def _step_to(self, place: Floats) -> None:
        there = np.round(place, self.digits)
        if not np.array_equal(there, self.place):
            self._behind = [*self._behind[-255:], self.place]
        self.place = there
