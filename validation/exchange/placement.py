"""From a result file to displacements at the points of a case.

In this order: `original_id` says which point is which; points that lie where the case's lie are
matched by position; the same number of points without positions is taken in order; another mesh
of the same body is stored beside its values at the case's points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import MeshError
from palpate.meshes.problem import Problem
from palpate.meshes.quality import edge_lengths
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes
from palpate.validation.exchange.point_location import (
    Location,
    locate,
    locate_points,
    nearest_on_surface,
)
from palpate.validation.exchange.result_files import ResultFile, ResultFileError
from palpate.validation.states import CandidateFailedError

Rows = NDArray[np.int64]
# Two points are the same within this part of the body's diagonal: what ASCII files with seven
# digits (single precision) keep.
_SAME_POSITION = 1e-6
# How far one mesh may stick out of the other, and their surfaces lie apart, in mean edge lengths
# of the coarser: chords cut corners off a curved surface.
_OUTSIDE = 0.5
# How far the rest volumes may differ: chords again. More is another body.
_OTHER_VOLUME = 0.1
# A body this many times as large as the case's is in another unit.
_OTHER_UNIT = 2.0


@dataclass(frozen=True, eq=False)
class MatchedResult:
    """A result at the points of a case.

    Attributes:
        displacement: [m], (num_times, num_points, 3).
        notes: What was done to get there, for people.
        own_mesh: The result's own mesh, where it has another than the case.
        own_displacement: Displacement on it [m], (num_times, num_own_points, 3).
        cauchy_stress: By the case's cells, or the own mesh's where there is one [Pa], (n, 3, 3).
    """

    displacement: Floats
    notes: tuple[str, ...] = ()
    own_mesh: TetMesh | None = None
    own_displacement: Floats | None = None
    cauchy_stress: Floats | None = None


def match_points(result: ResultFile, problem: Problem) -> MatchedResult:
    """Bring a result to the case's points.

    Raises:
        ResultFileError: A wrong count, ids that name no point or one twice, points that cannot
            be matched to the body, or a mesh of another body.
        CandidateFailedError: NaN or infinity, a body of quite another size (a unit error), or one
            that is torn.
    """
    mesh = problem.mesh
    _require_finite(result)
    order: Rows | None = None
    notes: tuple[str, ...] = ()
    if result.original_id is not None:
        order = _by_id(result, result.original_id, mesh.num_points)
    elif result.points is None:
        if result.values.shape[1] != mesh.num_points:
            raise ResultFileError(
                result.path,
                f"holds {result.values.shape[1]} points, the case {mesh.num_points}; send "
                "`original_id`, or a .vtu with the tetrahedra",
            )
    else:
        _require_same_size(result.points, mesh.points)
        tolerance = _same_position(mesh.points)
        matched = _matched(result, result.points, mesh.points, tolerance)
        if matched is None:
            return _on_own_mesh(result, result.points, mesh, tolerance)
        order, notes = matched
    values = result.values if order is None else result.values[:, order]
    moved = values - mesh.points if result.are_positions else values
    return MatchedResult(moved, notes, cauchy_stress=_stress_of_cells(result, mesh, order))


def _require_finite(result: ResultFile) -> None:
    bad = np.flatnonzero(~np.isfinite(result.values).all(axis=(0, 2)))
    if bad.size:
        good = np.isfinite(result.values).all(axis=(1, 2))
        since = ""
        if result.times is not None and len(result.times) == len(good):
            first = int(good.argmin())
            since = f", since {result.times[first]:.4g} s (state {first + 1} of {len(good)})"
        raise CandidateFailedError(
            f"the result holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}{since}"
        )
    if result.cauchy_stress is not None:
        bad = np.flatnonzero(~np.isfinite(result.cauchy_stress).all(axis=(1, 2)))
        if bad.size:
            raise CandidateFailedError(
                f"its cauchy_stress holds NaN or infinity in {bad.size} cell(s), first "
                f"{int(bad[0])}"
            )
    if result.points is not None and not np.isfinite(result.points).all():
        raise ResultFileError(result.path, "its points hold NaN or infinity")


def _by_id(result: ResultFile, ids: Rows, num_points: int) -> Rows:
    """The row of the result for each of the case's points."""
    if ids.min() < 0 or ids.max() >= num_points:
        raise ResultFileError(result.path, f"original_id lies outside 0..{num_points - 1}")
    order = np.full(num_points, -1)
    order[ids] = np.arange(len(ids))
    missing = np.flatnonzero(order < 0)
    if len(ids) != num_points or missing.size:
        raise ResultFileError(
            result.path,
            f"original_id must name each of {num_points} points once; {missing.size} missing"
            + (f", first {int(missing[0])}" if missing.size else ""),
        )
    return order


