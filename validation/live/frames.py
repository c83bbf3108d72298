"""Frames for the page: where the surfaces are, how they are coloured, how quick it all is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.live.condensed_pane import AnyPane
from palpate.validation.live.protocol import Box, pack_frame

# Energies cost more than a look at the surface: every so many frames.
_SELDOM = 6
# The scale of colours ends at this part of the body's size, of 1, of Young's modulus or beyond.
_LEAST = 1e-3
# The pace is told over so long [s].
_WHILE = 1.0


class Pace:
    """How long the bodies' time takes.

    Args:
        tick: Length of a tick [s].
    """

    def __init__(self, tick: float) -> None:
        self._tick = tick
        self._spent, self._cpu = tick, 0.0
        self._ends: list[float] = []

    def note(self, spent: float, cpu: float) -> None:
        """A tick took so much time, and so much of the busiest thread's processor [s]."""
        share = min(1.0, self._tick / (0.5 * _WHILE))
        self._spent += share * (spent - self._spent)
        self._cpu += share * (cpu - self._cpu)
        now = time.perf_counter()
        self._ends = [*(end for end in self._ends if now - end < _WHILE), now]

    def described(self) -> dict[str, float]:
        """Times real time that is possible, the same by processor time, and what is held."""
        age = time.perf_counter() - self._ends[0] + self._tick if self._ends else _WHILE
        return {
            "factor": self._tick / max(self._spent, 1e-9),
            "cpu_factor": self._tick / max(self._cpu, 1e-9),
            "pace": len(self._ends) * self._tick / max(min(_WHILE, age), self._tick),
        }


class Look:
    """What is seen of the panes.

    Args:
        rest: Points of the surface at rest [mm], shape (n, 3).
        youngs_modulus: [Pa].

    Attributes:
        colour: What the surface is coloured by.
        count: Of frames so far.
    """

    def __init__(self, rest: Points, youngs_modulus: float) -> None:
        self.box = Box(rest)
        self.colour = "displacement"
        # A body at rest has one colour, not the colours of rounding.
        size = 1e-3 * float(np.ptp(rest, axis=0).max())
        self._least = {
            "displacement": _LEAST * size,
            "strain": _LEAST,
            "stress": _LEAST * youngs_modulus,
        }
        self.count = 0
        self.begin()

    def begin(self) -> None:
        """Forget the scale of colours and the energies."""
        self._most = 0.0
        self._energies: dict[str, float] = {}

    def colour_by(self, colour: str) -> None:
        """Colour by something else from now on."""
        self.colour, self._most = colour, 0.0

    def frame(self, panes: Sequence[AnyPane], head: dict[str, Any]) -> bytes:
        """The next frame, with more for its head."""
        self.count += 1
        shades = [pane.shades(self.colour) for pane in panes]
        # One scale for all, which falls slowly so that the eye can follow.
        self._most = max(
            *(float(of.max()) for of in shades), 0.98 * self._most, self._least[self.colour]
        )
        packed, told = [], []
        for pane, shade in zip(panes, shades, strict=True):
            places = pane.places()
            if self.count % _SELDOM == 1 or pane.name not in self._energies:
                self._energies[pane.name] = pane.strain_energy()
            parts = np.clip(shade * (255.0 / self._most), 0.0, 255.0).astype(np.uint8)
            packed.append((self.box.packed(places * 1e3), parts))
            told.append(
                {
                    "force": [_finite(f) for f in pane.mean_force() + pane.pull()],
                    "volume": _finite(pane.volume_change(places)),
                    "energy": _finite(self._energies[pane.name]),
                    "det_f": _finite(pane.smallest_det_f),
                    "trouble": bool(pane.trouble),
                }
            )
        whole = {"frame": self.count, "panes": told, "colour": self.colour, "most": self._most}
        return pack_frame({**whole, **head}, packed)


def _finite(value: float) -> float:
    """A number that JSON has."""
    return float(value) if np.isfinite(value) else 0.0
