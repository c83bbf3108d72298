"""Benchmarks give whole rows, and the rivals compute the same thing."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.peers import bench_static as static
from palpate.validation.peers import bench_steps as steps
from palpate.validation.peers import timing as children
from palpate.validation.peers.bench import run_benchmark, summarise, time_all
from palpate.validation.peers.registry import OURS, Tool
from palpate.validation.peers.timing import ChildFailedError, Schedule, timed
from palpate.validation.states import in_silence


def only(benchmark, *adapters, **schedule):
    """The benchmark with the tools of some adapters, and another schedule."""
    tools = tuple(tool for tool in benchmark.tools if tool.adapter in ("ours", *adapters))
    schedule = dataclasses.replace(benchmark.schedule, **schedule)
    return dataclasses.replace(benchmark, tools=tools, schedule=schedule)


@pytest.fixture
def small_steps(monkeypatch):
    """One box of 648 cells, timings of a few milliseconds."""
    box = partial(brick_box, (12, 3, 3), (4.0, 1.0, 1.0), ragged=0.15)
    monkeypatch.setattr(steps, "SIZES", {648: box})
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)

    def time(*adapters, progress=in_silence):
        return time_all(only(steps.BENCHMARK, *adapters, turns=2, seconds=0.01), (648,), progress)

    return time


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


def test_step_rows_are_whole_and_a_rivals_force_is_compared(small_steps, monkeypatch, tmp_path):
    lines = []
    for file in children.ADAPTERS.glob("*.py"):
        (tmp_path / file.name).write_text(file.read_text("utf-8"), "utf-8")
    (tmp_path / "rival.py").write_text(RIVAL, "utf-8")
    monkeypatch.setattr(children, "ADAPTERS", tmp_path)
    benchmark = dataclasses.replace(
        steps.BENCHMARK, tools=(*steps.BENCHMARK.tools, Tool("rival", "rival"))
    )
    monkeypatch.setattr(steps, "BENCHMARK", benchmark)
    rows = small_steps("rival", progress=lines.append)
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


def test_simulators_of_others_that_warp_runs_are_timed_on_the_device_too():
    tools = steps.on_device(steps.BENCHMARK, "cuda:0").tools
    there = {tool.name for tool in tools if tool.options.get("device") == "cuda:0"}
    assert there == {OURS, "newton", "mujoco-warp"}


def test_a_device_has_rows_beside_the_core_with_its_bytes_and_its_share(monkeypatch):
    pytest.importorskip("warp", reason="the extra `gpu` is not installed")
    box = partial(brick_box, (12, 3, 3), (4.0, 1.0, 1.0), ragged=0.15)
    monkeypatch.setattr(steps, "SIZES", {648: box})
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)
    linear = [
        tool
        for tool in steps.on_device(steps.BENCHMARK, "warp:cpu").tools
        if tool.name == OURS
        and (tool.options["element"], "law" in tool.options) == ("linear", False)
    ]
    benchmark = dataclasses.replace(only(steps.BENCHMARK, turns=2, seconds=0.01), tools=linear)
    rows = time_all(benchmark, (648,), in_silence)
    assert [row.get("device") for row in rows] == [None] * 4 + ["warp:cpu"] * 2
    for row, two_cores in zip(rows[4:], (rows[1], rows[3]), strict=True):
        assert row["precision"] == two_cores["precision"]
        assert row["times_two_cores"] == two_cores["wall_seconds"] / row["wall_seconds"]
        moved = row["bytes_per_cell"] * row["rate"] * 1e6 / 1e9
        assert row["gigabytes_per_second"] == pytest.approx(moved)
        assert "share_of_copy" not in row  # it stays in the cache
        steps._compare_device(large := {**row, "size": 10**7, "seconds": 0.5}, rows)
        reached = 1e7 * row["bytes_per_cell"] / 0.5 / (1e9 * row["copy_gigabytes_per_second"])
        assert large["share_of_copy"] == pytest.approx(reached)
        assert row["paper_rate"] == pytest.approx(3.35e6 / row["bytes_per_cell"])
    assert any("on paper" in line for line in summarise(benchmark, rows))
    with pytest.raises(InputError, match="runs on no device"):
        run_benchmark("delaunay", device="warp:cpu")


@pytest.mark.dolfinx
def test_dolfinx_assembles_the_same_force(small_steps):
    (row,) = (row for row in small_steps("dolfinx_assembly") if row["tool"] == "dolfinx")
    assert row["relative_force_error"] < 1e-12


@pytest.fixture
def short_beam(monkeypatch):
    monkeypatch.setattr(static, "BEAMS", {567: (20, 2, 2)})
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)


@pytest.mark.usefixtures("short_beam")
def test_static_rows_are_whole():
    lines = []
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
def test_static_rows_agree_on_the_tip_to_six_digits():
    rows = time_all(only(static.BENCHMARK, "dolfinx_assembly"), (567,), in_silence)
    for strain in Strain:
        ours, theirs = (r["tip_displacement"] for r in rows if r["strain"] == strain.value)
        assert ours == pytest.approx(theirs, rel=1e-6)


def test_the_kidney_of_the_static_benchmark_has_the_size_it_is_called_by():
    assert 3 * load_case("kidney").problem.mesh.num_points == static.KIDNEY


@pytest.fixture
def adapter(tmp_path, monkeypatch):
    """A folder of adapters with one that is written here: its class `Task`."""
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)
    monkeypatch.setattr(children, "ADAPTERS", tmp_path)

    def write(text, name="rival"):
        (tmp_path / f"{name}.py").write_text(
            "import os, numpy as np\nclass Task:\n    version, precision = '1', 'float64'\n"
            "    def __init__(self, job):\n        self.job = job\n"
            "    def advance(self, num_steps):\n        pass\n" + text,
            "utf-8",
        )
        return Tool(name, name)

    return write


def test_a_rival_that_is_not_installed_is_left_out_and_one_that_does_not_fit_says_why(adapter):
    absent = adapter("import no_such_library\n", "absent")
    unfit = adapter(
        "    def __init__(self, job):\n"
        "        raise ValueError(f'{len(job[\"x\"])} is too large')\n",
        "unfit",
    )
    lines = []
    with timed((absent, unfit), "Task", {"x": np.zeros(3)}, Schedule(1), lines.append) as found:
        assert found == []
    assert lines == ["unfit: 3 is too large"]


def test_a_rival_that_fails_while_timed_leaves_and_is_named(adapter):
    brittle = adapter(
        "    def advance(self, num_steps):\n"
        "        if hasattr(self, 'result'):\n            raise OverflowError('too many')\n"
        "        self.result = {}\n",
        "brittle",
    )
    lines = []
    with timed((brittle,), "Task", {}, Schedule(turns=2), lines.append) as found:
        assert found == []
    assert lines == ["brittle: OverflowError: too many"]


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("os.abort()", "the process ended without a word"),
        ("raise SystemExit('no licence')", "no licence"),
        ("__import__('time').sleep(60)", "not done within 3 s"),
    ],
)
def test_a_rival_that_crashes_or_hangs_is_told_not_timed(adapter, code, says):
    rival = adapter(f"    def advance(self, num_steps):\n        {code}\n")
    lines = []
    with timed((rival,), "Task", {}, Schedule(turns=1, time_limit=3.0), lines.append) as found:
        assert found == []
    assert lines == [f"rival: {says}"]


def test_our_own_failure_is_no_rivals(adapter):
    ours = dataclasses.replace(adapter("import no_such_library_x; 1 / 0\n"), name=OURS)
    broken = dataclasses.replace(adapter("1 / 0\n", "broken"), name=OURS)
    with timed((ours,), "Task", {}, Schedule(1), in_silence) as found:
        assert found == []
    with (
        pytest.raises(ChildFailedError, match="ZeroDivisionError"),
        timed((broken,), "Task", {}, Schedule(1), in_silence),
    ):
        pass


COUNTS = """
    total = 0
    def advance(self, num_steps):
        Task.total += num_steps
        __import__("time").sleep(2e-3 * num_steps)
        self.result = {"steps": np.array(num_steps), "total": np.array(Task.total)}
        return {"process": os.getpid()}
