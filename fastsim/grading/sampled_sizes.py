"""A size field on halved cubes, as the mesher and the remesher read it."""

from __future__ import annotations

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.grading.size_fields import SizeField, TooManyCellsError
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError

_MOST_LEVELS = 12
_MOST_LEAVES = 4_000_000
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.int64)
# A regular tetrahedron of edge 1; about the mean of a good mesh.
_CELL_VOLUME = 1.0 / (6.0 * np.sqrt(2.0))


# Of one mesh, by its sizes.
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
    """Sample a size field over a box: cubes are halved where it is smaller than they are.

    Args:
        field: Wanted edge lengths [m].
        low: Corner of the box [m], shape (3,).
        high: The opposite corner [m].
        largest: Edge of the coarsest cubes, and the largest size [m].
        max_cells: Of a mesh of the whole box with those sizes, about.

    Raises:
        InputError: A size that is not above 0, or a value for each place is missing.
        TooManyCellsError: The field asks for more than `max_cells`.
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


def _checked(field: SizeField, places: Points) -> Floats:
    wanted = np.asarray(field(places), dtype=np.float64)
    if wanted.shape != (len(places),) or not np.all(wanted > 0.0):
        raise InputError("a size field must return one edge length above 0 for each place")
    return wanted
