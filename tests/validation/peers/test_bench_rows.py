"""Benchmarks give whole rows, the rivals compute the same thing, and what differs is seen."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.fastsim.condensed import condense, condensed_size
from palpate.fastsim.contact.body_contact import VertexCellDetector
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.errors import InputError
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.tri_surface import TriSurface
from palpate.reference.child import run_task
from palpate.reference.tasks import StaticTask
from palpate.validation.case import load_case
from palpate.validation.live import bench_touch as touch
from palpate.validation.peers import bench_collision as collision
from palpate.validation.peers import bench_condensed as condensed
from palpate.validation.peers import bench_delaunay as delaunay
from palpate.validation.peers import bench_mesh as meshing
from palpate.validation.peers import bench_static as static
from palpate.validation.peers import bench_steps as steps
from palpate.validation.peers import bench_truth as truth
from palpate.validation.peers import timing
from palpate.validation.peers.bench import Benchmark, Row, run_benchmark, summarise, time_all
from palpate.validation.peers.registry import OURS, Tool
from palpate.validation.peers.timing import ChildFailedError
from palpate.validation.states import in_silence

EPS = np.finfo(float).eps


@pytest.fixture(autouse=True)
def no_other_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)


def only(benchmark: Benchmark, *adapters: str, **schedule: Any) -> Benchmark:
    """The benchmark with the tools of some adapters, and another schedule."""
    tools = tuple(tool for tool in benchmark.tools if tool.adapter in ("ours", *adapters))
    schedule_ = dataclasses.replace(benchmark.schedule, **schedule)
    return dataclasses.replace(benchmark, tools=tools, schedule=schedule_)


# ------------------------------------------------------------------------------- explicit steps
RIVAL = """
import time
from palpate.fastsim.body import Body
from palpate.meshes.problem import Material
from palpate.meshes.tet_mesh import TetMesh

class Steps:
    version, precision = "1", "float64"
    def __init__(self, job):
        tissue = Material(*(job[n][0] for n in ("youngs_modulus", "poissons_ratio", "density")))
        body = Body(TetMesh(job["points"], job["cells"]), tissue)
        self.result = {"force": 1.01 * body.internal_force(job["test_displacement"])}
    def advance(self, num_steps):
        time.sleep(1e-4 * num_steps)
