"""Grids of quadrilaterals that are graded to their lines, and polynomials on them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats

# Of the sizes of neighbouring quadrilaterals.
_FALL = 0.2


@dataclass(frozen=True)
class Section:
    """What is extruded: bricks of a grid, some of them left out, and where they really lie.

    Attributes:
        x: Lines of the grid, rising; every corner of the outline lies on one.
        z: Likewise.
        is_solid: Which bricks are there, shape (len(x) - 1, len(z) - 1).
        place: From the grid to the rest places [m], (..., 2) for (..., 2); bilinear.
    """

    x: Floats
    z: Floats
    is_solid: NDArray[np.bool_]
    place: Callable[[Floats], Floats]


def graded(lines: Floats, layers: int) -> Floats:
    """Lines of elements: falling sizes towards each line, even ones between."""
    least = float(np.diff(lines).min())
    found = [lines[:1]]
    for a, b in itertools.pairwise(lines):
        reach = 0.4 * min(b - a, 2.0 * least)
        near = reach * _FALL ** np.arange(layers)[::-1]
        middle = b - a - 2.0 * reach
        pieces = max(1, round(middle / reach))
        even = a + reach + middle * np.arange(1, pieces) / pieces
        found.append(np.concatenate([a + near, even, (b - near)[::-1], [b]]))
    out: Floats = np.concatenate(found)
    return out


def lobatto(degree: int) -> Floats:
    """Gauss, Lobatto's places in [-1, 1]."""
    legendre = np.polynomial.legendre
    series = np.append(np.zeros(degree), 1.0)
    inside = legendre.legroots(legendre.legder(series))  # type: ignore[no-untyped-call]
    return np.concatenate([[-1.0], np.sort(inside.real), [1.0]])


def lagrange(nodes: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Polynomials that are one at one node, and their slopes; shape (places, nodes)."""
    legendre, degree = np.polynomial.legendre, len(nodes) - 1
    back = np.linalg.inv(legendre.legvander(nodes, degree))  # type: ignore[no-untyped-call]
    rate = legendre.legder(back)  # type: ignore[no-untyped-call]
    value = legendre.legvander(places, degree) @ back  # type: ignore[no-untyped-call]
    slope = legendre.legvander(places, degree - 1) @ rate  # type: ignore[no-untyped-call]
    return value, slope