def _require_same_size(points: Points, rest: Points) -> None:
    ratio = float(np.ptp(points, axis=0).max() / np.ptp(rest, axis=0).max())
    if not 1.0 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        raise CandidateFailedError(
            f"its body is {ratio:.4g} times as large as the case's: send metres (an .npz may say "
            "another `length_unit`)"
        )


def _same_position(points: Points) -> float:
    """How far two points of a body may be apart [m] and still be the same."""
    return _SAME_POSITION * float(np.linalg.norm(np.ptp(points, axis=0)))


def _matched(
    result: ResultFile, points: Points, rest: Points, tolerance: float
) -> tuple[Rows | None, tuple[str, ...]] | None:
    """The result's point for each of the case's points; None unless it is one to one.

    They are in the case's order, or moved along with the body, or in another order.
    """
    if len(points) != len(rest):
        return None
    if np.abs(points - rest).max() <= tolerance:
        return None, ()
    last = result.values[-1] if result.are_positions else rest + result.values[-1]
    if np.abs(points - last).max() <= tolerance:
        return None, ("The result's points are moved ones; taken in the case's order.",)
    from scipy.spatial import cKDTree

    apart, order = cKDTree(points).query(rest, p=np.inf)
    if not apart.max() <= tolerance or len(np.unique(order)) < len(order):
        return None
    return order, ("The result's points are in another order; matched by position.",)


def _stress_of_cells(result: ResultFile, mesh: TetMesh, order: Rows | None) -> Floats | None:
    """What the result says of stress, in the order of the case's cells; None where it says none.

    Args:
        result: With cells that name its own points, or the case's cells in their order.
        mesh: The case's.
        order: For each of the case's points the result's; the same where None.

    Raises:
        ResultFileError: Not one for each of the case's cells.
    """
    stress = result.cauchy_stress
    if stress is None:
        return None
    if result.cells is None:
        if len(stress) != mesh.num_cells:
            raise ResultFileError(
                result.path,
                f"{len(stress)} rows of cauchy_stress, the case has {mesh.num_cells} cells; send "
                "them in the order of the case's, or a .vtu with the tetrahedra",
            )
        return stress
    number = np.arange(mesh.num_points)
    if order is not None:
        number[order] = np.arange(mesh.num_points)
    theirs = np.sort(number[result.cells], axis=1)
    ours = np.sort(mesh.cells, axis=1)
    first, second = np.lexsort(theirs.T), np.lexsort(ours.T)
    if len(theirs) != len(ours) or (theirs[first] != ours[second]).any():
        raise ResultFileError(
            result.path,
            "its cauchy_stress is of other tetrahedra than the case's, on the same points; send "
            "that of the case's cells, or none: it is then worked out from the displacement",
        )
    ordered = np.empty_like(stress)
    ordered[second] = stress[first]
    return ordered


def _on_own_mesh(
    result: ResultFile, points: Points, case: TetMesh, tolerance: float
) -> MatchedResult:
    """A result on a mesh of its own, and read from it at the case's points.

    Points that no cell uses are left out; points at one position that move together are one; cells
    that are all numbered the other way round are turned. Each is reported.

    Raises:
        ResultFileError: No cells, cells inverted at rest or shared wrongly, or another body.
        CandidateFailedError: Points at one position at rest move apart: the body is torn.
    """
    moved = result.values - points if result.are_positions else result.values
    if result.cells is None or not len(result.cells):
        raise ResultFileError(
            result.path, "its points are not the case's and it has no tetrahedra to read between"
        )
    notes = []
    used, cells = np.unique(result.cells, return_inverse=True)
    cells = cells.reshape(-1, 4)
    if len(used) < len(points):
        notes.append(f"{len(points) - len(used)} point(s) that no cell uses are left out.")
    points, moved = points[used], moved[:, used]
    first = _first_at_position(points, tolerance)
    twice = np.flatnonzero(first != np.arange(len(points)))
    # Where the case itself has points at one position, of two bodies that touch, they are left.
    case_first = _first_at_position(case.points, tolerance)
    if twice.size and (case_first == np.arange(case.num_points)).all():
        _require_joined(points, moved, twice, first[twice], tolerance)
        unique, cells = np.unique(first[cells], return_inverse=True)
        points, moved, cells = points[unique], moved[:, unique], cells.reshape(-1, 4)
        notes.append(f"{twice.size} point(s) that lie on another are joined with it.")
    if (signed_volumes(points, cells.astype(np.int32)) < 0.0).all():
        cells = cells[:, [0, 2, 1, 3]]
        notes.append("Its cells are all numbered the other way round; they are turned.")
    try:
        mesh = TetMesh(points, cells.astype(np.int32))
    except MeshError as error:
        raise ResultFileError(result.path, f"its mesh cannot be used ({error})") from error
    facets = np.sort(mesh.cells[:, CELL_FACETS].reshape(-1, 3), axis=1)
    most = int(np.unique(facets, axis=0, return_counts=True)[1].max())
    if most > 2:
        raise ResultFileError(
            result.path, f"{most} of its cells share one facet; cells overlap or are given twice"
        )
    case_points = _require_same_body(result, mesh, case)
    read = np.stack([case_points.read(mesh.cells, state) for state in moved])
    outside = int((case_points.distances > tolerance).sum())
    note = (
        f"The result is on a mesh of its own with {mesh.num_cells} cells; judged there, and at the "
        f"case's points ({outside} of them up to {case_points.distances.max():.2g} m outside of "
        "it)."
    )
    return MatchedResult(read, (note, *notes), mesh, moved, result.cauchy_stress)