"""


@pytest.fixture
def small_steps(monkeypatch: pytest.MonkeyPatch) -> Benchmark:
    """One box of 648 cells, timings of a few milliseconds."""
    box = partial(brick_box, (12, 3, 3), (4.0, 1.0, 1.0), ragged=0.15)
    monkeypatch.setattr(steps, "SIZES", {648: box})
    return only(steps.BENCHMARK, "dolfinx_assembly", turns=2, seconds=0.01)


def test_step_rows_are_whole_and_a_rivals_force_is_compared(
    small_steps: Benchmark, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for file in timing.ADAPTERS.glob("*.py"):
        (tmp_path / file.name).write_text(file.read_text("utf-8"), "utf-8")
    (tmp_path / "rival.py").write_text(RIVAL, "utf-8")
    monkeypatch.setattr(timing, "ADAPTERS", tmp_path)
    lines: list[str] = []
    tools = (*only(small_steps).tools, Tool("rival", "rival"))
    rows = time_all(dataclasses.replace(small_steps, tools=tools), (648,), lines.append)
    assert [(r["tool"], r.get("element"), r["precision"], r["threads"]) for r in rows] == [
        *(
            ("palpate", element, precision, threads)
            for element in ("linear", "smoothed")
            for precision in ("float32", "float64")
            for threads in (1, 2)
        ),
        ("palpate", "linear", "float32", 1),
        ("palpate", "linear", "float64", 1),
        ("rival", None, "float64", 1),
    ]
    assert len(lines) == 11
    assert all(row["size"] == 648 and np.isfinite(row["rate"]) for row in rows)
    assert all(row["rate"] == 648 / 1e6 / row["seconds"] for row in rows)
    assert rows[-1]["relative_force_error"] == pytest.approx(0.01)
    for k in (0, 2, 4, 6):
        alone, both = rows[k : k + 2]
        assert both["speedup_from_threads"] == alone["wall_seconds"] / both["wall_seconds"]
        assert "speedup_from_threads" not in alone
    for plain, smoothed in zip(rows[:4], rows[4:8], strict=True):
        assert smoothed["critical_time_step"] > 1.2 * plain["critical_time_step"]
        assert smoothed["times_linear"] == pytest.approx(
            plain["real_time_factor"] / smoothed["real_time_factor"]
        )
    for plain, other in zip((rows[0], rows[2]), rows[8:10], strict=True):
        assert (plain["law"], other["law"]) == ("saint-venant-kirchhoff", "neo-hookean-stable")
        assert other["rate_of_stvk"] == plain["wall_seconds"] / other["wall_seconds"]
        assert "times_linear" not in other
    assert all(row["peak_memory_mb"] > 1.0 for row in rows)


@pytest.mark.dolfinx
@pytest.mark.long
def test_dolfinx_assembles_the_same_force(small_steps: Benchmark) -> None:
    rows = time_all(small_steps, (648,), in_silence)
    (row,) = (row for row in rows if row["tool"] == "dolfinx")
    assert row["relative_force_error"] < 1e-12


def test_simulators_of_others_that_warp_runs_are_timed_on_the_device_too() -> None:
    tools = steps.on_device(steps.BENCHMARK, "cuda:0").tools
    there = {tool.name for tool in tools if tool.options.get("device") == "cuda:0"}
    assert there == {OURS, "newton", "mujoco-warp"}


@pytest.mark.usefixtures("small_steps")
@pytest.mark.long
def test_a_device_has_rows_beside_the_core_with_its_bytes() -> None:
    pytest.importorskip("warp", reason="the extra `gpu` is not installed")
    linear = tuple(
        tool
        for tool in steps.on_device(steps.BENCHMARK, "warp:cpu").tools
        if tool.name == OURS
        and (tool.options["element"], "law" in tool.options) == ("linear", False)
    )
    benchmark = dataclasses.replace(only(steps.BENCHMARK, turns=2, seconds=0.01), tools=linear)
    rows = time_all(benchmark, (648,), in_silence)
    assert [row.get("device") for row in rows] == [None] * 4 + ["warp:cpu"] * 2
    for row, two_cores in zip(rows[4:], (rows[1], rows[3]), strict=True):
        assert row["precision"] == two_cores["precision"]
        assert row["times_two_cores"] == two_cores["wall_seconds"] / row["wall_seconds"]
        moved = row["bytes_per_cell"] * row["rate"] * 1e6 / 1e9
        assert row["gigabytes_per_second"] == pytest.approx(moved)
        assert "share_of_copy" not in row  # it stays in the cache
        large = {**row, "size": 10**7, "seconds": 0.5}
        steps.compare_device(large, rows)
        reached = 1e7 * row["bytes_per_cell"] / 0.5 / (1e9 * row["copy_gigabytes_per_second"])
        assert large["share_of_copy"] == pytest.approx(reached)
        assert row["paper_rate"] == pytest.approx(3.35e6 / row["bytes_per_cell"])
    assert any("on paper" in line for line in summarise(benchmark, rows))
    with pytest.raises(InputError, match="runs on no device"):
        run_benchmark("delaunay", device="warp:cpu")


def test_what_a_step_moves_is_counted_from_its_arrays() -> None:
    pytest.importorskip("warp", reason="the extra `gpu` is not installed")
    from palpate.validation.peers.adapters.ours import bytes_per_step, copy_bandwidth, paper_rate

    mesh = brick_box((4, 3, 3), size=(4.0, 3.0, 3.0))
    problem = Problem(mesh, Material(1e4, 0.3, 1e3), (), ())
    counted = {}
    for precision, word in ((Precision.SINGLE, 4), (Precision.DOUBLE, 8)):
        body = ExplicitBody(problem, precision=precision, device="warp:cpu")
        counted[precision] = bytes_per_step(body)
        # A cell: 4 corners, 9 + 1 numbers, 12 written and 12 read, 4 entries. A point: the start of
        # its entries; 3 numbers read, summed; 7 times 3 as it moves; a look in sixteen steps.
        of_cells = mesh.num_cells * (16 + 10 * word + 24 * word + 16)
        of_points = mesh.num_points * (4 + 27 * word) + 4
        of_look = mesh.num_points * (8 + 12 * word + 20 * word) / 16
        assert counted[precision] == pytest.approx(of_cells + of_points + of_look, rel=1e-3)
    fast = ExplicitBody(problem, device="warp:cpu", is_repeatable=False)
    assert bytes_per_step(fast) < counted[Precision.DOUBLE]
    smoothed = ExplicitBody(problem, device="warp:cpu", element=Element.SMOOTHED)
    assert bytes_per_step(smoothed) > counted[Precision.DOUBLE]
    assert copy_bandwidth(fast, megabytes=8) > 1e6
    assert paper_rate(100.0, 1e12) == pytest.approx(1e10)
    with pytest.raises(InputError, match="device"):
        bytes_per_step(ExplicitBody(problem))


# --------------------------------------------------------------------------------------- statics
@pytest.fixture
def short_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(static, "BEAMS", {567: (20, 2, 2)})


@pytest.mark.usefixtures("short_beam")
def test_static_rows_are_whole() -> None:
    lines: list[str] = []
    rows = time_all(only(static.BENCHMARK), (567,), lines.append)
    assert [(r["tool"], r["strain"], r["size"]) for r in rows] == [
        ("palpate", "linear", 567),
        ("palpate", "green", 567),
    ]
    assert len(lines) == 2
    assert rows[1]["times_linear"] == rows[1]["seconds"] / rows[0]["seconds"]
    assert all(r["tip_displacement"] < -1e-3 and r["peak_memory_mb"] > 1.0 for r in rows)
    assert all({"iterations", "linear_iterations", "solver"} <= set(row) for row in rows)


@pytest.mark.dolfinx
@pytest.mark.usefixtures("short_beam")
def test_static_rows_agree_on_the_tip_to_six_digits() -> None:
    rows = time_all(only(static.BENCHMARK, "dolfinx_assembly"), (567,), in_silence)
    for strain in Strain:
        ours, theirs = (r["tip_displacement"] for r in rows if r["strain"] == strain.value)
        assert ours == pytest.approx(theirs, rel=1e-6)


def test_the_kidney_of_the_static_benchmark_has_the_size_it_is_called_by() -> None:
    assert 3 * load_case("kidney").problem.mesh.num_points == static.KIDNEY


@pytest.mark.dolfinx
def test_a_row_of_the_reference_is_whole_and_its_result_that_of_the_block(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(truth, "BLOCKS", {675: 2})
    alone = dataclasses.replace(truth.BENCHMARK, tools=truth.TOOLS[:1])
    (row,) = time_all(alone, (675,), in_silence)
    assert (row["tool"], row["size"], row["threads"]) == (OURS, 675, 1)
    assert row["iterations"] >= 3
    # An interpreter with dolfinx alone takes 70 MB; no block of 675 unknowns takes 2 GB.
    assert 70.0 < row["peak_memory_mb"] < 2000.0
    assert row["kb_per_unknown"] == pytest.approx(row["peak_memory_mb"] * 1024.0 / 675)
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    pull = Traction(side(mesh, 0, 2.0), (10.0, 5.0, -5.0))
    problem = Problem(mesh, Material(1000.0, 0.3), (support_of(side(mesh, 0, 0.0)),), (pull,))
    found = run_task(StaticTask(strain=Strain.GREEN, degree=2), problem)
    largest = np.linalg.norm(found.displacement, axis=1).max()
    assert row["max_displacement"] == pytest.approx(largest, rel=1e-8)


# -------------------------------------------------------------------------------------- Delaunay
def test_points_are_what_they_are_called() -> None:
    grid = delaunay.place_points("grid", 1000)
    assert len(np.unique(grid, axis=0)) == 1000
    np.testing.assert_array_equal(grid, np.round(grid))
    sphere = delaunay.place_points("sphere", 500)
    np.testing.assert_allclose(np.linalg.norm(sphere, axis=1), 1.0, rtol=4 * EPS)
    random = delaunay.place_points("random", 500)
    np.testing.assert_array_equal(random, delaunay.place_points("random", 500))
    with pytest.raises(ValueError, match="moon"):
        delaunay.place_points("moon", 10)


def test_rows_of_delaunay_have_every_column_and_as_many_cells_as_scipy() -> None:
    spatial = pytest.importorskip("scipy.spatial")
    # Ours, and a rival that cannot do the task.
    tools = (delaunay.TOOLS[0], Tool("other", "numpy_dense"))
    said: list[str] = []
    benchmark = dataclasses.replace(delaunay.BENCHMARK, tools=tools)
    (row,) = time_all(benchmark, (300,), said.append)
    assert [row[name] for name in ("tool", "points", "size", "threads")] == [
        "palpate", "random", 300, 1,
    ]  # fmt: skip
    points = delaunay.place_points("random", 300)
    assert row["cells"] == len(spatial.Delaunay(points).simplices)
    assert row["rate"] == pytest.approx(300 / row["seconds"], rel=4 * EPS)
    assert row["peak_memory_mb"] > 1.0
    assert any(line.startswith("other: AttributeError") for line in said)


# --------------------------------------------------------------------------------------- meshing
BALL = shape_sphere(edge_length=0.4)


def test_a_boundary_is_the_same_whatever_the_numbering_and_not_if_moved_by_one_rounding() -> None:
    filled = mesh_surface(BALL)
    turn = np.random.default_rng(0).permutation(filled.num_points)
    points = np.empty_like(filled.points)
    points[turn] = filled.points
    other = TetMesh(points, turn[filled.cells].astype(np.int32))
    assert meshing.is_boundary_kept(BALL, other)
    points = filled.points.copy()
    points[3] *= 1.0 + 2.0**-50
    assert not meshing.is_boundary_kept(BALL, TetMesh(points, filled.cells))
    assert not meshing.is_boundary_kept(shape_box((1.0, 1.0, 1.0), edge_length=0.5), filled)


def test_an_inverted_cell_is_counted_and_nothing_else_is_claimed() -> None:
    filled = mesh_surface(BALL)
    cells = filled.cells.copy()
    cells[5, [0, 1]] = cells[5, [1, 0]]
    measured = meshing.measure(BALL, {"points": filled.points, "cells": cells})
    assert measured["inverted"] == 1
    assert measured["relative_volume_error"] > 1e-6
    assert "min_dihedral_deg" not in measured


def test_rows_of_meshes_have_every_column(monkeypatch: pytest.MonkeyPatch) -> None:
    def ball(kind: str, size: int) -> TriSurface:
        if kind == "decimated":
            raise ChildFailedError("no decimator")
        assert size == 10_000
        return BALL

    monkeypatch.setattr(meshing, "make_surface", ball)
    tools = (meshing.TOOLS[0], Tool("other", "numpy_dense"))
    benchmark = dataclasses.replace(meshing.BENCHMARK, tools=tools)
    said: list[str] = []
    rows = time_all(benchmark, (10_000,), said.append)
    assert [row["surface"] for row in rows] == ["gmsh", "marching cubes"]
    row = rows[0]
    assert (row["tool"], row["size"], row["inverted"]) == ("palpate", BALL.num_facets, 0)
    assert row["boundary_kept"] is True
    # One rounding for each cell of a sum of like terms.
    assert row["relative_volume_error"] < row["cells"] * EPS
    assert row["rate"] == row["cells"] / row["seconds"]
    assert 0.0 < row["min_dihedral_deg"] <= row["p1_dihedral_deg"] < 70.53
    assert row["critical_time_step_us"] > 0.0
    assert any("no decimator" in line for line in said)
    assert any(line.startswith("other: ") for line in said)


def test_surfaces_of_other_makers_are_closed() -> None:
    pytest.importorskip("pyvista")
    surface = meshing.make_surface("marching cubes", 1000)
    assert 800 < surface.num_facets < 1200
    # 332 889 mm3 as given; edges of h = 8 mm on a body of radius R = 30 mm cut off about
    # 3 h^2 / (8 R^2) = 3 % of it.
    assert surface.volume == pytest.approx(332889e-9, rel=0.03)


# ------------------------------------------------------------------------------------- collision
def test_the_bodies_deform_in_every_step_and_stay_whole() -> None:
    bodies = collision.make_bodies(8, "overlapping")
    assert len(bodies["facets"]) == 12 * 8**2
    for frames in bodies["frames"]:
        assert frames.shape[0] == collision.NUM_FRAMES
        assert all(np.all(signed_volumes(points, bodies["cells"]) > 0.0) for points in frames)
        for before, after in zip(frames, np.roll(frames, -1, axis=0), strict=True):
            # No rigid motion, nor any other affine one: what is left of the best is of its order.
            matrix = np.column_stack([before, np.ones(len(before))])
            left = after - matrix @ np.linalg.lstsq(matrix, after, rcond=None)[0]
            assert np.linalg.norm(left) > 0.3 * np.linalg.norm(after - before)


def test_rows_of_collision_are_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(collision, "BODIES", {864: 6})
    benchmark = only(collision.BENCHMARK, "warp_tree", "trimesh_rays", turns=2, seconds=0.002)
    lines: list[str] = []
    rows = time_all(benchmark, (864,), lines.append)
    ours = [row for row in rows if row["tool"] == "palpate"]
    # Overlapping, alone and with self; apart alone.
    assert len(ours) == 3
    for row in ours:
        assert row["missed"] == row["extra"] == 0
        assert np.isfinite(row["rate"])
        assert (row["pairs"] > 0) == (row["place"] == "overlapping")
    assert ours[1]["seconds_within"] == ours[1]["seconds"] - ours[0]["seconds"]
    assert len(lines) >= len(rows)
    said = summarise(benchmark, rows)
    assert len(said) == 3
    assert sum("within the bodies" in line for line in said) == 1


def test_a_pair_left_out_or_made_up_is_seen() -> None:
    bodies = collision.make_bodies(6, "overlapping")
    here, there = (TetMesh(frames[0], bodies["cells"]) for frames in bodies["frames"])
    found = VertexCellDetector(here, there).find(here.points, there.points)
    pairs = np.column_stack([found.vertices, found.cells])
    assert len(pairs) > 2
    rows: list[Row] = [{"tool": "palpate"}, {"tool": "other"}, {"tool": "trimesh embree"}]
    # In another order, one left out, one given twice, and one with a large number made up.
    made_up = np.vstack([pairs[:0:-1], pairs[1:2], [[1, 70_000]]])
    collision.compare(rows, [pairs, made_up, pairs[:, :1]])
    assert [row["missed"] for row in rows] == [0, 1, 0]
    assert [row["extra"] for row in rows] == [0, 1, 0]
    assert [row["pairs"] for row in rows] == [
        len(pairs), len(pairs) - 1, len(np.unique(found.vertices)),
    ]  # fmt: skip


# --------------------------------------------------------------------------- the condensed model
SMALL = 8e-3


def test_a_row_of_the_condensed_model_is_whole() -> None:
    rows = condensed.measured(condensed.kidney(SMALL), in_silence, num_ticks=40, clocked=20)
    row, single = rows
    assert set(condensed.BENCHMARK.table) <= set(row)
    assert 1e-10 < single["difference"] <= 1e-5
    assert single["kept_mb"] < 0.6 * row["kept_mb"]
    size = condensed_size(condensed.kidney(SMALL))
    assert row["size"] == size.num_touched > 100
    assert row["said_mb"] == size.peak_bytes / 1e6
    assert row["kept_mb"] >= size.model_bytes / 1e6
    assert row["contacts"] >= 2
    assert row["force"] > 0.1
    assert row["difference"] <= 1e-10
    assert 0.0 <= row["share_above"] <= 1.0
    assert 0.0 <= row["late_of_1khz"] <= 1.0
    assert f"{row['size']} points, float64" in condensed.BENCHMARK.summary(rows)[0]


def test_a_perturbed_compliance_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def softer(problem: Problem, **options: Any) -> Any:
        model = condense(problem, **options)
        return dataclasses.replace(model, blocks=1.02 * model.blocks)

    monkeypatch.setattr(condensed, "condense", softer)
    row, _ = condensed.measured(condensed.kidney(SMALL), in_silence, num_ticks=20, clocked=5)
    assert row["difference"] > 1e-2


# --------------------------------------------------------------------------------- the live page
def test_a_row_of_the_live_page_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(touch, "WARM_UP", 0.1)
    mesh = mesh_surface(shape_kidney(edge_length=12e-3))
    row = touch.measured(mesh, tmp_path, in_silence, seconds=1.2)
    assert set(touch.BENCHMARK.table) <= set(row)
    assert row["size"] == mesh.num_cells
    assert row["rate"] == pytest.approx(1.0 / row["seconds"])
    assert row["force"] > 0.01
    assert not row["trouble"]
    assert row["page_kilobytes"] < 1000.0
    assert row["megabytes_per_second"] < 3.0


# ------------------------------------------------------------------------------------- summaries
def test_the_summaries_say_what_is_asked_of_the_rates() -> None:
    common = {"size": 10, "body": "box", "version": "1", "precision": "float32", "threads": 1}
    rows: list[Row] = [
        common | {"tool": "palpate", "seconds": 1.0, "real_time_cells": 7},
        common | {"tool": "palpate", "seconds": 0.5, "threads": 2, "speedup_from_threads": 1.875},
        common | {"tool": "palpate", "seconds": 2.0, "times_linear": 1.6},
        common | {"tool": "mujoco", "seconds": 10.0, "precision": "float64"},
        common | {"tool": "newton", "seconds": 8.0},
    ]
    assert summarise(steps.BENCHMARK, rows) == [
        "10, box, float32: 8.0 times newton 1, 10.0 times mujoco 1 in float64, "
        "2 threads 1.88 times one, smoothed 1.60 times as long for a second of motion, "
        "7 cells in real time on one core"
    ]
    common = {"size": 10, "body": "beam", "version": "1", "strain": "green", "precision": "float64"}
    rows = [
        common
        | {"tool": "palpate", "seconds": 1.0, "tip_displacement": 2.0, "peak_memory_mb": 30.0,
           "times_linear": 2.5},
        common
        | {"tool": "slow", "seconds": 9.0, "tip_displacement": 2.0, "peak_memory_mb": 1.0},
        common
        | {"tool": "dolfinx", "seconds": 3.0, "tip_displacement": 2.5, "peak_memory_mb": 40.0},
    ]  # fmt: skip
    assert summarise(static.BENCHMARK, rows) == [
        "10, beam, green, float64: 3.0 times dolfinx 1, 9.0 times slow 1, "
        "0.75 of the quickest's memory, tips 0.2 apart, Green 2.5 times linear"
    ]
    common = {"size": 10, "version": "1", "precision": "float64"}
    rows = [
        common | {"tool": OURS, "seconds": 6.0, "max_displacement": 2.0},
        common | {"tool": "palpate under mpirun", "seconds": 3.0, "max_displacement": 3.0},
    ]
    assert summarise(truth.BENCHMARK, rows) == [
        "10, float64: 0.5 times palpate under mpirun 1, largest displacements 0.5 apart"
    ]


@pytest.mark.parametrize("name", ["condensed", "touch"])
def test_another_size_of_our_own_benchmarks_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="has no size 7; it has"):
        run_benchmark(name, sizes=[7])
