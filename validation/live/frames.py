"""Frames for the page: positions and colours of the surfaces, and how fast the simulation runs.

A frame consists of four bytes with the length of its head, the head as JSON, padded so that the
rest begins at a multiple of 8, and then for each pane the positions of the surface points and of
those of inclusions inside, 16 bits for each coordinate within a stated box, and their shades, 8
bits a point.
"""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.live.panes import Pane

_STEPS = 65535
_ALIGNMENT = 8
# Energies cost more than positions do: they are computed once in this number of frames.
_SELDOM = 6
# The scale of colours ends at this part of the body's size, of 1, of Young's modulus or beyond.
_LEAST = 1e-3
# The pace is a mean over this time [s].
_WHILE = 1.0


class Box:
    """A box in which coordinates are stated in whole numbers from 0 to 65535.

    Args:
        points: Points of the body at rest [mm], shape (n, 3); the box is three times as large, so
            that a body may move by its own size.
    """

    def __init__(self, points: Points) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        side = float((high - low).max())
        self.origin = (low + high - 3.0 * side) / 2.0
        self.step = 3.0 * side / _STEPS

    def packed(self, positions: Points) -> NDArray[np.uint16]:
        """Positions [mm] as whole numbers, shape (n, 3); outside points move to the box's side."""
        numbers = np.rint((positions - self.origin) / self.step)
        packed: NDArray[np.uint16] = np.clip(numbers, 0, _STEPS).astype("<u2")
        return packed

    def described(self) -> dict[str, Any]:
        """The box as the page needs it: position = origin + step * number [mm]."""
        return {"origin": self.origin.tolist(), "step": self.step}


def pack_frame(
    head: dict[str, Any], panes: Sequence[tuple[NDArray[np.uint16], NDArray[np.uint8]]]
) -> bytes:
    """Pack a frame: its head, and whole numbers and shades of each pane (format above)."""
    text = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    text += b" " * (-(len(text) + 4) % _ALIGNMENT)
    parts = [struct.pack("<I", len(text)), text]
    parts += [numbers.astype("<u2").tobytes() for numbers, _ in panes]
    parts += [shades.astype(np.uint8).tobytes() for _, shades in panes]
    return b"".join(parts)


def unpack_frame(
    data: bytes, num_points: int
) -> tuple[dict[str, Any], list[NDArray[np.uint16]], list[NDArray[np.uint8]]]:
    """Unpack a frame: head, and whole numbers (num_points, 3) and shades (num_points,) by pane."""
    (length,) = struct.unpack_from("<I", data)
    head: dict[str, Any] = json.loads(data[4 : 4 + length])
    begin, count = 4 + length, len(head["panes"])
    numbers = np.frombuffer(data, "<u2", count * num_points * 3, begin)
    shades = np.frombuffer(data, np.uint8, count * num_points, begin + numbers.nbytes)
    return head, list(numbers.reshape(count, -1, 3)), list(shades.reshape(count, -1))


class Pace:
    """How fast the simulation runs.

    Args:
        tick: Length of a tick [s].
    """

    def __init__(self, tick: float) -> None:
        self._tick = tick
        self._spent, self._cpu = tick, 0.0
        self._ends: list[float] = []

    def note(self, spent: float, cpu: float) -> None:
        """Note the wall time of a tick, and the processor time of its busiest thread [s]."""
        weight = min(1.0, self._tick / (0.5 * _WHILE))
        self._spent += weight * (spent - self._spent)
        self._cpu += weight * (cpu - self._cpu)
        now = time.perf_counter()
        self._ends = [*(end for end in self._ends if now - end < _WHILE), now]

    def described(self) -> dict[str, float]:
        """The speeds possible by wall and by processor time, and that reached, in real time."""
        age = time.perf_counter() - self._ends[0] + self._tick if self._ends else _WHILE
        return {
            "factor": self._tick / max(self._spent, 1e-9),
            "cpu_factor": self._tick / max(self._cpu, 1e-9),
            "pace": len(self._ends) * self._tick / max(min(_WHILE, age), self._tick),
        }


class FrameMaker:
    """Makes the frames that show the panes.

    Args:
        rest: Points of the surface at rest [mm], shape (n, 3).
        youngs_modulus: Of the body [Pa].

    Attributes:
        colour: The quantity that colours the surface.
        count: Number of frames so far.
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
        """Choose the quantity that colours the surface from now on."""
        self.colour, self._most = colour, 0.0

    def frame(self, panes: Sequence[Pane], head: dict[str, Any]) -> bytes:
        """The next frame; `head` is added to its own head."""
        self.count += 1
        shades = [pane.shades(self.colour) for pane in panes]
        # One colour scale for all panes, which falls slowly so that the eye can follow.
        self._most = max(
            *(float(of.max()) for of in shades), 0.98 * self._most, self._least[self.colour]
        )
        packed, reported = [], []
        for pane, shade in zip(panes, shades, strict=True):
            positions = pane.positions()
            if self.count % _SELDOM == 1 or pane.name not in self._energies:
                self._energies[pane.name] = pane.strain_energy()
            parts = np.clip(shade * (255.0 / self._most), 0.0, 255.0).astype(np.uint8)
            inner = pane.inner_positions()
            drawn = np.concatenate([positions, inner])
            parts = np.concatenate([parts, np.zeros(len(inner), dtype=np.uint8)])
            packed.append((self.box.packed(drawn * 1e3), parts))
            reported.append(
                {
                    "force": [_finite(f) for f in pane.mean_force() + pane.pull()],
                    "volume": _finite(pane.volume_change(positions)),
                    "energy": _finite(self._energies[pane.name]),
                    "det_f": _finite(pane.smallest_det_f),
                    "trouble": bool(pane.trouble),
                }
            )
        whole = {"frame": self.count, "panes": reported, "colour": self.colour, "most": self._most}
        return pack_frame({**whole, **head}, packed)


def _finite(value: float) -> float:
    """The value as a finite number, as JSON requires."""
    return float(value) if np.isfinite(value) else 0.0