def _first_at_position(points: Points, tolerance: float) -> Rows:
    """For each point the first one at its position: itself where it is alone."""
    from scipy.spatial import cKDTree

    # Ever so many at one position are one before the tree sees them.
    steps = np.floor((points - points.min(axis=0)) / (0.25 * tolerance))
    _, alone, group = np.unique(steps, axis=0, return_index=True, return_inverse=True)
    one, other = cKDTree(points[alone]).query_pairs(tolerance, p=np.inf, output_type="ndarray").T
    lowest = alone.astype(np.int64)
    np.minimum.at(lowest, one, alone[other])
    np.minimum.at(lowest, other, alone[one])
    first: Rows = lowest[group.ravel()]
    return first[first]


def _require_joined(
    points: Points, displacement: Floats, rows: Rows, others: Rows, tolerance: float
) -> None:
    apart = np.linalg.norm(displacement[:, rows] - displacement[:, others], axis=2).max(0)
    if apart.max() > tolerance:
        x, y, z = points[rows[apart.argmax()]]
        raise CandidateFailedError(
            f"{int((apart > tolerance).sum())} pair(s) of points at one position move apart, by up "
            f"to {apart.max():.3g} m at ({x:.4g}, {y:.4g}, {z:.4g}) m: the body is torn"
        )


def _require_same_body(result: ResultFile, mesh: TetMesh, case: TetMesh) -> Location:
    """Where the case's points lie in a mesh of the same body.

    Neither mesh may stick out of the other, nor their surfaces lie apart, by more than chords do.
    """
    coarser = max(float(edge_lengths(m.points, m.cells).mean()) for m in (mesh, case))
    limit = _OUTSIDE * coarser
    case_points = locate(mesh.points, mesh.cells, case.points)
    for what, distances in (
        ("of the case's points lie outside its mesh", case_points.distances),
        ("of its points lie outside the body", locate_points(case, mesh).distances),
        ("points of the body's surface are not on its mesh's surface", _apart(case, mesh)),
        ("points of its mesh's surface are not on the body's surface", _apart(mesh, case)),
    ):
        far = int((distances > limit).sum())
        if far:
            raise ResultFileError(
                result.path,
                f"{far} {what}, one by {distances.max():.3g} m (at most {limit:.3g} m: "
                f"{_OUTSIDE:g} edge lengths); is it the same body, at rest?",
            )
    ratio = mesh.volume / case.volume
    if abs(ratio - 1.0) > _OTHER_VOLUME:
        raise ResultFileError(
            result.path,
            f"its mesh has {ratio:.4g} times the body's volume at rest (at most "
            f"{_OTHER_VOLUME:.0%} more or less); is it the same body, at rest?",
        )
    return case_points


def _apart(mesh: TetMesh, other: TetMesh) -> Points:
    """Distance of the corners and middles of a mesh's boundary facets from another's boundary."""
    corners = mesh.points[mesh.boundary_facets]
    positions = np.concatenate([mesh.points[np.unique(mesh.boundary_facets)], corners.mean(axis=1)])
    return nearest_on_surface(positions, other.points, other.boundary_facets).distances
