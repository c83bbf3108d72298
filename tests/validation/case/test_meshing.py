"""Bodies of cases: shapes, files, inclusions, and what is wrong with a surface."""

import math
import re

import numpy as np
import pytest
from case_texts import BOX
from judged import judge
from typer.testing import CliRunner

import palpate
from palpate.fastsim.grading.size_fields import mean_edges
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.files import in_file_unit, read_mesh, write_mesh, write_surface
from palpate.meshes.problem import Strain
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.tri_surface import (
    FinError,
    OpenSurfaceError,
    SelfIntersectionError,
    TriSurface,
)
from palpate.validation.case import load_case, meshing
from palpate.validation.case.geometry import REMEDIES
from palpate.validation.cli import app
from palpate.validation.states import Verdict


def test_paths_may_not_leave_the_folder(write_case, tmp_path):
    outside = tmp_path.parent / f"{tmp_path.name}-outside.stl"
    write_surface(outside, shape_sphere(1.0, edge_length=0.5))
    (tmp_path / "link.stl").symlink_to(outside)
    for name in (f"../{outside.name}", str(outside), "link.stl"):
        with pytest.raises(InputError, match="outside the case's folder"):
            _ = load_case(write_case((BOX, f'surface = "{name}"'))).problem


SPHERE = shape_sphere(1.0, edge_length=0.5)
GIVEN = {
    "whole": SPHERE.facets,
    "torn": SPHERE.facets[1:],
    "inwards": SPHERE.facets[:, ::-1],
}


@pytest.fixture
def of_file(write_case, tmp_path):
    """The case of a ball as one of those, in a file, with other keys of its geometry."""

    def of_file(given, keys="", name="ball.off"):
        surface = TriSurface(SPHERE.points + np.array([1.0, 0.5, 0.5]), GIVEN[given])
        write_surface(tmp_path / name, surface)
        ends = ("0.001", "0.5"), ("1.999", "1.5")
        return load_case(write_case((BOX, f'surface = "{name}"\n{keys}'), *ends))

    return of_file


@pytest.mark.parametrize(
    ("given", "keys", "origin"),
    [
        ("whole", "", "meshed by fastsim"),
        ("torn", "repair = true", "1 hole(s) closed by 1 facet(s)"),
        ("torn", "wrap = 0.3", "wrapped by"),
        ("inwards", "", f"{SPHERE.num_facets} facet(s) of bodies that faced inwards turned round"),
    ],
)
def test_a_surface_is_meshed_and_what_was_done_is_said(of_file, given, keys, origin):
    case = of_file(given, keys)
    assert origin in case.mesh.origin
    if "wrap" not in keys:
        assert case.problem.mesh.volume == pytest.approx(SPHERE.volume, rel=1e-12)


def test_a_binary_stl_is_a_surface_too(of_file):
    mesh = of_file("whole", name="ball.stl").problem.mesh
    assert mesh.volume == pytest.approx(SPHERE.volume, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "keys", "reason"),
    [
        ("torn", "", r"ball\.off.*open"),
        ("torn", "repair = true\nlargest_hole = 2", "allow holes of 3 edges"),
        ("inwards", "wrap = 1e-9", r"ball\.off: .* would do"),
    ],
)
def test_what_bounds_no_solid_is_refused(of_file, given, keys, reason):
    with pytest.raises(InputError, match=reason):
        _ = of_file(given, keys).mesh


@pytest.mark.parametrize("mesher", ["fastsim", "gmsh"])
@pytest.mark.parametrize("at", [(1.0, 0.1, -2.0), (1.0, 0.1, 0.5)], ids=["across", "touching"])
def test_shells_that_cross_or_touch_are_named_by_every_mesher(mesher, at):
    beam = shape_box((4.0, 0.5, 0.5), edge_length=4.0)
    other = shape_box((0.5, 0.5, 4.0), edge_length=4.0)
    points = np.vstack([beam.points, other.points + np.array(at)])
    facets = np.vstack([beam.facets, other.facets + len(beam.points)])
    with pytest.raises(SelfIntersectionError) as caught:
        palpate.mesh(TriSurface(points, facets), mesher=mesher)
    count = len(beam.facets)
    assert all((a < count) != (b < count) for a, b in caught.value.pairs)


