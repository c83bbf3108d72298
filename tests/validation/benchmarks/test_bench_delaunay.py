"""`palpate bench delaunay`: points as named, tools in child processes that may fail."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from palpate.validation.benchmarks import delaunay
from palpate.validation.benchmarks.child import ChildFailedError, peak_memory_mb, run_program

EPS = np.finfo(float).eps


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


def test_rows_of_palpate_have_every_column(monkeypatch: pytest.MonkeyPatch) -> None:
    # Rivals by their absence: no compiler, no packages.
    monkeypatch.setattr(delaunay, "PROGRAMS", {})
    monkeypatch.setattr(delaunay, "TOOLS", {"palpate": delaunay.TOOLS["palpate"], "absent": None})
    monkeypatch.setattr(delaunay, "_REPEATS", 1)
    said: list[str] = []
    (row,) = delaunay.bench_delaunay(sizes=(300,), progress=said.append)
    assert (row["tool"], row["points"], row["size"], row["threads"]) == (
        "palpate",
        "random",
        300,
        1,
    )
    # Points in a cube have about 6.7 cells each, fewer when so many lie on the hull.
    assert 4 * 300 < row["cells"] < 7 * 300
    assert row["rate"] == pytest.approx(300 / row["seconds"], rel=4 * EPS)
    assert row["peak_memory_mb"] > 1.0
    assert any("absent" in line and "exit 1" in line for line in said)


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("import os; os.abort()", "exit -6"),
        ("raise SystemExit('no licence')", "no licence"),
        ("print('cells: 7')", "no JSON"),
        ("import time; time.sleep(60)", "not done within 0.5 s"),
    ],
)
def test_a_tool_that_fails_is_told_not_timed(code: str, says: str) -> None:
    with pytest.raises(ChildFailedError, match=says):
        run_program([sys.executable, "-c", code], time_limit=0.5 if "sleep" in code else 30.0)


def test_memory_is_the_childs_own() -> None:
    # A child of a large parent starts small: the figure is not handed down.
    ballast = np.ones(30_000_000 // 8 * 8)
    code = (
        "import json\n"
        "from palpate.validation.benchmarks.child import peak_memory_mb\n"
        "print(json.dumps({'mb': peak_memory_mb()}))"
    )
    small = run_program([sys.executable, "-c", code], time_limit=60.0)["mb"]
    assert small + ballast.nbytes / 2**20 / 2 < peak_memory_mb()
