"""Any valid surface is meshed: rough, thin, coarse, twisted and holed shapes, at any scale."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from perturbed_surfaces import polygon_plate

from palpate.fastsim import _core
from palpate.fastsim.mesher import MeshingReport, mesh_surface
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

Array = NDArray[np.float64]
Draw = Callable[[str, int], TriSurface | None]
Outward = Callable[[Array, NDArray[np.integer]], TriSurface]
# Sums of as many roundings as there are cells: 1e-12 leaves room for 1e4.
VOLUME_TOLERANCE = 1e-12


def require_kept(surface: TriSurface) -> tuple[TetMesh, MeshingReport]:
    """Meshes a surface; its points, facets and volume are those of the mesh."""
    reports: list[MeshingReport] = []
    mesh = mesh_surface(surface, report=reports.append)
    (report,) = reports
    assert report.boundary_steiner_points == 0
    np.testing.assert_array_equal(mesh.points[: len(surface.points)], surface.points)
    turned = [
        {tuple(np.roll(row, -int(np.argmin(row))).tolist()) for row in facets}
        for facets in (mesh.boundary_facets, surface.facets)
    ]
    assert turned[0] == turned[1]
    assert abs(mesh.volume / surface.volume - 1.0) < VOLUME_TOLERANCE
    for cell in mesh.cells:
        assert _core.orient3d(*(mesh.points[k].tolist() for k in cell)) == 1
    return mesh, report


def require_kept_moved(surface: TriSurface | None, change: Callable[[Array], Array]) -> None:
    """Meshes a surface after a change of its points, if that is valid."""
    assert surface is not None
    surface = TriSurface(change(surface.points), surface.facets)
    # Roundings of the change are part of the given points, and may fold coplanar facets.
    if len(_core.find_self_intersections(surface.points, surface.facets, 1)) == 0:
        require_kept(surface)


def test_any_shape_is_meshed(family: str, draw: Draw) -> None:
    draws = 1 if family == "notched_box" else 6
    surfaces = [s for s in (draw(family, seed) for seed in range(draws)) if s is not None]
    assert surfaces
    for surface in surfaces:
        require_kept(surface)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("family", ["torus", "knot", "extruded", "holed_plate"])
def test_any_scale(family: str, scale: float, draw: Draw) -> None:
    require_kept_moved(draw(family, 4), lambda points: scale * points)


@pytest.mark.parametrize("family", ["torus", "flat_ball", "flipped_ball", "nested"])
def test_far_from_the_origin(family: str, draw: Draw) -> None:
    require_kept_moved(draw(family, 4), lambda points: points + 1e3 * np.ptp(points))


@pytest.mark.parametrize("family", ["polycube", "holed_plate", "flipped_ball", "extruded"])
@pytest.mark.parametrize("thickness", [1.0, 0.01])
def test_turned_and_thin(family: str, thickness: float, draw: Draw) -> None:
    # Facets that were in one plane are so up to roundings only.
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for seed in (0, 1, 3, 4):
        surface = draw(family, seed)
        if surface is not None:
            require_kept_moved(surface, lambda points: (points * [1.0, 1.0, thickness]) @ turn)


def prism(turn_deg: float, diagonals: int) -> tuple[Array, NDArray[np.integer]]:
    """A triangular prism whose top is turned; one choice of diagonals folds its sides in."""
    angle = 2 * np.pi * np.arange(3) / 3
    rings = [
        np.column_stack([np.cos(t), np.sin(t), np.full(3, z)])
        for t, z in ((angle, 0.0), (angle + np.radians(turn_deg), 1.0))
    ]
    facets = [(0, 2, 1), (3, 4, 5)]
    for i in range(3):
        j = (i + 1) % 3
        if diagonals:
            facets += [(i, j, 3 + i), (j, 3 + j, 3 + i)]
        else:
            facets += [(i, j, 3 + j), (i, 3 + j, 3 + i)]
    return np.vstack(rings), np.array(facets)


@pytest.mark.parametrize("turn_deg", [10.0, 30.0, 55.0])
def test_schoenhardts_prism_takes_one_inner_point(turn_deg: float, outward: Outward) -> None:
    # Schoenhardt 1928: no tetrahedra on its six points alone. One point that sees all eight
    # facets makes eight; the other diagonals bulge and need none.
    mesh, report = require_kept(outward(*prism(turn_deg, diagonals=0)))
    assert (mesh.num_points, mesh.num_cells, report.steiner_points) == (7, 8, 1)
    mesh, report = require_kept(outward(*prism(turn_deg, diagonals=1)))
    assert (mesh.num_points, report.steiner_points) == (6, 0)


@pytest.mark.parametrize("sides", [64, 128])
@pytest.mark.parametrize("is_turned", [False, True])
def test_a_face_cut_from_one_corner(sides: int, is_turned: bool, outward: Outward) -> None:
    # Each needle of a face crosses many edges of a Delaunay mesh. Without flips in the plane the
    # mesh had 6.7 and 9 cells for each facet, a point for two, and with 128 sides turned no volume.
    plate = polygon_plate(sides).surface
    points, facets = plate.points, plate.facets
    if is_turned:
        points = points @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    mesh, report = require_kept(outward(points, facets))
    assert mesh.num_cells < 6 * len(facets)
    assert report.steiner_points < len(facets) / 8
