"""`palpate bench delaunay`: points as named, and rows with every column."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.validation.peers import bench_delaunay as delaunay
from palpate.validation.peers.bench import time_all
from palpate.validation.peers.registry import Tool

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
    # No compiler, and a rival that cannot do the task.
    monkeypatch.setenv("PATH", "/nowhere")
    tools = (*delaunay.TOOLS[:3], Tool("other", "numpy_dense"))
    said: list[str] = []
    (row,) = time_all(dataclasses.replace(delaunay.BENCHMARK, tools=tools), (300,), said.append)
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
    assert any(line.startswith("other: AttributeError") for line in said)


def test_tools_find_as_many_cells() -> None:
    spatial = pytest.importorskip("scipy.spatial")
    points = delaunay.place_points("random", 300)
    (row,) = time_all(
        dataclasses.replace(delaunay.BENCHMARK, tools=delaunay.TOOLS[:1]), (300,), print
    )
    assert row["cells"] == len(spatial.Delaunay(points).simplices)