"""


def test_a_schedule_asks_for_whole_units_of_steps_and_for_processes(adapter):
    rival = adapter(COUNTS)
    with timed((rival,), "Task", {}, Schedule(3, seconds=0.05, unit=6), in_silence) as (child,):
        # About 25 steps of 2 ms, each of them at least as long as it sleeps.
        assert int(child.result["steps"]) in (6, 12, 18, 24)
        assert child.best("wall") >= 2e-3
        assert len({timing["process"] for timing in child.timings}) == 1
    with timed((rival,), "Task", {}, Schedule(3, is_fresh=True), in_silence) as (child,):
        assert int(child.result["total"]) == 1
        assert len({timing["process"] for timing in child.timings}) == 3
    with timed((rival,), "Task", {}, Schedule(3, long=1e-3), in_silence) as (child,):
        assert len(child.timings) == 1


def test_the_first_timing_counts_where_every_process_is_fresh(adapter):
    rival = adapter("")
    for is_fresh, least in ((False, 2.0), (True, 1.0)):
        with timed((rival,), "Task", {}, Schedule(1, is_fresh=is_fresh), in_silence) as (child,):
            child.timings = [{"wall": 1.0}, {"wall": 3.0}, {"wall": 2.0}]
            assert child.best("wall") == least


def test_memory_is_the_childs_own(adapter):
    # A child of a large parent starts small: the figure is not handed down.
    ballast = np.ones(2**27)
    with timed((adapter(""),), "Task", {}, Schedule(1), in_silence) as (child,):
        assert child.timings[0]["peak_memory_mb"] < ballast.nbytes / 2**20 / 2


def test_the_summaries_say_what_is_asked_of_the_rates():
    common = {"size": 10, "body": "box", "version": "1", "precision": "float32", "threads": 1}
    rows = [
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
