"""Rivals are timed in processes and environments of their own, failing and hanging ones too."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.shapes import shape_sphere
from palpate.validation.peers import bench_delaunay as delaunay
from palpate.validation.peers import bench_mesh as mesh
from palpate.validation.peers import timing
from palpate.validation.peers.bench import time_all
from palpate.validation.peers.registry import OURS, Tool, interpreter_with, interpreters
from palpate.validation.peers.timing import ChildFailedError, Schedule, timed
from palpate.validation.states import in_silence


@pytest.fixture
def adapter(tmp_path, monkeypatch):
    """A folder of adapters with one that is written here: its class `Task`."""
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)
    monkeypatch.setattr(timing, "ADAPTERS", tmp_path)

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
        ("os.abort()", "the process ended without output"),
        ("raise SystemExit('no licence')", "no licence"),
        ("__import__('time').sleep(60)", "not done within 3 s"),
    ],
)
def test_a_rival_that_crashes_or_hangs_is_reported_and_not_timed(adapter, code, says):
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


@pytest.mark.long
def test_memory_is_the_childs_own(adapter):
    # A child of a large parent starts small: the figure is not handed down.
    ballast = np.ones(2**27)
    with timed((adapter(""),), "Task", {}, Schedule(1), in_silence) as (child,):
        assert child.timings[0]["peak_memory_mb"] < ballast.nbytes / 2**20 / 2


# ------------------------------------------------------------------ other environments
# A tetgen that joins a convex surface's facets to its middle.
TETGEN = """
import numpy as np
__version__ = "9.9, of the other environment"
class _tetgen:
    class PyTetgen:
        n_cells = 7
        def load_mesh(self, points, facets):
            self.points, self.facets = points, facets
        def tetrahedralize(self, switches_str):
            pass
        def return_nodes(self):
            return np.vstack([self.points, self.points.mean(axis=0)])
        def return_tets(self):
            middle = np.full((len(self.facets), 1), len(self.points))
            return np.hstack([middle, self.facets])
"""

# A pytetwild that does the same, with facets moved by what it was allowed.
TETWILD = """
import numpy as np
__version__ = "0.0, of the other environment"
def tetrahedralize(points, facets, edge_length_abs, epsilon, num_threads, vtk_ordering):
    assert num_threads == 1 and vtk_ordering and 0.4 < edge_length_abs < 0.7
    points = np.vstack([(1.0 - epsilon) * points, points.mean(axis=0)])
    middle = np.full((len(facets), 1), len(points) - 1)
    return points, np.hstack([middle, facets])
"""


@pytest.fixture
def other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An interpreter that has tetgen, and no palpate of its own."""
    if importlib.util.find_spec("tetgen"):
        pytest.skip("tetgen is installed here, so no other environment is asked for it")
    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "tetgen.py").write_text(TETGEN, encoding="utf-8")
    (tmp_path / "packages" / "pytetwild.py").write_text(TETWILD, encoding="utf-8")
    program = tmp_path / "python"
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH="$PYTHONPATH:{tmp_path / "packages"}" exec {sys.executable} "$@"\n',
        encoding="utf-8",
    )
    program.chmod(0o755)
    monkeypatch.setenv("PALPATE_BENCH_PYTHON", os.pathsep.join(["", str(program)]))
    return program


def test_a_rival_is_looked_for_here_first_then_there(other: Path) -> None:
    assert interpreters() == [sys.executable, str(other)]
    assert interpreter_with("numpy") == sys.executable
    assert interpreter_with("tetgen") == str(other)
    assert interpreter_with("no_such_module") is None


def test_an_interpreter_that_is_not_there_is_an_input_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PALPATE_BENCH_PYTHON", str(tmp_path / "gone"))
    with pytest.raises(InputError, match="PALPATE_BENCH_PYTHON: no program"):
        interpreters()


@pytest.mark.usefixtures("other")
def test_a_rival_of_another_environment_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    ball = shape_sphere(edge_length=0.4)
    monkeypatch.setattr(mesh, "make_surface", lambda _kind, _size: ball)
    for bench, name, size, cells in (
        (delaunay, "TetGen", 300, 7),
        (mesh, "TetGen pq1.2Y", 2_000, ball.num_facets),
    ):
        tools = tuple(tool for tool in bench.TOOLS if tool.name == name)
        said: list[str] = []
        found = time_all(dataclasses.replace(bench.BENCHMARK, tools=tools), (size,), said.append)
        (row,) = found or (said,)
        assert (row["tool"], row["version"]) == (name, "9.9, of the other environment")
        assert row["cells"] == cells
    assert row["boundary_kept"]


@pytest.mark.usefixtures("other")
def test_ftetwild_is_timed_and_does_not_keep_facets(monkeypatch: pytest.MonkeyPatch) -> None:
    ball = shape_sphere(edge_length=0.4)
    monkeypatch.setattr(mesh, "make_surface", lambda _kind, _size: ball)
    tools = tuple(tool for tool in mesh.TOOLS if tool.adapter == "ftetwild_meshes")
    said: list[str] = []
    found = time_all(dataclasses.replace(mesh.BENCHMARK, tools=tools), (2_000,), said.append)
    (row,) = found or (said,)
    assert (row["tool"], row["version"]) == ("fTetWild eps 1e-3", "0.0, of the other environment")
    assert row["cells"] == ball.num_facets
    assert not row["boundary_kept"]
    # Each length is shorter by epsilon, 1e-3, so the volume by 1 - 0.999^3, to rounding.
    assert row["relative_volume_error"] == pytest.approx(1.0 - 0.999**3, rel=1e-9)


def test_a_tool_that_runs_everywhere_is_timed_once_for_each_version(
    other: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timing, "ADAPTERS", other.parent)
    (other.parent / "both.py").write_text(
        "import importlib.util\n"
        "class Task:\n    precision = 'float64'\n"
        "    version = 'with' if importlib.util.find_spec('tetgen') else 'without'\n"
        "    def __init__(self, job):\n        pass\n"
        "    def advance(self, num_steps):\n        pass\n",
        encoding="utf-8",
    )
    tool = Tool("both", "both")
    for is_everywhere, versions in ((False, ["without"]), (True, ["without", "with"])):
        tools = (dataclasses.replace(tool, runs_everywhere=is_everywhere),)
        with timed(tools, "Task", {}, Schedule(1), print) as found:
            assert [child.version for child in found] == versions
