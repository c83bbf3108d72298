"""A candidate's own mesh, made fit to be judged on: the same body, at rest, in whole cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import MeshError
from palpate.meshes.quality import edge_lengths
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes
from palpate.validation.exchange.box_tree import BoxTree
from palpate.validation.exchange.point_location import Location, locate, locate_points
from palpate.validation.exchange.result_files import ResultFile, ResultFileError
from palpate.validation.exchange.surface_search import nearest_on_surface
from palpate.validation.states import CandidateFailedError

# Two places are the same within this part of the body's diagonal: what ASCII files with seven
# digits (single precision) keep.
_SAME_PLACE = 1e-6
# How far one mesh may stick out of the other, and their surfaces lie apart, in mean edge lengths
# of the coarser: chords cut corners off a curved surface.
OUTSIDE = 0.5
# How far the rest volumes may differ: chords again. More is another body.
OTHER_VOLUME = 0.1


@dataclass(frozen=True, eq=False)
class OwnAnswer:
    """An answer on a mesh of its own.

    Attributes:
        mesh: At rest.
        displacement: On it [m], (num_times, mesh.num_points, 3).
        case_points: Where the case's points lie in it.
        notes: What was done to it, for people.
    """

    mesh: TetMesh
    displacement: NDArray[np.float64]
    case_points: Location
    notes: tuple[str, ...]


def same_place(points: Points) -> float:
    """How far two places of a body may be apart [m] and still be the same."""
    return _SAME_PLACE * float(np.linalg.norm(np.ptp(points, axis=0)))


def own_answer(result: ResultFile, displacement: NDArray[np.float64], case: TetMesh) -> OwnAnswer:
    """The answer of a result with points and cells, on its own mesh.

    Points that no cell uses are left out; points at one place that move together are one; cells
    that are all numbered the other way round are turned. Each is said.

    Args:
        result: With points, and cells.
        displacement: Of its points [m], (num_times, num_points, 3).
        case: The case's mesh.

    Raises:
        ResultFileError: No cells, cells inverted at rest or shared wrongly, or another body.
        CandidateFailedError: Points at one place at rest move apart: the body is torn.
    """
    assert result.points is not None
    if result.cells is None or not len(result.cells):
        raise ResultFileError(
            result.path, "its points are not the case's and it has no tetrahedra to read between"
        )
    points, cells, notes = result.points, result.cells, []
    used, cells = np.unique(cells, return_inverse=True)
    cells = cells.reshape(-1, 4)
    if len(used) < len(points):
        notes.append(f"{len(points) - len(used)} point(s) that no cell uses are left out.")
    points, displacement = points[used], displacement[:, used]
    points, cells, displacement, note = _joined(points, cells, displacement, case)
    notes += note
    if (signed_volumes(points, cells.astype(np.int32)) < 0.0).all():
        cells = cells[:, [0, 2, 1, 3]]
        notes.append("Its cells are all numbered the other way round; they are turned.")
    try:
        mesh = TetMesh(points, cells.astype(np.int32))
    except MeshError as error:
        raise ResultFileError(result.path, f"its mesh cannot be used ({error})") from error
    _require_manifold(result, mesh)
    return OwnAnswer(mesh, displacement, _require_same_body(result, mesh, case), tuple(notes))


def _joined(
    points: Points, cells: NDArray[np.int64], displacement: NDArray[np.float64], case: TetMesh
) -> tuple[Points, NDArray[np.int64], NDArray[np.float64], list[str]]:
    """Points at one place made one.

    Where the case's own mesh has points at one place, of two bodies that touch, they are left.
    """
    tolerance = same_place(case.points)
    first = _first_at_place(points, tolerance)
    twice = np.flatnonzero(first != np.arange(len(points)))
    if (
        not twice.size
        or (_first_at_place(case.points, tolerance) != np.arange(case.num_points)).any()
    ):
        return points, cells, displacement, []
    apart = np.linalg.norm(displacement[:, twice] - displacement[:, first[twice]], axis=2).max(0)
    if apart.max() > tolerance:
        x, y, z = points[twice[apart.argmax()]]
        raise CandidateFailedError(
            f"{int((apart > tolerance).sum())} pair(s) of points at one place move apart, by up to "
            f"{apart.max():.3g} m at ({x:.4g}, {y:.4g}, {z:.4g}) m: the body is torn"
        )
    kept, cells = np.unique(first[cells], return_inverse=True)
    note = f"{twice.size} point(s) that lie on another are joined with it."
    return points[kept], cells.reshape(-1, 4), displacement[:, kept], [note]


def _first_at_place(points: Points, tolerance: float) -> NDArray[np.int64]:
    """For each point the first one at its place: itself where it is alone."""
    # Ever so many at one place are one before the tree sees them.
    steps = np.floor((points - points.min(axis=0)) / (0.25 * tolerance))
    _, kept, group = np.unique(steps, axis=0, return_index=True, return_inverse=True)
    places = points[kept]
    who, others = BoxTree(places - tolerance, places + tolerance).holding(places)
    lowest = kept.astype(np.int64)
    np.minimum.at(lowest, who, kept[others])
    first: NDArray[np.int64] = lowest[group.ravel()]
    lowest_of_all: NDArray[np.int64] = first[first]
    return lowest_of_all


def _require_manifold(result: ResultFile, mesh: TetMesh) -> None:
    facets = np.sort(mesh.cells[:, CELL_FACETS].reshape(-1, 3), axis=1)
    most = int(np.unique(facets, axis=0, return_counts=True)[1].max())
    if most > 2:
        raise ResultFileError(
            result.path, f"{most} of its cells share one facet; cells overlap or are given twice"
        )


def _require_same_body(result: ResultFile, mesh: TetMesh, case: TetMesh) -> Location:
    """Where the case's points lie in a mesh of the same body.

    Neither mesh may stick out of the other, nor their surfaces lie apart, by more than chords do.
    """
    coarser = max(float(edge_lengths(m.points, m.cells).mean()) for m in (mesh, case))
    limit = OUTSIDE * coarser
    case_points = locate(mesh.points, mesh.cells, case.points)
    for what, distances in (
        ("of the case's points lie outside its mesh", case_points.distances),
        ("of its points lie outside the body", locate_points(case, mesh).distances),
        ("places of the body's surface are not on its mesh's surface", _apart(case, mesh)),
        ("places of its mesh's surface are not on the body's surface", _apart(mesh, case)),
    ):
        far = int((distances > limit).sum())
        if far:
            raise ResultFileError(
                result.path,
                f"{far} {what}, one by {distances.max():.3g} m (at most {limit:.3g} m: {OUTSIDE:g} "
                "edge lengths); is it the same body, at rest?",
            )
    ratio = mesh.volume / case.volume
    if abs(ratio - 1.0) > OTHER_VOLUME:
        raise ResultFileError(
            result.path,
            f"its mesh has {ratio:.4g} times the body's volume at rest (at most {OTHER_VOLUME:.0%} "
            "more or less); is it the same body, at rest?",
        )
    return case_points


def _apart(mesh: TetMesh, other: TetMesh) -> Points:
    """Distance of the corners and middles of a mesh's boundary facets from another's boundary."""
    corners = mesh.points[mesh.boundary_facets]
    places = np.concatenate([mesh.points[np.unique(mesh.boundary_facets)], corners.mean(axis=1)])
    return nearest_on_surface(places, other.points, other.boundary_facets).distances
