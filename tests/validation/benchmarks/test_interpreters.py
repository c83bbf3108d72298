"""Rivals that live in another Python environment are found and timed there."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.shapes import shape_sphere
from palpate.validation.benchmarks import delaunay, mesh
from palpate.validation.simulators.interpreters import interpreter_with, interpreters

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
def test_the_delaunay_bench_times_a_rival_of_another_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(delaunay, "PROGRAMS", {})
    monkeypatch.setattr(delaunay, "TOOLS", dict.fromkeys(("palpate", "TetGen (Python)")))
    monkeypatch.setattr(delaunay, "_REPEATS", 1)
    said: list[str] = []
    rows = {row["tool"]: row for row in delaunay.bench_delaunay(sizes=(300,), progress=said.append)}
    assert set(rows) == {"palpate", "TetGen (Python)"}, said
    rival = rows["TetGen (Python)"]
    assert (rival["version"], rival["cells"]) == ("9.9, of the other environment", 7)


@pytest.mark.usefixtures("other")
def test_the_mesh_bench_times_a_rival_of_another_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ball = shape_sphere(edge_length=0.4)
    np.savez(tmp_path / "surface.npz", points=ball.points, facets=ball.facets)
    monkeypatch.setattr(mesh, "TOOLS", dict.fromkeys(("TetGen pq1.2Y",)))
    monkeypatch.setattr(mesh, "_REPEATS", 1)
    said: list[str] = []
    (row,) = mesh._time_all("ball", ball, str(tmp_path / "surface.npz"), said.append) or (said,)
    assert (row["tool"], row["version"]) == ("TetGen pq1.2Y", "9.9, of the other environment")
    assert row["cells"] == ball.num_facets
    assert row["boundary_kept"]
