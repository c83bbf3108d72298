"""Tetrahedra in a closed surface by improved Delaunay meshing: section II of the paper.

Steps 1 to 5 (circum-cube of five cells, lattice, jitter, interior points, insertion) and the
clean-up of slivers are in the core: its folders lattice, delaunay, recovery and slivers, and
mesher, which puts them together. The surface is preserved as given.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.grading.size_fields import SizeField, grid_of_sizes
from palpate.fastsim.surface_remesher import (
    RemeshReport,
    compact_facets,
    mean_edge_length,
    remesh_surface,
    require_no_self_intersection,
    require_solid,
)
from palpate.meshes.arrays import Indices, Points, checked_points
from palpate.meshes.errors import InputError, InvertedCellError
from palpate.meshes.percent import Percent
from palpate.meshes.shapes import require_positive
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

# Other lattices to try in the rare case that the boundary does not come back at all: another
# jitter and points nearer to the surface, then another size. (Shift of the seed, clearance, factor
# on the size.)
_ATTEMPTS = (
    (0, 0.80, 1.0),
    (1, 0.70, 1.0),
    (2, 0.80, 2.0),
)
# Cells with a dihedral angle below about 33 degrees are improved: sin 32.7 = 0.54.
_SLIVER_TARGET = 0.54
# Largest edge of a graded interior if no length is given, in mean edges of the surface.
LARGEST_GRADED = 8.0
# The work of sliver removal on graded interiors is bounded, in cells tried: they need 0.2 to 0.4 of
# it for each of their cells, small ones of twisted shapes up to 12 000 in all; a unit takes some
# 20 us. Uniform ones, which cases have, are worked on to the end: one twice as fine as its surface
# needs 7 for each cell.
_LEAST_WORK, _WORK_PER_CELL = 100_000, 1.0
_UNBOUNDED_WORK = 2**62
# Approximate number of cells of a mesh for each point of the surface, and each inside.
_CELLS_PER_POINT = (2.7, 6.0)
# Largest number of cubes of the lattice in the surface's box, empty ones too; each takes 70 ns.
_MOST_CUBES = 5e8
# Pairs of facets that an error names at most: a surface on itself has millions.
_MOST_PAIRS = 1000


class TimeLimitError(InputError):
    """The time was up before there was a mesh; `.time_limit` [s] and `.stage`."""

    def __init__(self, time_limit: float, stage: str) -> None:
        self.time_limit, self.stage = time_limit, stage
        super().__init__(
            f"no mesh within {time_limit:g} s: the time was up while {stage}; allow more, take "
            "longer edges, or better facets (a free boundary)"
        )


class MeshingError(InputError):
    """A surface that this mesher cannot mesh."""


class FlatPointsError(MeshingError):
    """Points that span no volume."""

    def __init__(self, num_points: int) -> None:
        super().__init__(f"the {num_points} points lie in one plane; there is nothing to mesh")


class DuplicatePointError(MeshingError):
    """Two points of the surface coincide; `.points` are their numbers."""

    def __init__(self, first: int, second: int) -> None:
        self.points = (first, second)
        super().__init__(
            f"points {first} and {second} of the surface are the same place; merge them"
        )


class BoundaryRecoveryError(MeshingError):
    """Facets that could not be brought into the mesh; `.facets` and `.edges` hold them."""

    def __init__(self, facets: Sequence[int], edges: Sequence[tuple[int, int]]) -> None:
        self.facets = [int(f) for f in facets]
        self.edges = [(int(a), int(b)) for a, b in edges]
        super().__init__(
            f"{len(self.edges)} edge(s) and {len(self.facets)} facet(s) of the surface could not "
            f"be kept, first edge {self.edges[:1]}, first facet {self.facets[:1]}; the surface "
            "may intersect itself there, or use a finer or rounder surface, or mesher gmsh"
        )


class Boundary(StrEnum):
    """Treatment of the given facets."""

    KEPT = "kept"
    FREE = "free"


class FlatCellError(MeshingError):
    """Cells positive by the exact predicate, but flat to rounding; `.cells` holds them.

    `position` is the middle of the first of them [m].
    """

    def __init__(self, cells: Sequence[int], position: Points) -> None:
        self.cells = [int(c) for c in cells]
        at = ", ".join(f"{x:.6g}" for x in position)
        super().__init__(
            f"the surface bounds a solid, but this mesher's best mesh of it has {len(self.cells)} "
            f"cell(s) without volume to rounding, the first around ({at}) m, where points or "
            "facets nearly coincide; better facets there would do"
        )


class Interior(StrEnum):
    """Change of the cell size away from the surface."""

    UNIFORM = "uniform"
    GRADED = "graded"


class Lattice(StrEnum):
    """Lattice of the candidates for inner points."""

    PAPER = "paper"
    BODY_CENTRED = "body_centred"


@dataclass(frozen=True)
class MeshingReport:
    """Counts of what the mesher did.

    Attributes:
        recovered_edges: Surface edges that were missing after insertion and flipped back.
        recovered_facets: Facets of the surface that had to be recovered.
        sliver_flips: Flips that made the worst cell better.
        sliver_moves: Inner points moved for the same end.
        sliver_insertions: Inner points added for the same end.
        steiner_points: Points put on edges and facets that flips alone did not bring back; all
            but `boundary_steiner_points` of them were moved inside or removed afterwards.
        boundary_steiner_points: Those that had to stay on the surface, at its facets to
            rounding; they follow the surface's points. With any, the mesh's boundary has more
            facets than were given.
        slivers_left: Cells with a dihedral angle below 10 degrees.
        is_cut_short: Whether sliver removal ended for the work that it had done, which is
            bounded in proportion to the cells where the interior is graded; the worst cells come
            first.
        attempts: Lattices tried.
        remesh: What was done to a free boundary; None if the surface was preserved.
    """

    recovered_edges: int
    recovered_facets: int
    sliver_flips: int
    sliver_moves: int
    sliver_insertions: int
    steiner_points: int
    boundary_steiner_points: int
    slivers_left: int
    is_cut_short: bool
    attempts: int
    remesh: RemeshReport | None = None


# Counted by the core, under the same names.
_COUNTS = [f.name for f in fields(MeshingReport) if f.name not in ("attempts", "remesh")]


def mesh_surface(
    surface: TriSurface,
    *,
    edge_length: float | None = None,
    size_field: SizeField | None = None,
    interior: Interior = Interior.UNIFORM,
    lattice: Lattice = Lattice.BODY_CENTRED,
    improve: bool = True,
    boundary: Boundary = Boundary.KEPT,
    boundary_distance: float | None = None,
    seed: int = 0,
    least_altitude: float = 0.0,
    lengthens_step: bool = False,
    time_limit: float | None = None,
    progress: Callable[[str], None] | None = None,
    report: Callable[[MeshingReport], None] | None = None,
) -> TetMesh:
    """Fill a closed surface with tetrahedra, keeping its points and facets.

    Args:
        surface: Closed, outward, without self-intersection [m].
        edge_length: Wanted edge length inside [m], > 0; None takes the surface's mean. With a
            size field, the largest.
        size_field: Smaller edge lengths where wanted, from positions [m], shape (n, 3), to lengths
            [m], shape (n,); see `grading.size_fields`. Preserved facets bound it near the
            surface; a free boundary follows it.
        interior: Graded: from the surface inwards cells grow by layers, each twice the last, to
            `edge_length`, or where that is None to eight of the surface's mean edges.
            Uniform: as fine as the surface throughout, unless `edge_length` asks for other.
        lattice: The paper's cubes, or body-centred ones, whose cells are better shaped.
        improve: Re-mesh slivers with their neighbours (the paper's last step).
        boundary: Whether the surface's facets are preserved, or may be replaced by better ones.
        boundary_distance: How far a free boundary may lie from the given one [m], > 0; see
            `surface_remesher`.
        seed: Seed of the jitter; the same seed gives the same mesh.
        least_altitude: Cells with a smaller altitude are improved as slivers are [m]; 0 takes what
            the surface's thinnest facet and mean edge suggest.
        lengthens_step: Improve the cells that decide the time step at the end, at the price of
            angles down to 27 degrees. Without it a mesh stays what earlier versions made.
        time_limit: Seconds after which there is an error and no mesh, > 0; None is no limit.
        progress: Called with a line for each stage, and how much there is to do; after two seconds
            also with the part that is done, in per cent.
        report: Called at the end with a report of the mesher.

    Returns:
        A mesh whose first points are the surface's and whose boundary facets are the
        surface's; every cell is positive by the exact predicate, and the volume is the
        surface's. Only where a point had to be left on a facet is that facet cut at it: seen on
        Chazelle's polyhedra with hundreds of facets in common planes, and stated in the report.

    Raises:
        InputError: A size field that gives no size, or asks for too many cells.
        SurfaceError: The surface does not bound a solid, or intersects itself.
        MeshingError: This mesher cannot mesh the surface; the message states why.
        TimeLimitError: The time was up.
        RemeshError: No free boundary within the distance.
    """
    if time_limit is not None:
        require_positive(time_limit=time_limit)
    end = math.inf if time_limit is None else time.monotonic() + time_limit

    def time_left(stage: str) -> float:
        left = end - time.monotonic()
        if left <= 0.0:
            assert time_limit is not None
            raise TimeLimitError(time_limit, stage)
        return left

    percent = Percent(progress)

    def tell(stage: str, amount: int, done: float) -> None:
        percent(stage, done)
        if progress is None or amount == 0:
            return
        if stage == "inserting points":
            inner = amount - len(points)
            cells = _CELLS_PER_POINT[0] * len(points) + _CELLS_PER_POINT[1] * inner
            progress(f"inserting {amount} points, some {cells:.2g} cells expected")
        else:
            progress(f"{stage}: {amount}")

    remesh = None
    if boundary is Boundary.FREE:
        if boundary_distance is None:
            raise InputError("a free boundary needs boundary_distance: how far it may move [m]")
        surface, remesh = remesh_surface(
            surface,
            distance=boundary_distance,
            edge_length=edge_length,
            size_field=size_field,
            progress=progress,
        )
    require_solid(surface)
    used, facets = compact_facets(surface)
    points = np.ascontiguousarray(surface.points[used])
    size = mean_edge_length(points, facets) if edge_length is None else edge_length
    require_positive(edge_length=size)
    require_no_self_intersection(points, facets, most=_MOST_PAIRS)
    if size_field is not None and lattice is Lattice.PAPER:
        raise InputError("the paper's cubes are all alike; a size field needs body-centred ones")
    grows_inwards = interior is Interior.GRADED
    if grows_inwards:
        if lattice is Lattice.PAPER:
            raise InputError("the paper's cubes are all alike; a graded interior needs the others")
        if edge_length is None:
            size *= LARGEST_GRADED
    _refuse_too_many_cubes(points, size)
    sizes = grid_of_sizes(points, size, size_field)
    kind = _core.Lattice.cubic if lattice is Lattice.PAPER else _core.Lattice.body_centred
    # The paper's jitter must break the cubes' symmetry; a body-centred lattice needs none.
    jitter = 0.1 if lattice is Lattice.PAPER else 0.01
    failure: MeshingError | None = None
    best: tuple[TetMesh, MeshingReport] | None = None
    for attempt, (shift, clearance, factor) in enumerate(_ATTEMPTS, start=1):
        if progress:
            progress(f"meshing {len(facets)} facets, edge length {size:.3g} m, try {attempt}")
        made = _core.mesh_surface(
            points,
            facets,
            kind,
            factor * size,
            jitter,
            clearance,
            seed + shift,
            grows_inwards,
            _SLIVER_TARGET,
            20 if improve else 0,
            least_altitude,
            _LEAST_WORK if grows_inwards else _UNBOUNDED_WORK,
            _WORK_PER_CELL,
            lengthens_step,
            sizes,
            time_left("looking at the surface"),
            tell,
        )
        if made.stopped_in:
            assert time_limit is not None
            raise TimeLimitError(time_limit, made.stopped_in)
        if made.equal_points[0] >= 0:
            raise DuplicatePointError(*(int(used[point]) for point in made.equal_points))
        cells = made.cells
        if len(cells) == 0:
            edges = [(int(used[a]), int(used[b])) for a, b in made.missing_edges]
            failure = BoundaryRecoveryError(made.missing_facets, edges)
            continue
        try:
            mesh = TetMesh(made.points, cells)
        except InvertedCellError as error:
            failure = FlatCellError(error.cells, made.points[cells[error.cells[0]]].mean(axis=0))
            continue
        counts = {name: getattr(made, name) for name in _COUNTS}
        is_kept = made.boundary_steiner_points == 0
        if is_kept or best is None:
            best = mesh, MeshingReport(**counts, attempts=attempt, remesh=remesh)
        if is_kept:
            require_boundary(facets, mesh)
            break
    if best is None:
        assert failure is not None
        raise failure
    if report:
        report(best[1])
    return best[0]


def _refuse_too_many_cubes(points: Points, size: float) -> None:
    """The lattice fills the box around all parts, however far apart they lie."""
    extents = points.max(axis=0) - points.min(axis=0)
    cubes = float(np.prod(np.maximum(extents / size, 1.0)))
    if not cubes <= _MOST_CUBES:
        raise MeshingError(
            f"an edge length of {size:.3g} m asks for {cubes:.0e} cubes in a box of "
            f"{extents.max():.3g} m, more than {_MOST_CUBES:.0e}: take a longer one, or mesh parts "
            "that lie far apart one by one"
        )


def largest_edge(surface: TriSurface) -> float:
    """Largest edge of a graded interior if no length is given [m]."""
    return LARGEST_GRADED * mean_edge_length(surface.points, surface.facets)


def delaunay(points: Points) -> tuple[Indices, list[int]]:
    """Delaunay tetrahedra of points: their convex hull, cut into cells of empty circumspheres.

    Exact for any input; points on one sphere are resolved by a symbolic perturbation, so that
    no cell is flat and the same points always give the same cells.

    Args:
        points: [m], shape (num_points, 3), finite.

    Returns:
        Cells, shape (num_cells, 4), positive by the exact predicate; and the points left out
        because an equal one is in the mesh, in ascending order.

    Raises:
        FlatPointsError: All points lie in one plane.
    """
    cells, duplicates, is_flat = _core.delaunay(np.array(checked_points(points)))
    if is_flat:
        raise FlatPointsError(len(points))
    return cells, duplicates


def require_boundary(facets: Indices, mesh: TetMesh) -> None:
    """Refuse a mesh whose boundary, found from its cells alone, is not the surface's facets.

    Raises:
        BoundaryRecoveryError: With the facets that are not there.
    """
    if _core.is_boundary(np.ascontiguousarray(facets), mesh.cells):
        return

    def in_order(rows: Indices) -> Indices:
        # Corners ascending, then rows; one number for two corners sorts faster than two.
        ascending = np.sort(rows, axis=1)
        a, b, c = ascending.astype(np.int64).T
        order = np.lexsort([c, (a << 31) | b])
        ordered: Indices = ascending[order]
        return ordered

    found = _core.find_boundary_facets(mesh.cells, mesh.num_points)
    if not np.array_equal(in_order(facets), in_order(found)):
        kept = set(map(tuple, np.sort(found, axis=1).tolist()))
        lost = [
            k for k, row in enumerate(np.sort(facets, axis=1).tolist()) if tuple(row) not in kept
        ]
        raise BoundaryRecoveryError(lost, [])
