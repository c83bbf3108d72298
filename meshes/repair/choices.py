"""Limits of what a repair may do to a surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.meshes.errors import InputError

# A hole with more edges is more likely a missing half than a cut vessel.
LARGEST_HOLE = 100
# What sections of an organ differ by when two people draw them, and less than meshes cost [%].
LIMIT = 2.0
# From this limit on parts may be lost, fused or turned into cavities [%].
FUSES = 100.0


@dataclass(frozen=True)
class RepairChoices:
    """What a repair may do.

    Args:
        distance: How far each part of the surface may move, > 0 [m]; None takes half its mean edge.
            Caps, thin fins and parts dropped by choice do not count.
        limit: Largest change of a part's volume, >= 0 [%]; from 100 on parts may be lost, fused or
            turned into cavities.
        largest_hole: Largest number of edges of a hole that is closed, >= 0.
        smallest_shell: Loose parts whose box is shorter than this are dropped, >= 0 [m].

    Raises:
        InputError: A value out of range.

    >>> import palpate
    >>> vessels_open = palpate.RepairChoices(largest_hole=12)  # for palpate.mesh(repair=...)
    >>> vessels_open.largest_hole
    12
    """

    distance: float | None = None
    limit: float = LIMIT
    largest_hole: int = LARGEST_HOLE
    smallest_shell: float = 0.0

    def __post_init__(self) -> None:
        if self.distance is not None and not 0.0 < self.distance < math.inf:
            raise InputError(f"repair distance {self.distance:g} m: needs a finite value above 0")
        if not 0.0 <= self.limit < math.inf:
            raise InputError(f"repair limit {self.limit:g} %: needs a finite value of at least 0")
        if self.largest_hole < 0:
            raise InputError(f"largest hole {self.largest_hole}: needs at least 0 edges")
        if not 0.0 <= self.smallest_shell < math.inf:
            raise InputError(f"smallest shell {self.smallest_shell:g} m: needs a finite value")
