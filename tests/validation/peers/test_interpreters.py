"""Rivals that live in another Python environment are found and timed there."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import sys
from pathlib import Path

import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.shapes import shape_sphere
from palpate.validation.peers import bench_delaunay as delaunay
from palpate.validation.peers import bench_mesh as mesh
from palpate.validation.peers import timing as children
from palpate.validation.peers.bench import time_all
from palpate.validation.peers.registry import interpreter_with, interpreters

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


@pytest.fixture
def other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An interpreter that has tetgen, and no palpate of its own."""
    if importlib.util.find_spec("tetgen"):
        pytest.skip("tetgen is installed here, so no other environment is asked for it")
    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "tetgen.py").write_text(TETGEN, encoding="utf-8")
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


def test_a_tool_that_runs_everywhere_is_timed_once_for_each_version(
    other: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "ADAPTERS", other.parent)
    (other.parent / "both.py").write_text(
        "import importlib.util\n"
        "class Task:\n    precision = 'float64'\n"
        "    version = 'with' if importlib.util.find_spec('tetgen') else 'without'\n"
        "    def __init__(self, job):\n        pass\n"
        "    def advance(self, num_steps):\n        pass\n",
        encoding="utf-8",
    )
    tool = children.Tool("both", "both")
    for is_everywhere, versions in ((False, ["without"]), (True, ["without", "with"])):
        tools = (dataclasses.replace(tool, runs_everywhere=is_everywhere),)
        with children.timed(tools, "Task", {}, children.Schedule(1), print) as found:
            assert [child.version for child in found] == versions
