"""The independent mesher keeps the boundary, or says why not."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.gmsh_mesher import MesherFailedError, mesh_with_gmsh
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.quality import measure_quality
from palpate.meshes.shapes import (
    shape_box,
    shape_hollow_octant,
    shape_hollow_sphere,
    shape_sphere,
    shape_tube,
)
from palpate.meshes.tri_surface import OpenSurfaceError, TriSurface

gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))


def test_the_kidneys_facets_and_volume_are_kept() -> None:
    surface = shape_kidney(edge_length=12e-3)
    mesh = mesh_with_gmsh(surface)
    wanted = {tuple(row) for row in np.sort(surface.facets, axis=1).tolist()}
    assert {tuple(row) for row in np.sort(mesh.boundary_facets, axis=1).tolist()} == wanted
    assert np.array_equal(mesh.points[: len(surface.points)], surface.points)
    assert mesh.volume == pytest.approx(surface.volume, rel=1e-12)
    assert measure_quality(mesh).smallest_dihedral_deg > 10.0


def test_a_hollow_ball_with_a_ball_in_it_is_meshed_where_it_is_solid() -> None:
    ball = shape_sphere(1.0, edge_length=0.5)
    parts = [(4.0, 1), (2.0, -1), (1.0, 1)]
    surface = TriSurface(
        np.vstack([radius * ball.points for radius, _ in parts]),
        np.vstack(
            [ball.facets[:, ::way] + k * len(ball.points) for k, (_, way) in enumerate(parts)]
        ),
    )
    mesh = mesh_with_gmsh(surface, edge_length=1.5)
    assert mesh.volume == pytest.approx((64 - 8 + 1) * ball.volume, rel=1e-12)


@pytest.mark.parametrize(
    "surface",
    [
        shape_hollow_sphere(2.0, 1.0, edge_length=0.8),
        shape_hollow_octant(2.0, 1.0, edge_length=0.5),
        shape_tube(2.0, 1.2, 3.0, edge_length=0.8),
    ],
    ids=["hollow_sphere", "hollow_octant", "tube"],
)
def test_the_hollow_shapes_keep_their_facets_and_hold_nothing_in_the_hollow(
    surface: TriSurface,
) -> None:
    mesh = mesh_with_gmsh(surface)
    wanted = {tuple(row) for row in np.sort(surface.facets, axis=1).tolist()}
    assert {tuple(row) for row in np.sort(mesh.boundary_facets, axis=1).tolist()} == wanted
    assert mesh.volume == pytest.approx(surface.volume, rel=1e-12)
    assert measure_quality(mesh).smallest_dihedral_deg > 5.0


def test_an_open_surface_is_refused_before_gmsh_sees_it() -> None:
    box = shape_box(edge_length=0.5)
    with pytest.raises(OpenSurfaceError):
        mesh_with_gmsh(TriSurface(box.points, box.facets[1:]))


def test_gmsh_out_of_time_is_said() -> None:
    with pytest.raises(MesherFailedError, match="did not end"):
        mesh_with_gmsh(shape_box(edge_length=0.5), time_limit=0.01)
