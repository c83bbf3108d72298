"""The benchmark of the live page: a whole row, of a tool that really presses."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.kidney import shape_kidney
from palpate.validation.live import bench_touch as touch
from palpate.validation.states import in_silence


def test_a_row_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
