"""Errors of a family of ever finer runs, and the order that they show."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import log


@dataclass(frozen=True)
class ErrorFamily:
    """Errors against an exact answer, or one that is far better.

    Attributes:
        name: What was run, and which error.
        label: The same in two words.
        what: "h", "p" or "dt": what is varied.
        sizes: Cell sizes or time steps, falling, in any unit.
        errors: Relative [-], > 0.
        expected_order: By theory [-].
        tolerance: How far the last observed order may be from it [-].
        notes: Of each run: cells, or the time step.
    """

    name: str
    label: str
    what: str
    sizes: tuple[float, ...]
    errors: tuple[float, ...]
    expected_order: float
    tolerance: float
    notes: tuple[str, ...] = ()

    @property
    def orders(self) -> tuple[float, ...]:
        """Observed order between neighbours [-], the last between the two finest."""
        pairs = pairwise(zip(self.sizes, self.errors, strict=True))
        return tuple(log(e / f) / log(h / g) for (h, e), (g, f) in pairs)

    @property
    def is_as_expected(self) -> bool:
        """Does the order between the two finest runs agree with theory?"""
        return abs(self.orders[-1] - self.expected_order) <= self.tolerance
