"""The body of a case: from files and shapes to a mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh, write_surface
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case import load_case

Write = Callable[..., Path]


def test_paths_may_not_leave_the_folder(write_case: Write, tmp_path: Path) -> None:
    outside = tmp_path.parent / f"{tmp_path.name}-outside.stl"
    write_surface(outside, shape_sphere(1.0, edge_length=0.5))
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    for name in (f"../{outside.name}", str(outside)):
        with pytest.raises(InputError, match="outside the case's folder"):
            load_case(write_case((shape, f'surface = "{name}"'))).problem  # noqa: B018
    (tmp_path / "link.stl").symlink_to(outside)
    with pytest.raises(InputError, match="outside the case's folder"):
        load_case(write_case((shape, 'surface = "link.stl"'))).problem  # noqa: B018


def test_bad_geometry_files_are_refused(write_case: Write, tmp_path: Path) -> None:
    sphere = shape_sphere(1.0, edge_length=0.5)
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    write_surface(tmp_path / "open.off", TriSurface(sphere.points, sphere.facets[1:]))
    with pytest.raises(InputError, match=r"open\.off.*open"):
        load_case(write_case((shape, 'surface = "open.off"'))).problem  # noqa: B018
    write_surface(tmp_path / "nan.off", sphere)
    text = (tmp_path / "nan.off").read_text().splitlines()
    text[5] = "nan 0 0"
    (tmp_path / "nan.off").write_text("\n".join(text))
    with pytest.raises(InputError, match=r"nan\.off"):
        load_case(write_case((shape, 'surface = "nan.off"'))).problem  # noqa: B018
    with pytest.raises(InputError, match="no such file"):
        load_case(write_case((shape, 'surface = "none.off"'))).problem  # noqa: B018


def test_a_surface_of_ones_own_is_meshed_and_the_mesher_named(
    write_case: Write, tmp_path: Path
) -> None:
    sphere = shape_sphere(1.0, edge_length=0.5)
    moved = sphere.points + np.array([1.0, 0.5, 0.5])
    moved = sphere.points + np.array([1.0, 0.5, 0.5])
    write_surface(tmp_path / "mine.stl", TriSurface(moved, sphere.facets))
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    case = load_case(
        write_case((shape, 'surface = "mine.stl"'), ("0.001", "0.5"), ("1.999", "1.5"))
    )
    assert "fastsim" in case.mesh.origin
    assert case.problem.mesh.volume == pytest.approx(sphere.volume, rel=1e-6)


def test_a_surface_with_a_hole_is_mended_on_request_and_the_origin_says_so(
    write_case: Write, tmp_path: Path
) -> None:
    sphere = shape_sphere(1.0, edge_length=0.5)
    torn = TriSurface(sphere.points + np.array([1.0, 0.5, 0.5]), sphere.facets[1:])
    write_surface(tmp_path / "torn.off", torn)
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    surface = 'surface = "torn.off"\nrepair = true'
    case = load_case(write_case((shape, surface), ("0.001", "0.5"), ("1.999", "1.5")))
    assert "1 hole(s) closed by 1 facet(s)" in case.mesh.origin
    assert case.problem.mesh.volume == pytest.approx(sphere.volume, rel=1e-12)
    small = surface + "\nlargest_hole = 2"
    with pytest.raises(InputError, match="allow holes of 3 edges"):
        load_case(write_case((shape, small), ("0.001", "0.5"), ("1.999", "1.5"))).mesh  # noqa: B018
    alone = 'surface = "torn.off"\nlargest_hole = 20'
    with pytest.raises(InputError, match="takes no largest_hole"):
        load_case(write_case((shape, alone)))
    wrap = 'surface = "torn.off"\nwrap = 0.3'
    case = load_case(write_case((shape, wrap), ("0.001", "0.5"), ("1.999", "1.5")))
    assert "wrapped by" in case.mesh.origin
    with pytest.raises(InputError, match="takes no repair"):
        load_case(write_case((shape, wrap + "\nrepair = true")))
    with pytest.raises(InputError, match="takes no repair"):
        load_case(write_case((shape, shape + "\nrepair = true")))


def test_a_surface_that_faces_inwards_is_turned_and_the_origin_says_so(
    write_case: Write, tmp_path: Path
) -> None:
    sphere = shape_sphere(1.0, edge_length=0.5)
    given = TriSurface(sphere.points + np.array([1.0, 0.5, 0.5]), sphere.facets[:, ::-1])
    write_surface(tmp_path / "turned.off", given)
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    places = ("0.001", "0.5"), ("1.999", "1.5")
    case = load_case(write_case((shape, 'surface = "turned.off"'), *places))
    said = f"{len(given.facets)} facet(s) of bodies that faced inwards turned round"
    assert said in case.mesh.origin
    assert case.problem.mesh.volume == pytest.approx(sphere.volume, rel=1e-12)
    too_fine = 'surface = "turned.off"\nwrap = 1e-9'
    with pytest.raises(InputError, match=r"turned\.off: .* would do"):
        load_case(write_case((shape, too_fine), *places)).mesh  # noqa: B018


def test_a_graded_mesh_says_so(write_case: Write) -> None:
    coarse = load_case(write_case())
    grade = "[[mesh.grade]]\n{}\nsmallest = 0.1\n[material]"
    path = write_case(("[material]", grade.format("point = [2.0, 1.0, 1.0]")))
    fine = load_case(path)
    assert fine.problem.mesh.num_cells > 2 * coarse.problem.mesh.num_cells
    assert "graded to" in fine.mesh.origin
    assert fine.problem.mesh.volume == pytest.approx(coarse.problem.mesh.volume, rel=1e-12)
    for bad in ("", "point = [0.0, 0.0, 0.0]\nboundary = true"):
        with pytest.raises(InputError, match="exactly one of point"):
            load_case(write_case(("[material]", grade.format(bad))))


def test_a_mesh_file_in_millimetres(write_case: Write, tmp_path: Path) -> None:
    source = load_case(write_case()).problem.mesh
    write_mesh(tmp_path / "block.vtu", source)
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    path = write_case(
        (shape, 'mesh = "block.vtu"'), ("[geometry]", '[units]\nlength="mm"\n[geometry]')
    )
    mesh = load_case(path).problem.mesh
    assert math.isclose(mesh.volume, 2e-9, rel_tol=1e-12)
    assert np.array_equal(mesh.cells, source.cells)
