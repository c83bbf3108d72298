"""Size fields: wanted edge lengths over space, and refinement until edges are no longer.

A size field is a function from positions [m], shape (n, 3), to wanted edge lengths [m], shape (n,).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.arrays import Floats, Points, checked_points
from palpate.meshes.errors import InputError
from palpate.meshes.quality import edge_lengths
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


def distance_to_points(positions: ArrayLike) -> Distance:
    """Distance to the nearest of some positions [m], shape (n, 3): a point, or a curve's points."""
    targets = checked_points(np.atleast_2d(np.asarray(positions, dtype=np.float64)))

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
    """Edge length that is smallest at an object and grows in proportion to the distance from it.

    Args:
        distance: See `distance_to_points`, `distance_to_facets` and `distance_to_ball`.
        smallest: [m], > 0.
        growth: Edge length per distance [-], > 0; below 1 the mesh conforms with few extra cells.
        largest: [m], at least `smallest`.
    """
    require_positive(smallest=smallest, growth=growth)
    if not largest >= smallest:
        raise InputError(f"largest = {largest:g} m must be at least smallest = {smallest:g} m")
    return lambda points: np.clip(growth * distance(points), smallest, largest)


def refine_to_size(graded: GradedMesh, size: SizeField, *, max_cells: int = 5_000_000) -> None:
    """Bisect until no cell's edges are on average longer than the field [m] asks for at its middle.

    Raises:
        TooManyCellsError: The field asks for more; the mesh is left as refined until then.
        InputError: The field gives a size that is not above 0.
    """
    for _ in range(_MOST_ROUNDS):
        marked = mean_edges(graded.points, graded.cells) > _checked(
            size, graded.points[graded.cells].mean(axis=1)
        )
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
    lengths: Floats = edge_lengths(points, cells).mean(axis=1)
    return lengths


_MOST_LEVELS = 12
_MOST_LEAVES = 4_000_000
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.int64)
# A regular tetrahedron of edge 1; about the mean of a good mesh.
_CELL_VOLUME = 1.0 / (6.0 * np.sqrt(2.0))


# Largest number of cells of a mesh, estimated from its sizes.
MOST_CELLS = 20_000_000


def grid_of_sizes(points: Points, largest: float, field: SizeField | None) -> _core.SizeGrid:
    """Sizes over the box of some points: one everywhere, or those of a field where smaller."""
    if field is None:
        return _core.SizeGrid(largest)
    low, high = points.min(axis=0), points.max(axis=0)
    return sample_sizes(field, low, high, largest=largest, max_cells=MOST_CELLS)


def sample_sizes(
    field: SizeField, low: Points, high: Points, *, largest: float, max_cells: int
) -> _core.SizeGrid:
    """Sample a size field [m] over a box: cubes are halved where it is smaller than they are.

    `largest` is the edge of the coarsest cubes, and the largest size [m].

    Raises:
        InputError: A size that is not above 0, or not one value for each position.
        TooManyCellsError: A mesh of the whole box would have more than about `max_cells`.
    """
    count = np.maximum(1, np.ceil((high - low) / largest)).astype(np.int64)
    cubes = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1)
    cubes = cubes.reshape(-1, 3)
    leaves, sizes = [], []
    edge, cells = largest, 0.0
    for level in range(_MOST_LEVELS + 1):
        at_centre = _checked(field, low + (cubes + 0.5) * edge)
        # Smallest of centre and corners: a point that asks for little may lie in a corner.
        smallest = at_centre.copy()
        for corner in _CORNERS:
            np.minimum(smallest, _checked(field, low + (cubes + corner) * edge), out=smallest)
        is_leaf = smallest >= edge if level < _MOST_LEVELS else np.ones(len(cubes), dtype=bool)
        # Between both, and no larger than the coarsest.
        kept = np.minimum(0.5 * (at_centre + smallest)[is_leaf], largest)
        leaves.append(np.column_stack([np.full(int(is_leaf.sum()), level), cubes[is_leaf]]))
        sizes.append(kept)
        cells += float((edge**3 / (_CELL_VOLUME * kept**3)).sum())
        cubes = (2 * cubes[~is_leaf][:, None, :] + _CORNERS[None]).reshape(-1, 3)
        edge /= 2.0
        if cells > max_cells or len(cubes) > _MOST_LEAVES:
            raise TooManyCellsError(int(max(cells, len(cubes))), max_cells)
        if len(cubes) == 0:
            break
    return _core.SizeGrid(
        [float(x) for x in low],
        float(largest),
        [int(n) for n in count],
        np.ascontiguousarray(np.vstack(leaves), dtype=np.int32),
        np.ascontiguousarray(np.concatenate(sizes)),
    )


def _checked(field: SizeField, positions: Points) -> Floats:
    wanted = np.asarray(field(positions), dtype=np.float64)
    if wanted.shape != (len(positions),) or not np.all(wanted > 0.0):
        raise InputError("a size field must return one edge length above 0 for each position")
    return wanted