def test_files_that_are_not_there_or_hold_nan_are_refused(write_case, tmp_path):
    write_surface(tmp_path / "nan.off", SPHERE)
    text = (tmp_path / "nan.off").read_text().splitlines()
    text[5] = "nan 0 0"
    (tmp_path / "nan.off").write_text("\n".join(text))
    for name, reason in (("nan.off", r"nan\.off"), ("none.off", "no such file")):
        with pytest.raises(InputError, match=reason):
            _ = load_case(write_case((BOX, f'surface = "{name}"'))).mesh


def test_a_graded_mesh_says_so(write_case):
    coarse = load_case(write_case())
    grade = "[[mesh.grade]]\n{}\nsmallest = 0.1\n[material]"
    path = write_case(("[material]", grade.format("point = [2.0, 1.0, 1.0]")))
    fine = load_case(path)
    assert fine.problem.mesh.num_cells > 2 * coarse.problem.mesh.num_cells
    assert "graded to" in fine.mesh.origin
    assert fine.problem.mesh.volume == pytest.approx(coarse.problem.mesh.volume, rel=1e-12)


def test_a_mesh_file_in_millimetres(write_case, tmp_path):
    source = load_case(write_case()).problem.mesh
    write_mesh(tmp_path / "block.vtu", source)
    path = write_case(
        (BOX, 'mesh = "block.vtu"'), ("[geometry]", '[units]\nlength="mm"\n[geometry]')
    )
    mesh = load_case(path).problem.mesh
    assert math.isclose(mesh.volume, 2e-9, rel_tol=1e-12)
    assert np.array_equal(mesh.cells, source.cells)


def test_a_mesh_file_is_graded_with_its_groups(write_case, tmp_path):
    source = load_case(write_case()).problem.mesh
    left = source.points[source.cells].mean(axis=1)[:, 0] < 1.0
    groups = {"left": np.flatnonzero(left).astype(np.int32)}
    own = TetMesh(source.points, source.cells, cell_groups=groups)
    write_mesh(tmp_path / "block.msh", own, groups=True)
    grade = "[[mesh.grade]]\npoint = [2.0, 1.0, 1.0]\nsmallest = 0.1\n[material]"
    case = load_case(write_case((BOX, 'mesh = "block.msh"'), ("[material]", grade)))
    mesh = case.mesh.mesh
    assert case.mesh.origin == f"read from block.msh; graded to {mesh.num_cells} cells"
    middles = mesh.points[mesh.cells].mean(axis=1)
    near = np.linalg.norm(middles - [2.0, 1.0, 1.0], axis=1) < 0.2
    assert near.any()
    assert mean_edges(mesh.points, mesh.cells[near]).max() <= 0.1 * (1.0 + 1e-9)
    volumes = signed_volumes(mesh.points, mesh.cells)
    whole = signed_volumes(source.points, source.cells)[left].sum()
    assert volumes[mesh.cell_groups["left"]].sum() == pytest.approx(whole, rel=1e-12)


TUMOUR = shape_sphere(0.3, edge_length=0.3)
PLACED = TriSurface(TUMOUR.points + np.array([0.9, 0.5, 0.5]), TUMOUR.facets)
INCLUSION = """[[inclusion]]
surface = "tumour.off"
material = { youngs_modulus = 5000.0, poissons_ratio = 0.4 }

[[support]]"""


def case_with_tumour(write_case, folder, *changes):
    write_surface(folder / "tumour.off", PLACED)
    return write_case(("[[support]]", INCLUSION), *changes)


def test_the_cells_within_the_surface_have_its_material(write_case, tmp_path):
    case = load_case(case_with_tumour(write_case, tmp_path))
    mesh = case.problem.mesh
    (inclusion,) = case.problem.inclusions
    assert inclusion.material.youngs_modulus == 5000.0
    volume = mesh.cell_volumes[inclusion.cells].sum()
    assert volume == pytest.approx(PLACED.volume, rel=1e-12)
    assert mesh.volume == pytest.approx(2.0, rel=1e-12)
    assert tmp_path / "tumour.off" in case.files
    assert "of inclusion 1" in case.mesh.origin


def test_what_does_not_go_with_it_is_refused(write_case, tmp_path):
    def refused(*changes):
        with pytest.raises(InputError) as caught:
            _ = load_case(case_with_tumour(write_case, tmp_path, *changes)).problem
        return str(caught.value)

    both = 'surface = "tumour.off"\nregion = { group = "x" }'
    assert "exactly one of region, surface, label" in refused(('surface = "tumour.off"', both))
    assert "do not go with them" in refused(("[material]", '[mesh]\nmesher = "gmsh"\n[material]'))
    assert "no such file" in refused(('"tumour.off"', '"none.off"'))
    small = BOX.replace("[2.0, 1.0, 1.0]", "[2.0, 1.0, 0.5]")
    said = refused((BOX, small))
    assert "body and tumour.off cut each other" in said
    assert "of body and facet " in said
    millimetres = ("[geometry]", '[units]\nlength = "mm"\n[geometry]')
    assert ") mm" in refused((BOX, small), millimetres)


