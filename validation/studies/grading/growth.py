"""Section V: how the number of cells grows with resolution, uniform and graded.

The unit cube in Hebert's symbolic cells. A resolution of n means cells of side 1/n where they are
smallest; graded, the side grows in proportion to the distance from a face, from the whole
boundary, from an edge or from a corner.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.grading.symbolic_cube import SymbolicCube
from palpate.meshes.arrays import Points

RESOLUTIONS = (8, 16, 32, 64, 128)
# Kuhn's six tetrahedra of a cube of side 1/n: mean edge (3 + 2 sqrt 2 + sqrt 3) / 6 / n, with a
# little over for rounding. (Edges are shared by cells in just these numbers.)
_MEAN_EDGE = 1.001 * (3.0 + 2.0 * np.sqrt(2.0) + np.sqrt(3.0)) / 6.0
# Side over distance. Towards a surface larger values change little, for conformity bounds the
# growth; towards an edge or a corner a cell's middle must not be further off than its side.
GROWTH = {"a face": 1.0, "the whole boundary": 2.0, "an edge": 1.0, "a corner": 0.5}

Distance = Callable[[Points], NDArray[np.float64]]
TARGETS: dict[str, Distance | None] = {
    "uniform": None,
    "a face": lambda p: p[:, 2],
    "the whole boundary": lambda p: np.minimum(p, 1.0 - p).min(axis=1),
    "an edge": lambda p: np.hypot(p[:, 0], p[:, 1]),
    "a corner": lambda p: np.linalg.norm(p, axis=1),
}
# Section V claims 3 for uniform and 2 for graded meshes; a surface is the dearest target.
EXPONENTS = {"uniform": 3.0, "a face": 2.0, "the whole boundary": 2.0}
# How near: what lower-order terms still add at these resolutions.
EXPONENT_TOLERANCE = 0.1


class Growth(NamedTuple):
    """Cells at each resolution, and the exponent fitted to the last three."""

    target: str
    resolutions: tuple[int, ...]
    cells: tuple[int, ...]

    @property
    def exponent(self) -> float:
        """Slope of log cells over log n, least squares over the last three."""
        slope, _ = np.polyfit(np.log(self.resolutions[-3:]), np.log(self.cells[-3:]), 1)
        return float(slope)


def count_cells(target: str, resolutions: tuple[int, ...] = RESOLUTIONS) -> Growth:
    """Refine towards a target of `TARGETS` and count."""
    distance = TARGETS[target]
    counts = []
    for n in resolutions:
        if distance is None:
            counts.append(_count_uniform(n))
            continue
        cube = SymbolicCube()

        def size(places: Points, n: int = n, to: Distance = distance) -> NDArray[np.float64]:
            return np.maximum(_MEAN_EDGE / n, GROWTH[target] * to(places))

        cube.refine_to_size(size, max_cells=20_000_000)
        counts.append(cube.num_cells)
    return Growth(target, tuple(resolutions), tuple(counts))


def _count_uniform(n: int) -> int:
    """Counted on a mesh up to n = 32; beyond, that mesh's cells times eight for each halving.

    2^21 cells of equal names would take gigabytes at n = 128, and all are bisected alike.
    """
    built = min(n, 32)
    cube = SymbolicCube()
    cube.refine_to_size(lambda places: np.full(len(places), _MEAN_EDGE / built))
    return cube.num_cells * round(n / built) ** 3
