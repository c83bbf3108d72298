"""How long edges may be, from place to place, and refinement until they are no longer.

A size field is a function from places [m], shape (n, 3), to wanted edge lengths [m], shape (n,).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.arrays import Floats, Points, checked_points
from palpate.meshes.errors import InputError
from palpate.meshes.shapes import require_positive
from palpate.meshes.tri_surface import TriSurface

Distance = Callable[[Points], Floats]
SizeField = Callable[[Points], Floats]

# Each bisection of all cells doubles their number: 60 are beyond any memory.
_MOST_ROUNDS = 60


class TooManyCellsError(InputError):
    """The size field asks for more cells than allowed; `.num_cells` is how far it came."""

    def __init__(self, num_cells: int, limit: int) -> None:
        self.num_cells = num_cells
        super().__init__(
            f"the size field asks for more than {limit} cells ({num_cells} so far); "
            "use larger sizes, faster growth, or a higher max_cells"
        )


def distance_to_points(places: ArrayLike) -> Distance:
    """Distance to the nearest of some places [m], shape (n, 3): a point, or a curve's points."""
    targets = checked_points(np.atleast_2d(np.asarray(places, dtype=np.float64)))

    def measure(points: Points) -> Floats:
        nearest = np.full(len(points), np.inf)
        for target in targets:
            np.minimum(nearest, np.linalg.norm(points - target, axis=1), out=nearest)
        return nearest

    return measure


def distance_to_facets(surface: TriSurface) -> Distance:
    """Distance to a surface, or to some of its facets: a loaded patch, the whole boundary."""
    if surface.num_facets == 0:
        raise InputError("no facets to measure the distance to")
    searched = _core.SurfaceDistance(np.array(surface.points), np.array(surface.facets))

    def measure(points: Points) -> Floats:
        return searched.distances(np.ascontiguousarray(points))

    return measure


def distance_to_ball(centre: ArrayLike, radius: float) -> Distance:
    """Distance to a ball, such as a round tool; 0 inside."""
    require_positive(radius=radius)
    from_centre = distance_to_points(np.asarray(centre, dtype=np.float64).reshape(1, 3))
    return lambda points: np.maximum(from_centre(points) - radius, 0.0)


def grow_with_distance(
    distance: Distance, *, smallest: float, growth: float, largest: float = np.inf
) -> SizeField:
    """Edge length that is smallest at a place and grows in proportion to the distance from it.

    Args:
        distance: See `distance_to_points` and its like.
        smallest: [m], > 0.
        growth: Edge length per distance [-], > 0; below 1 the mesh conforms with few extra cells.
        largest: [m], at least `smallest`.
    """
    require_positive(smallest=smallest, growth=growth)
    if not largest >= smallest:
        raise InputError(f"largest = {largest:g} m must be at least smallest = {smallest:g} m")
    return lambda points: np.clip(growth * distance(points), smallest, largest)


def refine_to_size(graded: GradedMesh, size: SizeField, *, max_cells: int = 5_000_000) -> None:
    """Bisect until no cell's edges are on average longer than the field asks for at its middle.

    Args:
        graded: Refined in place.
        size: Edge lengths [m].
        max_cells: Where to stop.

    Raises:
        TooManyCellsError: The mesh is left as it was when that was seen, finer than given.
        InputError: The field gives a size that is not above 0.
    """
    for _ in range(_MOST_ROUNDS):
        marked = mean_edges(graded.points, graded.cells) > _checked_sizes(size, graded)
        if not marked.any():
            return
        if len(graded.cells) + int(marked.sum()) > max_cells:
            raise TooManyCellsError(len(graded.cells), max_cells)
        graded.refine(marked)
        # To conform, a round may bisect more cells than were marked.
        if len(graded.cells) > max_cells:
            raise TooManyCellsError(len(graded.cells), max_cells)
    raise TooManyCellsError(len(graded.cells), max_cells)


def mean_edges(points: Points, cells: NDArray[np.int32]) -> Floats:
    """Mean length of each cell's six edges [m], shape (num_cells,)."""
    corners = points[cells]
    total = np.zeros(len(cells))
    for i in range(4):
        for j in range(i + 1, 4):
            total += np.linalg.norm(corners[:, i] - corners[:, j], axis=1)
    return total / 6.0


def _checked_sizes(size: SizeField, graded: GradedMesh) -> Floats:
    wanted = np.asarray(size(graded.points[graded.cells].mean(axis=1)), dtype=np.float64)
    if wanted.shape != (len(graded.cells),) or not np.all(wanted > 0.0):
        raise InputError("a size field must return one edge length above 0 for each place")
    return wanted