@pytest.mark.dolfinx
@pytest.mark.long
def test_both_solvers_agree_on_two_materials(write_case, tmp_path):
    case = load_case(case_with_tumour(write_case, tmp_path))
    result = judge(case, live=True)
    same = [c for c in result.checks if c.metric == "displacement_l2"]
    assert same
    assert {c.verdict for c in same} == {Verdict.PASSED}
    assert {c.strain for c in same} <= set(Strain)


def test_the_command_makes_groups_in_the_files_own_numbers(tmp_path):
    body = shape_box((2.0, 1.0, 1.0), edge_length=0.5)
    organ = TriSurface(37.1 * body.points, body.facets)
    tumour = TriSurface(37.1 * PLACED.points, PLACED.facets)
    for name, surface in (("organ", organ), ("tumour", tumour)):
        write_surface(tmp_path / f"{name}.off", surface)
    words = ["mesh", str(tmp_path / "organ.off"), "-o", str(tmp_path / "out.vtu")]
    within = f"tumour={tmp_path / 'tumour.off'}"
    done = CliRunner().invoke(app, [*words, "--inclusion", within])
    assert done.exit_code == 0, done.output
    mesh = read_mesh(tmp_path / "out.vtu")
    assert set(mesh.cell_groups) == {"body", "tumour"}
    found = mesh.cell_volumes[mesh.cell_groups["tumour"]].sum()
    assert found == pytest.approx(tumour.volume, rel=1e-12)
    there = {p.tobytes() for p in mesh.points + 0.0}
    assert {p.tobytes() for p in np.vstack([organ.points, tumour.points]) + 0.0} <= there
    for wrong, why in (("tumour", "NAME=FILE"), (f"body={within}", "is taken")):
        bad = CliRunner().invoke(app, [*words, "--inclusion", wrong])
        assert why in f"{bad.output}{bad.exception}"


BALL = shape_sphere(20.0, edge_length=6.0)  # in millimetres
RUN = CliRunner()


def refused(path, *options):
    done = RUN.invoke(app, ["mesh", str(path), "-o", str(path.with_suffix(".vtu")), *options])
    assert done.exit_code != 0
    return str(done.exception) if isinstance(done.exception, InputError) else done.output


def test_a_distance_is_suggested_that_lengthens_a_step_which_one_facet_decides(tmp_path):
    """As typed; without the thin facet nothing is suggested."""
    ball = shape_sphere(30.0, edge_length=8.0)

    def run(points, facets, *options):
        path = tmp_path / "ball.off"
        write_surface(path, TriSurface(points, facets))
        done = RUN.invoke(app, ["mesh", str(path), "-o", str(tmp_path / "m.vtu"), *options])
        assert done.exit_code == 0, done.output
        step = re.search(r"critical time step (\S+) mm / c", done.output)
        distance = re.search(r"times shorter than .* --free (\S+) may", done.output)
        return float(step[1]), distance and distance[1]

    assert run(ball.points, ball.facets)[1] is None
    # A point in a facet, near one of its edges.
    a, b, c = ball.facets[5]
    point = np.array([[0.498, 0.498, 0.004]]) @ ball.points[[a, b, c]]
    new = len(ball.points)
    facets = np.vstack([np.delete(ball.facets, 5, axis=0), [[a, b, new], [b, c, new], [c, a, new]]])
    points = np.vstack([ball.points, point])
    short, distance = run(points, facets.astype(np.int32))
    longer, again = run(points, facets.astype(np.int32), "--free", distance)
    assert longer > 10.0 * short
    assert again is None


def with_fin(body, row, count):
    a, b, _ = body.facets[row]
    tip = 1.3 * body.points[a] + 0.1 * body.points[b]
    points = np.vstack([body.points, tip, 1.4 * body.points[b]])[: len(body.points) + count]
    n = len(body.points)
    return TriSurface(points, np.vstack([body.facets, [[a, b, n], [b, n, n + 1]][:count]]))


