"""From a result file to displacements at the points of a case.

In this order: `original_id` says which point is which; points that lie where the case's lie are
matched by position; the same number of points without positions is taken in order; another mesh
of the same body is kept beside what it says at the case's points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import MeshError
from palpate.meshes.problem import Problem
from palpate.meshes.quality import edge_lengths
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes
from palpate.validation.exchange.point_location import (
    BoxTree,
    Location,
    locate,
    locate_points,
    nearest_on_surface,
)
from palpate.validation.exchange.result_files import ResultFile, ResultFileError
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


# A body this many times as large as the case's is in another unit.
_OTHER_UNIT = 2.0


@dataclass(frozen=True, eq=False)
class Placed:
    """A result at the points of a case.

    Attributes:
        displacement: [m], (num_times, num_points, 3).
        notes: What was done to get there, for people.
        own_mesh: The result's own mesh, where it has another than the case.
        own_displacement: On it [m], (num_times, num_own_points, 3).
        cauchy_stress: By the case's cells, or the own mesh's where there is one [Pa], (n, 3, 3).
    """

    displacement: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    own_mesh: TetMesh | None = None
    own_displacement: NDArray[np.float64] | None = None
    cauchy_stress: NDArray[np.float64] | None = None


def place(result: ResultFile, problem: Problem) -> Placed:
    """Bring a result to the case's points.

    Raises:
        ResultFileError: A wrong count, ids that name no point or one twice, or points that cannot
            be matched to the body.
        CandidateFailedError: NaN or infinity, or a body of quite another size: a unit error.
    """
    mesh = problem.mesh
    rest = mesh.points
    _require_finite(result)
    if result.original_id is not None:
        order = _by_id(result, len(rest))
        moved = _displacement(result.values[:, order], rest, result)
        return Placed(moved, cauchy_stress=_stress_of_cells(result, mesh, order))
    if result.points is None:
        if result.values.shape[1] != len(rest):
            raise ResultFileError(
                result.path,
                f"holds {result.values.shape[1]} points, the case {len(rest)}; send `original_id`, "
                "or a .vtu with the tetrahedra",
            )
        moved = _displacement(result.values, rest, result)
        return Placed(moved, cauchy_stress=_stress_of_cells(result, mesh))
    _require_same_size(result, rest)
    if len(result.points) == len(rest):
        found = _by_place(result, mesh)
        if found is not None:
            return found
    return _on_other_mesh(result, problem)


def _require_finite(result: ResultFile) -> None:
    bad = np.flatnonzero(~np.isfinite(result.values).all(axis=(0, 2)))
    if bad.size:
        raise CandidateFailedError(
            f"the answer holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}"
        )
    stress = result.cauchy_stress
    if stress is not None and not np.isfinite(stress).all():
        bad = np.flatnonzero(~np.isfinite(stress).all(axis=(1, 2)))
        raise CandidateFailedError(
            f"its cauchy_stress holds NaN or infinity in {bad.size} cell(s), first {int(bad[0])}"
        )
    if result.points is not None and not np.isfinite(result.points).all():
        raise ResultFileError(result.path, "its points hold NaN or infinity")


def _displacement(
    values: NDArray[np.float64], rest: Points, result: ResultFile
) -> NDArray[np.float64]:
    return values - rest if result.are_positions else values


def _by_id(result: ResultFile, num_points: int) -> NDArray[np.int64]:
    ids = result.original_id
    assert ids is not None
    if ids.min() < 0 or ids.max() >= num_points:
        raise ResultFileError(result.path, f"original_id lies outside 0..{num_points - 1}")
    order = np.full(num_points, -1)
    order[ids] = np.arange(len(ids))
    if len(ids) != num_points or (order < 0).any():
        missing = np.flatnonzero(order < 0)
        raise ResultFileError(
            result.path,
            f"original_id must name each of {num_points} points once; {missing.size} missing"
            + (f", first {int(missing[0])}" if missing.size else ""),
        )
    return order


def _require_same_size(result: ResultFile, rest: Points) -> None:
    assert result.points is not None
    ratio = float(np.ptp(result.points, axis=0).max() / np.ptp(rest, axis=0).max())
    if not 1.0 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        raise CandidateFailedError(
            f"its body is {ratio:.4g} times as large as the case's; say `length_unit`, or send "
            "metres"
        )


def _by_place(result: ResultFile, mesh: TetMesh) -> Placed | None:
    """Same points, in the case's order, in another order, or moved along with the body."""
    assert result.points is not None
    rest = mesh.points
    tolerance = same_place(rest)
    if np.abs(result.points - rest).max() <= tolerance:
        moved = _displacement(result.values, rest, result)
        return Placed(moved, cauchy_stress=_stress_of_cells(result, mesh))
    last = result.values[-1] if result.are_positions else rest + result.values[-1]
    if np.abs(result.points - last).max() <= tolerance:
        note = "The result's points are moved ones; taken in the case's order."
        moved = _displacement(result.values, rest, result)
        return Placed(moved, (note,), cauchy_stress=_stress_of_cells(result, mesh))
    order = _match_places(result.points, rest, tolerance)
    if order is None:
        return None
    note = "The result's points are in another order; matched by place."
    moved = _displacement(result.values[:, order], rest, result)
    return Placed(moved, (note,), cauchy_stress=_stress_of_cells(result, mesh, order))


def _stress_of_cells(
    result: ResultFile, mesh: TetMesh, order: NDArray[np.int64] | None = None
) -> NDArray[np.float64] | None:
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


def _match_places(points: Points, rest: Points, tolerance: float) -> NDArray[np.int64] | None:
    """For each rest point the one of `points` at its place; None unless it is one to one."""
    who, found = BoxTree(points - tolerance, points + tolerance).holding(rest)
    apart = np.abs(points[found] - rest[who]).max(axis=1)
    order = np.full(len(rest), -1)
    nearest_last = np.argsort(-apart, kind="stable")
    order[who[nearest_last]] = found[nearest_last]
    is_one_to_one = order.min() >= 0 and len(np.unique(order)) == len(order)
    return order if is_one_to_one else None


def _on_other_mesh(result: ResultFile, problem: Problem) -> Placed:
    assert result.points is not None
    moved = _displacement(result.values, result.points, result)
    own = own_answer(result, moved, problem.mesh)
    read = np.stack([own.case_points.read(own.mesh.cells, state) for state in own.displacement])
    distances = own.case_points.distances
    outside = int((distances > same_place(problem.mesh.points)).sum())
    note = (
        f"The result is on a mesh of its own with {own.mesh.num_cells} cells; judged there, and at "
        f"the case's points ({outside} of them up to {distances.max():.2g} m outside of it)."
    )
    stress = result.cauchy_stress
    return Placed(read, (note, *own.notes), own.mesh, own.displacement, stress)
