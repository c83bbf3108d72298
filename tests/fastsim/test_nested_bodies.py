"""Bodies in each other and side by side: one conforming mesh, each surface preserved."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.mesher import MeshingError, mesh_surface
from palpate.fastsim.nested_bodies import CrossingBodiesError, mesh_bodies
from palpate.meshes.errors import InputError
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh
from palpate.meshes.tri_surface import TriSurface

ORGAN = shape_sphere(0.05, edge_length=0.012)
BALL = shape_sphere(0.02, edge_length=0.008)
BOX = shape_box((1.0, 1.0, 1.0), edge_length=0.25)
CORNER = shape_box((0.5, 0.5, 0.5), edge_length=0.25)


def moved(body: TriSurface, *shift: float, scale: float = 1.0) -> TriSurface:
    return TriSurface(scale * body.points + np.array(shift), body.facets)


def faces_of(mesh: TetMesh, name: str) -> set[tuple[bytes, ...]]:
    """Places of the corners of the faces that one cell of a group has alone."""
    faces = mesh.cells[mesh.cell_groups[name]][:, CELL_FACETS].reshape(-1, 3)
    _, inverse, counts = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return positions(mesh.points, faces[counts[inverse.reshape(-1)] == 1])


def positions(points: np.ndarray, facets: np.ndarray) -> set[tuple[bytes, ...]]:  # type: ignore[type-arg]
    return {tuple(sorted((p + 0.0).tobytes() for p in points[f])) for f in facets}


def require_conforming(mesh: TetMesh) -> None:
    faces = np.sort(mesh.cells[:, CELL_FACETS].reshape(-1, 3), axis=1)
    assert np.unique(faces, axis=0, return_counts=True)[1].max() == 2
    # No two points at one position: coincident points are shared.
    assert len(np.unique(mesh.points, axis=0)) == mesh.num_points
    cells = np.concatenate(list(mesh.cell_groups.values()))
    assert np.array_equal(np.sort(cells), np.arange(mesh.num_cells))


def test_an_organ_with_a_tumour_around_a_vessel() -> None:
    tumour = moved(BALL, 0.01, 0.0, 0.0)
    vessel = moved(BALL, 0.012, 0.002, 0.0, scale=0.4)
    mesh = mesh_bodies({"organ": ORGAN, "vessel": vessel, "tumour": tumour})
    require_conforming(mesh)
    within = {
        "organ": ORGAN.volume - tumour.volume,
        "tumour": tumour.volume - vessel.volume,
        "vessel": vessel.volume,
    }
    for name, volume in within.items():
        found = mesh.cell_volumes[mesh.cell_groups[name]].sum()
        assert found == pytest.approx(volume, rel=1e-12)
    assert faces_of(mesh, "vessel") == positions(vessel.points, vessel.facets)
    both = positions(tumour.points, tumour.facets) | positions(vessel.points, vessel.facets)
    assert faces_of(mesh, "tumour") == both
    assert positions(mesh.points, mesh.boundary_facets) == positions(ORGAN.points, ORGAN.facets)


def mirrored(body: TriSurface, at: float) -> TriSurface:
    """Mirrored in the plane x = at: a wall there has the same facets."""
    points = body.points * [-1.0, 1.0, 1.0] + np.array([2.0 * at, 0.0, 0.0])
    return TriSurface(points, body.facets[:, ::-1])


@pytest.mark.parametrize("is_within", [False, True])
def test_facets_in_common_with_the_body_and_with_each_other(is_within: bool) -> None:
    # In a corner of the body, whose facets there are its own; or two side by side within it.
    within = {"corner": CORNER}
    body = BOX
    if is_within:
        body = moved(BOX, -0.3, -0.4, -0.2, scale=2.0)
        within["beside"] = mirrored(CORNER, 0.5)
    mesh = mesh_bodies({"body": body, **within})
    require_conforming(mesh)
    for name, one in within.items():
        found = mesh.cell_volumes[mesh.cell_groups[name]].sum()
        assert found == pytest.approx(0.125, rel=1e-12)
        assert faces_of(mesh, name) == positions(one.points, one.facets)
    rest = mesh.cell_volumes[mesh.cell_groups["body"]].sum()
    assert rest == pytest.approx(body.volume - 0.125 * len(within), rel=1e-12)
    assert positions(mesh.points, mesh.boundary_facets) == positions(body.points, body.facets)


def test_bodies_side_by_side_are_one() -> None:
    other = TriSurface(
        BOX.points * [-1.0, 1.0, 1.0] + np.array([2.0, 0.0, 0.0]), BOX.facets[:, ::-1]
    )
    mesh = mesh_bodies({"body": BOX, "other": other})
    require_conforming(mesh)
    assert mesh.volume == pytest.approx(2.0, rel=1e-12)
    assert len(mesh.boundary_facets) == 2 * BOX.num_facets - 2 * 32


@pytest.mark.parametrize(
    ("shift", "scale", "why"),
    [((0.04, 0.0, 0.0), 1.0, "organ and tumour cut each other"), ((0.0, 0.0, 0.0), 1.0, "")],
)
def test_surfaces_that_cut_each_other_are_refused_with_facets_and_place(
    shift: tuple[float, float, float], scale: float, why: str
) -> None:
    given = {"organ": ORGAN, "tumour": moved(BALL, *shift, scale=scale)}
    if not why:
        require_conforming(mesh_bodies(given))
        return
    with pytest.raises(CrossingBodiesError, match=why) as caught:
        mesh_bodies(given)
    assert caught.value.names == ("organ", "tumour")
    for a, b in caught.value.pairs:
        one, other = ORGAN.points[ORGAN.facets[a]], given["tumour"].points[BALL.facets[b]]
        assert (one.min(axis=0) <= other.max(axis=0)).all()
        assert (other.min(axis=0) <= one.max(axis=0)).all()


def test_bodies_that_touch_at_a_point_the_same_twice_or_far_away_are_refused() -> None:
    corner = ORGAN.points[0]
    touching = moved(ORGAN, *(0.7 * corner), scale=0.3)
    points = touching.points.copy()
    points[0] = corner
    with pytest.raises(CrossingBodiesError, match="organ and tumour touch at points"):
        mesh_bodies({"organ": ORGAN, "tumour": TriSurface(points, ORGAN.facets)})
    with pytest.raises(InputError, match="tumour lies outside of organ"):
        mesh_bodies({"organ": ORGAN, "tumour": moved(BALL, 1.0, 0.0, 0.0)})
    with pytest.raises(InputError, match="are the same surface"):
        mesh_bodies({"organ": ORGAN, "tumour": ORGAN})


def test_a_region_with_a_point_on_a_facet_is_refused() -> None:
    def make(region: TriSurface, report: object) -> TetMesh:
        def with_a_point(_: object) -> None:
            report(type("Report", (), {"boundary_steiner_points": 1})())  # type: ignore[operator]

        return mesh_surface(region, report=with_a_point)

    with pytest.raises(MeshingError, match=r"organ: 1 point\(s\) would be needed on facets"):
        mesh_bodies({"organ": ORGAN}, make=make)