@pytest.mark.parametrize(("suffix", "start"), [(".off", 0), (".obj", 1)])
def test_a_fin_is_no_hole_and_is_named_by_number_and_position(tmp_path, suffix, start):
    path = tmp_path / f"organ{suffix}"
    given = with_fin(BALL, 3, 1)
    write_surface(path, given)
    said = refused(path)
    x, y, z = given.points[given.facets[-1]].mean(axis=0)
    assert said == (
        f"organ{suffix}: 1 fin(s) of 1 facet(s) stand on the surface and end free, facet "
        f"{BALL.num_facets + start} at ({x:.6g}, {y:.6g}, {z:.6g}) mm (the file's first is "
        f"{start}); --repair (repair = true in a case) cuts thin fins off"
    )
    repaired = RUN.invoke(app, ["mesh", str(path), "-o", str(tmp_path / "m.vtu"), "--repair"])
    assert repaired.exit_code == 0
    assert f"volume {BALL.volume:.6g} mm3" in repaired.output


def test_holes_are_counted_by_loops_and_not_of_fins():
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


def test_what_crosses_is_named_by_the_files_numbers_and_what_a_repair_leaves_is_not(tmp_path):
    path = tmp_path / "organ.off"
    both = TriSurface(
        np.vstack([BALL.points, BALL.points + np.array([39.0, 0.0, 0.0])]),
        np.vstack([BALL.facets, BALL.facets + len(BALL.points)]),
    )
    write_surface(path, both)
    said = refused(path)
    assert said.startswith("organ.off: the surface intersects itself: ")
    assert "--repair (repair = true in a case) repairs what cuts itself" in said
    assert ") mm" in said
    assert "facet " in said
    said = refused(path, "--repair", "--repair-distance", "0.001")
    assert "--repair-distance D" in said
    assert "--wrap D" in said
    (enough,) = re.findall(r"a repair distance of ([\d.]+) mm would allow it", said)
    arguments = ["mesh", str(path), "-o", str(tmp_path / "m.vtu"), "--repair"]
    done = RUN.invoke(app, [*arguments, "--repair-distance", enough])
    assert done.exit_code == 0
    assert "cut each other" in done.output
    assert "volume [mm3]" in done.output
    # What is refused may be wrapped, and what is repaired as well.
    wrapped = RUN.invoke(app, [*arguments[:-1], "--wrap", "4"])
    assert wrapped.exit_code == 0
    assert "wrapped by" in wrapped.output
    wrapped = RUN.invoke(app, [*arguments, "--repair-distance", "0.001", "--wrap", "4", "--force"])
    assert wrapped.exit_code == 0
    assert "wrapped as given, since no repair succeeded: the repair goes too far" in wrapped.output
    assert " m," not in said
    assert " m;" not in said


def test_every_kind_has_a_remedy_that_names_an_option():
    for before, after in REMEDIES.values():
        assert "--" in after
        assert "--" in before or not before


@pytest.mark.parametrize("unit", ["mm", "cm", "m"])
def test_the_boundary_is_the_files_bit_for_bit(tmp_path, unit):
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


def test_points_that_the_file_does_not_have_are_scaled():
    given = np.array([[0.1, 0.7, 3.3], [1.0, 2.0, 3.0]])
    points = np.vstack([given[1:] * 1e-3, [[4e-3, 5e-3, 6e-3]]])
    own = in_file_unit(points, given, 1e-3)
    assert np.array_equal(own[0], given[1])
    assert own[1] == pytest.approx([4.0, 5.0, 6.0], rel=1e-15)
    assert np.array_equal(in_file_unit(points, None, 1e-3), points / 1e-3)


def test_a_case_says_how_far_its_meshing_is_in_per_cent_and_no_more(monkeypatch) -> None:
    def slow(_spec, _folder, progress):
        for line in ("inserting 1677 points", "improving cells: 39 %"):
            progress(line)
        return meshing.BuiltMesh(brick_box((1, 1, 1), (1.0, 1.0, 1.0)), "by nobody")

    monkeypatch.setattr(meshing, "build_mesh", slow)
    case, lines = load_case("column"), []
    built = case.build(lines.append)
    assert lines == ["improving cells: 39 %"]
    assert case.build(lines.append) is built  # once
    assert case.mesh is built
    assert lines == ["improving cells: 39 %"]


def test_the_progress_of_meshing_is_in_the_unit_of_the_file(palpate_run, tmp_path) -> None:
    write_surface(tmp_path / "ball.stl", shape_sphere(10.0, edge_length=5.0))  # mm
    done = palpate_run("mesh", tmp_path / "ball.stl", "--size", "5", "-o", tmp_path / "ball.vtu")
    assert done.returncode == 0
    assert re.search(r"edge length 5 mm", done.stderr)
