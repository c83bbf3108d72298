"""What is wrong with a surface file is said by its numbers and places, with what mends it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.meshes.errors import FinError, InputError, OpenSurfaceError
from palpate.meshes.files import in_file_unit, read_mesh, write_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case.geometry import REMEDIES
from palpate.validation.cli import app

BALL = shape_sphere(20.0, edge_length=6.0)  # in millimetres
RUN = CliRunner()


def refused(path: Path, *options: str) -> str:
    done = RUN.invoke(app, ["mesh", str(path), "-o", str(path.with_suffix(".vtu")), *options])
    assert done.exit_code != 0
    return str(done.exception) if isinstance(done.exception, InputError) else done.output


def with_fin(body: TriSurface, row: int, count: int) -> TriSurface:
    a, b, _ = body.facets[row]
    tip = 1.3 * body.points[a] + 0.1 * body.points[b]
    points = np.vstack([body.points, tip, 1.4 * body.points[b]])[: len(body.points) + count]
    n = len(body.points)
    return TriSurface(points, np.vstack([body.facets, [[a, b, n], [b, n, n + 1]][:count]]))


@pytest.mark.parametrize(("suffix", "start"), [(".off", 0), (".obj", 1)])
def test_a_fin_is_no_hole_and_is_named_by_number_and_place(
    tmp_path: Path, suffix: str, start: int
) -> None:
    path = tmp_path / f"organ{suffix}"
    given = with_fin(BALL, 3, 1)
    write_surface(path, given)
    said = refused(path)
    x, y, z = given.points[given.facets[-1]].mean(axis=0)
    assert said == (
        f"organ{suffix}: 1 fin(s) of 1 facet(s) stand on the surface and end free, facet "
        f"{BALL.num_facets + start} at ({x:.6g}, {y:.6g}, {z:.6g}) mm (the file's first is "
        f"{start}); --repair (repair = true in a case) cuts fins off"
    )
    mended = RUN.invoke(app, ["mesh", str(path), "-o", str(tmp_path / "m.vtu"), "--repair"])
    assert mended.exit_code == 0
    assert f"volume {BALL.volume:.6g} mm3" in mended.output


def test_holes_are_counted_by_loops_and_not_of_fins() -> None:
    # One facet, all facets around a point, and two facets that touch at a point only.
    corners = BALL.facets[0]
    around = np.flatnonzero((BALL.facets == BALL.facets[-1][0]).any(axis=1))
    across = [
        f for f in range(1, BALL.num_facets)
        if len(np.intersect1d(BALL.facets[f], corners)) == 1
    ]  # fmt: skip
    for gone, count in (([0], 1), ([0, *around], 2), ([0, across[0]], 2)):
        torn = TriSurface(BALL.points, np.delete(BALL.facets, gone, axis=0))
        with pytest.raises(OpenSurfaceError) as caught:
            require_closed(torn)
        assert caught.value.num_holes == count
    both = with_fin(TriSurface(BALL.points, BALL.facets[1:]), 9, 2)
    with pytest.raises(OpenSurfaceError) as caught:
        require_closed(both)
    assert (caught.value.num_holes, len(caught.value.edges)) == (1, 3)
    with pytest.raises(FinError) as fin:
        require_closed(with_fin(BALL, 9, 2))
    assert (fin.value.num_fins, len(fin.value.facets)) == (1, 2)


def test_what_crosses_is_named_by_the_files_numbers_and_what_a_repair_leaves_is_not(
    tmp_path: Path,
) -> None:
    path = tmp_path / "organ.off"
    both = TriSurface(
        np.vstack([BALL.points, BALL.points + np.array([39.0, 0.0, 0.0])]),
        np.vstack([BALL.facets, BALL.facets + len(BALL.points)]),
    )
    write_surface(path, both)
    said = refused(path)
    assert said.startswith("organ.off: the surface intersects itself: ")
    assert "--repair (repair = true in a case) mends what cuts itself" in said
    assert ") mm" in said
    assert "facet " in said
    said = refused(path, "--repair", "--repair-distance", "0.001")
    assert "could not be mended within 0.001 mm" in said
    assert "--repair-distance D" in said
    assert "--wrap D" in said
    assert " m," not in said
    assert " m;" not in said


def test_every_kind_has_a_remedy_that_names_an_option() -> None:
    for before, after in REMEDIES.values():
        assert "--" in after
        assert "--" in before or not before


@pytest.mark.parametrize("unit", ["mm", "cm", "m"])
def test_the_boundary_is_the_files_bit_for_bit(tmp_path: Path, unit: str) -> None:
    path, out = tmp_path / "organ.off", tmp_path / "organ.vtu"
    body = shape_box((1.0, 1.1, 0.7), edge_length=0.3)
    given = TriSurface(body.points * 37.123 + np.array([0.1, 0.7, -0.3]), body.facets)
    write_surface(path, given)
    assert RUN.invoke(app, ["mesh", str(path), "-o", str(out), "--unit", unit]).exit_code == 0
    mesh = read_mesh(out)
    found = mesh.points[mesh.boundary_facets]
    here = {np.sort(f.view("V24").ravel()).tobytes() for f in np.ascontiguousarray(found)}
    there = {
        np.sort(f.view("V24").ravel()).tobytes()
        for f in np.ascontiguousarray(given.points[given.facets])
    }
    assert here == there


def test_points_that_the_file_does_not_have_are_scaled() -> None:
    given = np.array([[0.1, 0.7, 3.3], [1.0, 2.0, 3.0]])
    points = np.vstack([given[1:] * 1e-3, [[4e-3, 5e-3, 6e-3]]])
    own = in_file_unit(points, given, 1e-3)
    assert np.array_equal(own[0], given[1])
    assert own[1] == pytest.approx([4.0, 5.0, 6.0], rel=1e-15)
    assert np.array_equal(in_file_unit(points, None, 1e-3), points / 1e-3)
