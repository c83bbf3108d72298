"""The judge's own measures of a mended surface and its mesh: VTK's locators and plain sums.

Nothing here is shared with the repair, which measures with the core's tree of facets.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pyvista
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator
from vtkmodules.vtkFiltersModeling import vtkSelectEnclosedPoints

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.tri_surface import TriSurface

# Samples of a facet: a lattice of its sides in so many parts.
_PARTS = 4
# How near to the surface a face of the mesh lies on it, of the box; likewise of areas.
_ON_SURFACE = 1e-9
# Places within the box at which mesh and sound surface must agree on what is inside.
NUM_PLACES = 2000


class Measured(NamedTuple):
    """Of one mesh, beside the surface that was meant.

    Attributes:
        to_sound: Largest distance of the mended surface from the sound one [m].
        from_sound: The other way round [m].
        volume: Of the mesh, cells summed here [m3].
        volume_change: Over the sound surface's, minus 1.
        wrong_facets: Faces of more than two cells, or of one and not on the mended surface.
        flat_cells: Cells without a positive volume.
        wrong_places: Places inside one and outside the other, further from the sound surface than
            allowed.
    """

    to_sound: float
    from_sound: float
    volume: float
    volume_change: float
    wrong_facets: int
    flat_cells: int
    wrong_places: int


def measure(
    mended: TriSurface, points: Points, cells: Indices, sound: TriSurface, *, allowed: float
) -> Measured:
    """Measure a mesh of a mended surface.

    Args:
        mended: The repaired surface [m].
        points: Of the mesh [m].
        cells: Likewise, shape (num_cells, 4).
        sound: What was meant [m].
        allowed: How far the two may be apart [m].
    """
    volumes = _cell_volumes(points, cells)
    volume = math.fsum(volumes.tolist())
    meant = enclosed_volume(sound)
    return Measured(
        deviation(mended, sound),
        deviation(sound, mended),
        volume,
        volume / meant - 1.0,
        _wrong_facets(mended, points, cells),
        int(np.count_nonzero(volumes <= 0.0)),
        _wrong_places(points, cells, sound, allowed),
    )


def deviation(one: TriSurface, other: TriSurface) -> float:
    """Largest distance of samples of one surface from another [m]."""
    return float(_distances(_samples(one), other).max())


def enclosed_volume(surface: TriSurface) -> float:
    """By tetrahedra from the middle of the box to each facet, summed exactly [m3]."""
    middle = 0.5 * (surface.points.min(axis=0) + surface.points.max(axis=0))
    a, b, c = ((surface.points - middle)[surface.facets[:, k]] for k in range(3))
    return math.fsum((np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0).tolist())


def _samples(surface: TriSurface) -> Points:
    shares = [(i, k, _PARTS - i - k) for i in range(_PARTS + 1) for k in range(_PARTS + 1 - i)]
    weights = np.array(shares) / _PARTS
    places: Points = np.einsum("sk,fkx->fsx", weights, surface.points[surface.facets])
    return places.reshape(-1, 3)


def _polydata(surface: TriSurface) -> Any:
    rows = np.column_stack([np.full(surface.num_facets, 3), surface.facets]).ravel()
    return pyvista.PolyData(np.array(surface.points), faces=rows)


def _distances(places: Points, surface: TriSurface) -> Floats:
    _, nearest = _polydata(surface).find_closest_cell(places, return_closest_point=True)
    far: Floats = np.linalg.norm(np.asarray(nearest) - places, axis=1)
    return far


def _cell_volumes(points: Points, cells: Indices) -> Floats:
    a, b, c, d = (points[cells[:, k]] for k in range(4))
    volumes: Floats = np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a)) / 6.0
    return volumes


def _wrong_facets(mended: TriSurface, points: Points, cells: Indices) -> int:
    """Faces shared by more than two cells, and faces of one that are not on the mended surface.

    A mesher may cut a facet at a point on it; so together they must have the surface's area, too.
    """
    faces = cells[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, inverse, counts = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    outer = TriSurface(points, faces[counts[inverse.reshape(-1)] == 1])
    far = _distances(_samples(outer), mended).reshape(outer.num_facets, -1).max(axis=1)
    size = float(np.ptp(mended.points, axis=0).max())
    off = int(np.count_nonzero(far > _ON_SURFACE * size))
    lost = abs(outer.area - mended.area) > _ON_SURFACE * mended.area
    return int(np.count_nonzero(counts > 2)) + off + int(lost)


def _wrong_places(points: Points, cells: Indices, sound: TriSurface, allowed: float) -> int:
    rng = np.random.default_rng(0)
    low, high = points.min(axis=0), points.max(axis=0)
    places = rng.uniform(low - 0.05 * (high - low), high + 0.05 * (high - low), (NUM_PLACES, 3))
    places = places[_distances(places, sound) > allowed]
    if not len(places):
        return 0
    return int(np.count_nonzero(_is_in_mesh(places, points, cells) != _is_within(places, sound)))


def _is_in_mesh(places: Points, points: Points, cells: Indices) -> NDArray[np.bool_]:
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, np.array(points))
    locator = vtkStaticCellLocator()
    locator.SetDataSet(grid)
    locator.BuildLocator()
    return np.array([locator.FindCell(place) >= 0 for place in places.tolist()])


def _is_within(places: Points, surface: TriSurface) -> NDArray[np.bool_]:
    """By the parity of rays."""
    enclosed = vtkSelectEnclosedPoints()
    enclosed.SetInputData(pyvista.PolyData(places))
    enclosed.SetSurfaceData(_polydata(surface))
    enclosed.SetTolerance(1e-9)
    enclosed.Update()
    flags = pyvista.wrap(enclosed.GetOutput()).point_data["SelectedPoints"]
    found: NDArray[np.bool_] = np.asarray(flags) == 1
    return found
