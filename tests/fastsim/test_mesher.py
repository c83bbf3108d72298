"""The mesher: surface and volume are preserved, cells are positive and not slivers."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fastsim import _core
from palpate.fastsim.mesher import (
    BoundaryRecoveryError,
    DuplicatePointError,
    Interior,
    Lattice,
    MeshingError,
    MeshingReport,
    mesh_surface,
    require_boundary,
)
from palpate.meshes.errors import InputError
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.quality import dihedral_angles, edge_lengths, measure_quality
from palpate.meshes.shapes import shape_beam, shape_box, shape_cylinder, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes
from palpate.meshes.tri_surface import (
    OpenSurfaceError,
    SelfIntersectionError,
    SurfaceError,
    TriSurface,
)

# Volumes are sums of as many roundings as there are cells: 1e-12 leaves room for 1e4.
VOLUME_TOLERANCE = 1e-12

SHAPES: dict[str, Callable[[], TriSurface]] = {
    "box": lambda: shape_box((0.1, 0.08, 0.06), edge_length=0.015),
    "beam": lambda: shape_beam(0.2, 0.02, 0.02, edge_length=0.007),
    "cylinder": lambda: shape_cylinder(0.03, 0.1, edge_length=0.01),
    "sphere": lambda: shape_sphere(0.05, edge_length=0.01),
    "kidney": lambda: shape_kidney(edge_length=0.008),
}


def _require_kept(surface: TriSurface, mesh: TetMesh) -> None:
    np.testing.assert_array_equal(mesh.points[: len(surface.points)], surface.points)

    def turned(facets: np.ndarray[tuple[int, ...], np.dtype[np.int32]]) -> set[tuple[int, ...]]:
        return {tuple(np.roll(row, -int(np.argmin(row))).tolist()) for row in facets}

    assert turned(mesh.boundary_facets) == turned(surface.facets)
    assert abs(mesh.volume / surface.volume - 1.0) < VOLUME_TOLERANCE
    for cell in mesh.cells[:: max(1, len(mesh.cells) // 200)]:
        assert _core.orient3d(*(mesh.points[k].tolist() for k in cell)) == 1


def test_parts_too_far_apart_for_one_lattice_are_refused_at_once() -> None:
    ball = shape_sphere(1.0, edge_length=0.4)
    both = TriSurface(
        np.vstack([ball.points, ball.points + 1e3]),
        np.vstack([ball.facets, ball.facets + len(ball.points)]),
    )
    with pytest.raises(MeshingError, match="mesh parts that lie far apart one by one"):
        mesh_surface(both)


@pytest.mark.parametrize("name", SHAPES)
def test_built_in_shapes(name: str) -> None:
    surface = SHAPES[name]()
    mesh = mesh_surface(surface)
    _require_kept(surface, mesh)
    # Half the angle of the regular tetrahedron's 70.5 degrees is out of reach where facets meet
    # at right angles; 15 is what the project promises.
    assert np.degrees(dihedral_angles(mesh.points, mesh.cells).min()) > 15.0


def test_the_papers_lattice_keeps_the_surface_too() -> None:
    surface = SHAPES["sphere"]()
    _require_kept(surface, mesh_surface(surface, lattice=Lattice.PAPER))


def test_a_graded_interior_has_few_cells_and_keeps_the_surface() -> None:
    surface = shape_sphere(0.05, edge_length=0.004)
    fine = mesh_surface(surface)
    graded = mesh_surface(surface, interior=Interior.GRADED)
    _require_kept(surface, graded)
    # 6 cells to a facet at most, whatever the number of facets: the inside costs next to nothing.
    assert graded.num_cells < 6 * surface.num_facets < 0.5 * fine.num_cells
    assert measure_quality(graded).smallest_dihedral_deg > 20.0
    # A stated length bounds it: no cell is much longer.
    lengths = edge_lengths(graded.points, graded.cells)
    bounded = mesh_surface(surface, interior=Interior.GRADED, edge_length=0.01)
    assert lengths.max() > 0.02 > edge_lengths(bounded.points, bounded.cells).max()
    with pytest.raises(InputError, match="cubes"):
        mesh_surface(surface, interior=Interior.GRADED, lattice=Lattice.PAPER)


def test_slivers_are_there_without_the_clean_up() -> None:
    surface = SHAPES["kidney"]()
    raw = mesh_surface(surface, improve=False)
    repaired = mesh_surface(surface)
    smallest = [np.degrees(dihedral_angles(m.points, m.cells).min()) for m in (raw, repaired)]
    assert smallest[0] < 5.0 < smallest[1]


def test_the_report_counts_the_slivers_that_are_left() -> None:
    # A plate with facets of 4 degrees, whose cells can be no better, and a ball beside it.
    ball = shape_sphere(1.0, edge_length=0.5)
    beside = TriSurface(ball.points + np.array([3.0, 0.0, 0.0]), ball.facets)
    surface = _joined(shape_box((1.0, 1.0, 0.04), edge_length=0.5), beside)
    reports: list[MeshingReport] = []
    mesh = mesh_surface(surface, report=reports.append)
    smallest = np.degrees(dihedral_angles(mesh.points, mesh.cells)).min(axis=1)
    count = int((smallest < 10.0).sum())
    assert 0 < count < mesh.num_cells
    assert reports[0].slivers_left == count


def _joined(*parts: TriSurface) -> TriSurface:
    offsets = np.cumsum([0, *(len(p.points) for p in parts)])
    return TriSurface(
        np.vstack([p.points for p in parts]),
        np.vstack([p.facets + k for p, k in zip(parts, offsets, strict=False)]).astype(np.int32),
    )


def _inward(surface: TriSurface) -> TriSurface:
    return TriSurface(surface.points, np.ascontiguousarray(surface.facets[:, ::-1]))


def test_a_cavity_stays_empty() -> None:
    outer = shape_sphere(0.05, edge_length=0.012)
    inner = shape_sphere(0.025, edge_length=0.012)
    surface = _joined(outer, _inward(inner))
    mesh = mesh_surface(surface)
    _require_kept(surface, mesh)
    assert mesh.volume < outer.volume - 0.99 * inner.volume


def _torus(radius: float, across: int, around: int) -> TriSurface:
    u, v = np.meshgrid(
        np.arange(around) * 2 * np.pi / around,
        np.arange(across) * 2 * np.pi / across,
        indexing="ij",
    )
    width = 1.0 + radius * np.cos(v)
    points = np.stack([width * np.cos(u), width * np.sin(u), radius * np.sin(v)], axis=-1)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    i, j = i.ravel(), j.ravel()
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    facets = np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return TriSurface(points.reshape(-1, 3), facets.astype(np.int32))


@pytest.mark.parametrize("radius", [0.2, 0.4])
def test_a_ring_keeps_its_hole(radius: float) -> None:
    surface = _torus(radius, 12, 32)
    mesh = mesh_surface(surface)
    _require_kept(surface, mesh)
    # No cell reaches across the hole.
    centres = mesh.points[mesh.cells].mean(axis=1)
    assert np.hypot(centres[:, 0], centres[:, 1]).min() > 1.0 - radius


def test_same_seed_same_mesh_other_seed_another() -> None:
    surface = SHAPES["sphere"]()
    first, again, other = (mesh_surface(surface, seed=s) for s in (0, 0, 1))
    np.testing.assert_array_equal(first.cells, again.cells)
    np.testing.assert_array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)


def test_shells_that_cross_are_refused() -> None:
    ball = shape_sphere(0.05, edge_length=0.02)
    moved = TriSurface(ball.points + np.array([0.03, 0.001, 0.002]), ball.facets)
    with pytest.raises(SelfIntersectionError) as caught:
        mesh_surface(_joined(ball, moved))
    first, second = np.array(caught.value.pairs).T
    # Every pair joins the two shells, never two facets of one.
    assert (first < ball.num_facets).all()
    assert (second >= ball.num_facets).all()


def _crosses(points: list[list[float]], segment: tuple[int, int], facet: tuple[int, ...]) -> bool:
    """For points of which no four lie in one plane."""
    p, q = (points[k] for k in segment)
    a, b, c = (points[k] for k in facet)
    turns = {_core.orient3d(p, q, *pair) for pair in ((a, b), (b, c), (c, a))}
    return _core.orient3d(a, b, c, p) != _core.orient3d(a, b, c, q) and len(turns) == 1


def test_facets_at_one_point_that_cross_are_found_and_no_others() -> None:
    random = np.random.default_rng(3)
    facets = np.array([[0, 1, 2], [0, 3, 4]], dtype=np.int32)
    met = 0
    for _ in range(400):
        points = random.normal(size=(5, 3))
        rows = points.tolist()
        wanted = _crosses(rows, (1, 2), (0, 3, 4)) or _crosses(rows, (3, 4), (0, 1, 2))
        assert len(_core.find_self_intersections(points, facets, 5)) == wanted
        met += wanted
    assert 40 < met < 360


def test_self_intersections_are_those_of_all_pairs() -> None:
    random = np.random.default_rng(5)
    ball = shape_sphere(1.0, edge_length=0.6)
    for size in (0.0, 0.05, 0.3, 0.5):
        points = ball.points + size * random.normal(size=ball.points.shape)
        wanted = [
            [i, j]
            for j in range(ball.num_facets)
            for i in range(j)
            if len(_core.find_self_intersections(points, ball.facets[[i, j]], 1))
        ]
        found = _core.find_self_intersections(points, ball.facets, 10**6).tolist()
        assert found == sorted(wanted)
        assert bool(wanted) == (size > 0.1)
        assert _core.find_self_intersections(points, ball.facets, 3).tolist() == found[:3]


def test_faces_that_only_touch_are_refused() -> None:
    box = shape_box((1.0, 1.0, 1.0), edge_length=0.5)
    beside = TriSurface(box.points + np.array([1.0, 0.25, 0.125]), box.facets)
    with pytest.raises(SelfIntersectionError):
        mesh_surface(_joined(box, beside))


def test_open_surfaces_are_refused() -> None:
    surface = SHAPES["sphere"]()
    with pytest.raises(OpenSurfaceError):
        mesh_surface(TriSurface(surface.points, surface.facets[1:]))


def _is_plain(surface: TriSurface) -> bool:
    return _core.is_plain_shell(surface.points, surface.facets)


@pytest.mark.parametrize("name", SHAPES)
def test_most_surfaces_are_plain_shells(name: str) -> None:
    assert _is_plain(SHAPES[name]())


@pytest.mark.parametrize(
    "perturb",
    [
        "no facets", "open", "inward", "one turned", "one twice", "one of no area", "a fin",
        "two shells", "shells that touch at a point", "two facets on each other", "no volume",
    ],
)  # fmt: skip
def test_what_needs_a_longer_look_is_no_plain_shell(perturb: str) -> None:
    ball = SHAPES["sphere"]()
    points, facets = ball.points.copy(), ball.facets.copy()
    count = len(points)
    if perturb == "no facets":
        facets = facets[:0]
    elif perturb == "open":
        facets = facets[1:]
    elif perturb == "inward":
        facets = facets[:, ::-1]
    elif perturb == "one turned":
        facets[5] = facets[5, ::-1]
    elif perturb == "one twice":
        facets = np.vstack([facets, facets[5:6]])
    elif perturb == "one of no area":
        # An edge split on one side alone would leave it open: the point lies on it on both.
        a, b, c = facets[5]
        beside = np.flatnonzero((np.isin(facets, [a, b]).sum(axis=1) == 2) & (facets != c).all(1))
        d = facets[beside[0]][~np.isin(facets[beside[0]], [a, b])][0]
        points = np.vstack([points, [0.5 * (points[a] + points[b])]])
        gone = np.delete(facets, [5, beside[0]], axis=0)
        new = [[a, count, c], [count, b, c], [a, b, count], [b, a, d]]
        facets = np.vstack([gone, new]).astype(np.int32)
    elif perturb == "a fin":
        points = np.vstack([points, 1.1 * points[:1]])
        facets = np.vstack([facets, [[*facets[5, :2], count]]]).astype(np.int32)
    elif perturb == "two shells":
        points = np.vstack([points, points + 1.0])
        facets = np.vstack([facets, facets + count])
    elif perturb == "shells that touch at a point":
        other = np.where(facets == 0, 0, facets + count)
        points = np.vstack([points, 2.0 * points[0] - points])
        facets = np.vstack([facets, other[:, ::-1]])
    elif perturb == "two facets on each other":
        facets = np.array([facets[5], facets[5, ::-1]])
    else:
        points[:, 2] = 0.0
    assert not _is_plain(TriSurface(points, facets))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_a_plain_shell_is_closed(seed: int) -> None:
    # Half of the surfaces are whole: then both say so.
    random = np.random.default_rng(seed)
    ball = shape_sphere(0.05, edge_length=0.03)
    facets = ball.facets.copy()
    for _ in range(int(random.integers(0, 3))):
        facets[random.integers(len(facets)), random.integers(3)] = random.integers(len(ball.points))
    surface = TriSurface(ball.points, facets)
    try:
        require_closed(surface)
    except SurfaceError:
        assert not _is_plain(surface)
    else:
        assert _is_plain(surface)


def test_equal_points_are_refused_by_name() -> None:
    # Two boxes with one corner at the same position, under two numbers.
    box = shape_box((1.0, 1.0, 1.0), edge_length=0.5)
    with pytest.raises((DuplicatePointError, SelfIntersectionError)):
        mesh_surface(_joined(box, TriSurface(box.points + 1.0, box.facets)))


@given(
    st.lists(st.floats(-0.15, 0.15), min_size=6, max_size=6),
    st.sampled_from([1e-6, 1.0, 1e6]),
)
@settings(max_examples=15, deadline=None)
def test_any_smooth_blob(bumps: list[float], scale: float) -> None:
    ball = shape_sphere(1.0, edge_length=0.35)
    x, y, z = ball.points.T
    radius = 1.0 + np.array([x * y, y * z, z * x, x**3, y**2 - z**2, z**3]).T @ bumps
    surface = TriSurface(scale * radius[:, None] * ball.points, ball.facets)
    _require_kept(surface, mesh_surface(surface))


def test_cells_follow_a_surface_that_is_finer_at_one_end() -> None:
    # An inversion keeps angles and turns the ball into one whose edges are 25 times as long at
    # one pole as at the other: lengths go with 1 / distance^2, distances from 0.5 to 2.5.
    ball = shape_sphere(edge_length=0.15)
    arm = ball.points - [0.0, 0.0, 1.5]
    points = arm / (arm**2).sum(axis=1)[:, None]
    surface = TriSurface(points, np.ascontiguousarray(ball.facets[:, ::-1]))
    mesh = mesh_surface(surface, edge_length=0.6)
    lengths = edge_lengths(mesh.points, mesh.cells).mean(axis=1)
    low, high = points[:, 2].min(), points[:, 2].max()
    height = (mesh.points[mesh.cells].mean(axis=1)[:, 2] - low) / (high - low)
    assert lengths[height > 0.9].mean() < 0.3 * lengths[height < 0.3].mean()
    # Sizes change gradually: no angle is sacrificed to the change.
    assert measure_quality(mesh).smallest_dihedral_deg > 20.0


def test_no_cell_is_much_thinner_than_the_thinnest_facet() -> None:
    # Small cells set the time step of explicit runs.
    surface = shape_kidney(edge_length=9e-3)
    corners = surface.points[surface.facets]
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max(axis=1)
    thinnest = (2.0 * np.linalg.norm(surface.area_vectors, axis=1) / longest).min()
    mesh = mesh_surface(surface)
    facets = mesh.points[mesh.cells][:, CELL_FACETS]
    normals = np.cross(facets[:, :, 1] - facets[:, :, 0], facets[:, :, 2] - facets[:, :, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=2).max(axis=1)
    altitudes = 3.0 * signed_volumes(mesh.points, mesh.cells) / areas
    assert altitudes.min() > 0.6 * thinnest


def _fan_about_one_point(num_cells: int) -> TetMesh:
    """Cells around one edge: each corner of it is in all of them."""
    angle = 2.0 * np.pi * np.arange(num_cells) / num_cells
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(num_cells)], axis=1)
    k = np.arange(num_cells) + 2
    ahead = np.roll(k, -1)
    zero, one = np.zeros_like(k), np.ones_like(k)
    points = np.vstack([[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], ring])
    return TetMesh(points, np.stack([zero, k, ahead, one], axis=1).astype(np.int32))


@pytest.mark.parametrize("of", ["kidney", "fan"])
def test_boundary_facets_are_those_of_one_cell(of: str) -> None:
    mesh = mesh_surface(SHAPES["kidney"]()) if of == "kidney" else _fan_about_one_point(90)
    found = _core.find_boundary_facets(mesh.cells, mesh.num_points)
    np.testing.assert_array_equal(found, mesh.boundary_facets)
    # A cell that is there twice pairs with itself; three times, each of its sides is single again.
    for copies, single in ((2, 0), (3, 4)):
        cells = np.repeat(mesh.cells[:1], copies, axis=0)
        assert len(_core.find_boundary_facets(cells, mesh.num_points)) == single


@pytest.mark.parametrize(
    "perturb", ["a cell is gone", "a facet is not wanted", "another is wanted"]
)
def test_a_boundary_that_is_not_the_surface_is_refused(perturb: str) -> None:
    surface = SHAPES["sphere"]()
    mesh, facets = mesh_surface(surface), surface.facets
    require_boundary(facets[::-1], mesh)
    assert _core.is_boundary(facets[::-1].copy(), mesh.cells)
    assert not _core.is_boundary(facets[:, ::-1].copy(), mesh.cells)
    if perturb == "a cell is gone":
        behind = np.isin(mesh.cells, facets[7]).sum(axis=1) == 3
        mesh = TetMesh(mesh.points, mesh.cells[~behind])
    elif perturb == "a facet is not wanted":
        facets = facets[:-1]
    else:
        facets = np.vstack([facets, facets[:1] + np.array([0, 0, 1])]).astype(np.int32)
    assert not _core.is_boundary(facets, mesh.cells)
    with pytest.raises(BoundaryRecoveryError) as caught:
        require_boundary(facets, mesh)
    assert (7 in caught.value.facets) == (perturb == "a cell is gone")
