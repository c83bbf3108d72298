"""Benchmarks give whole rows, and the rivals compute the same thing."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Strain
from palpate.validation.benchmarks import children, static, steps
from palpate.validation.case import load_case

RIVALS = children.FOLDER


@pytest.fixture
def small(monkeypatch):
    """One box of 648 cells, timings of a few milliseconds."""
    box = partial(brick_box, (12, 3, 3), (4.0, 1.0, 1.0), ragged=0.15)
    monkeypatch.setattr(steps, "SIZES", {648: box})
    monkeypatch.setattr(steps, "CELL_STEPS", 3e5)
    monkeypatch.setattr(steps, "SECONDS", 0.01)
    monkeypatch.setattr(steps, "TIMINGS", 2)
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)


@pytest.mark.usefixtures("small")
def test_step_rows_are_whole_and_the_rival_has_the_same_force(monkeypatch):
    monkeypatch.setattr(steps, "_FILES", (("step_numpy.py", {}), ("step_absent.py", {})))
    lines = []
    rows = steps.bench_steps(sizes=(648,), threads=(1, 2), progress=lines.append)
    assert [(r["tool"], r["precision"], r["threads"]) for r in rows] == [
        ("palpate", "float32", 1),
        ("palpate", "float32", 2),
        ("palpate", "float64", 1),
        ("palpate", "float64", 2),
        ("numpy", "float64", 1),
    ]
    assert len(lines) == 6
    assert lines[0].startswith("step_absent.py failed")
    assert all(row["size"] == 648 and np.isfinite(row["rate"]) for row in rows)
    assert rows[-1]["relative_force_error"] < 1e-12
    assert rows[1]["speedup_from_threads"] == rows[0]["wall_seconds"] / rows[1]["wall_seconds"]
    assert all(row["peak_memory_mb"] > 1.0 for row in rows)


@pytest.mark.dolfinx
@pytest.mark.usefixtures("small")
def test_dolfinx_assembles_the_same_force(monkeypatch):
    monkeypatch.setattr(steps, "_FILES", (("step_dolfinx.py", {}),))
    (row,) = (r for r in steps.bench_steps(sizes=(648,), threads=(1,)) if r["tool"] == "dolfinx")
    assert row["relative_force_error"] < 1e-12


def test_a_rival_that_is_not_installed_is_no_failure(tmp_path, monkeypatch):
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)
    monkeypatch.setattr(children, "FOLDER", tmp_path)
    (tmp_path / "child.py").write_text((RIVALS / "child.py").read_text("utf-8"), "utf-8")
    (tmp_path / "absent.py").write_text("import no_such_library\n", "utf-8")
    (tmp_path / "unfit.py").write_text(
        "def prepare(body):\n    raise ValueError(f'{len(body[\"x\"])} is too large')\n", "utf-8"
    )
    lines = []
    body = {"x": np.zeros(3)}
    with children.started([("absent.py", body), ("unfit.py", body)], lines.append) as found:
        assert found == []
    assert lines == ["unfit.py left out: 3 is too large"]


@pytest.fixture
def short_beam(monkeypatch):
    monkeypatch.setattr(static, "BEAMS", {567: (20, 2, 2)})
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)


@pytest.mark.usefixtures("short_beam")
def test_static_rows_are_whole(monkeypatch):
    monkeypatch.setattr(static, "_FILES", ())
    lines = []
    rows = static.bench_static(sizes=(567,), progress=lines.append)
    assert [(r["tool"], r["strain"], r["size"]) for r in rows] == [
        ("palpate", "linear", 567),
        ("palpate", "green", 567),
    ]
    assert len(lines) == 2
    assert rows[1]["times_linear"] == rows[1]["seconds"] / rows[0]["seconds"]
    assert all(r["tip_displacement"] < -1e-3 and r["peak_memory_mb"] > 1.0 for r in rows)


@pytest.mark.dolfinx
@pytest.mark.usefixtures("short_beam")
def test_static_rows_agree_on_the_tip_to_six_digits(monkeypatch):
    monkeypatch.setattr(static, "_FILES", ("static_dolfinx.py",))
    rows = static.bench_static(sizes=(567,))
    for strain in Strain:
        ours, theirs = (r["tip_displacement"] for r in rows if r["strain"] == strain.value)
        assert ours == pytest.approx(theirs, rel=1e-6)


def test_the_kidney_of_the_static_benchmark_has_the_size_it_is_called_by():
    assert 3 * load_case("kidney").problem.mesh.num_points == static.KIDNEY


def test_a_rival_that_fails_while_timed_leaves_and_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)
    monkeypatch.setattr(children, "FOLDER", tmp_path)
    (tmp_path / "child.py").write_text((RIVALS / "child.py").read_text("utf-8"), "utf-8")
    (tmp_path / "brittle.py").write_text(
        "class Brittle:\n"
        "    tool, version, precision, force = 'brittle', '1', 'float64', None\n"
        "    def advance(self, num_steps):\n"
        "        if num_steps > 1:\n"
        "            raise OverflowError('too many')\n"
        "def prepare(body):\n    return Brittle()\n",
        "utf-8",
    )
    lines = []
    with children.started([("brittle.py", {})], lines.append) as found:
        children.take_turns(found, 2, lambda _child, turn: turn + 1, lines.append)
        assert found == []
    assert lines == ["brittle failed: OverflowError: too many"]


def test_a_rival_that_hangs_is_ended(tmp_path, monkeypatch):
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)
    monkeypatch.setattr(children, "FOLDER", tmp_path)
    monkeypatch.setattr(children, "TIME_LIMIT", 1.0)
    (tmp_path / "child.py").write_text("import time\ntime.sleep(60)\n", "utf-8")
    lines = []
    with children.started([("slow.py", {})], lines.append) as found:
        assert found == []
    assert lines == ["slow.py failed: the process ended without a word"]


def test_the_summaries_say_what_is_asked_of_the_rates():
    common = {"size": 10, "body": "box", "version": "1", "precision": "float32", "threads": 1}
    rows = [
        common | {"tool": "palpate", "rate": 80.0, "real_time_cells": 7},
        common | {"tool": "palpate", "rate": 150.0, "threads": 2, "speedup_from_threads": 1.875},
        common | {"tool": "newton", "rate": 10.0},
        common | {"tool": "mujoco", "rate": 8.0, "precision": "float64"},
        common | {"tool": "numba", "rate": 16.0},
    ]
    assert steps.summarise(rows) == [
        "box of 10 cells, float32: 8.0 times newton, 5.0 times numba, 2 threads 1.88 times one, "
        "7 cells in real time on one core"
    ]
    common = {"size": 10, "body": "beam", "version": "1", "strain": "green"}
    rows = [
        common
        | {"tool": "palpate", "seconds": 1.0, "tip_displacement": 2.0, "peak_memory_mb": 30.0,
           "times_linear": 2.5},
        common
        | {"tool": "slow", "seconds": 9.0, "tip_displacement": 2.0, "peak_memory_mb": 1.0},
        common
        | {"tool": "dolfinx", "seconds": 3.0, "tip_displacement": 2.5, "peak_memory_mb": 40.0},
    ]  # fmt: skip
    assert static.summarise(rows) == [
        "beam of 10 unknowns, green: 3.0 times as quick as dolfinx 1, 0.75 of its memory, "
        "tips 0.2 apart, Green 2.5 times linear"
    ]
