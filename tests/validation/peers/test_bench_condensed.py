"""The benchmark of the condensed model: a whole row, of a ball that really presses."""

from __future__ import annotations

import dataclasses

import pytest

from palpate.fastsim.condensed import condense, condensed_size
from palpate.meshes.errors import InputError
from palpate.validation.peers import bench_condensed as condensed
from palpate.validation.peers.bench import run_benchmark
from palpate.validation.states import in_silence

SMALL = 8e-3


def test_a_row_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(condensed, "SIZES", {2_000: SMALL})
    monkeypatch.setattr(condensed, "TICKS", 40)
    monkeypatch.setattr(condensed, "CLOCKED", 20)
    document = run_benchmark("condensed", sizes=[2_000])
    row, single = document["rows"]
    assert set(document["table"]) <= set(row)
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
    assert f"{row['size']} points, float64" in document["summary"][0]


def test_a_spoiled_compliance_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def softer(problem, **options):
        model = condense(problem, **options)
        return dataclasses.replace(model, blocks=1.02 * model.blocks)

    monkeypatch.setattr(condensed, "condense", softer)
    row, _ = condensed.measured(condensed.kidney(SMALL), in_silence, num_ticks=20, clocked=5)
    assert row["difference"] > 1e-2


def test_another_size_is_refused() -> None:
    with pytest.raises(InputError, match="has no size 7; it has 1000, 2000, 3000"):
        run_benchmark("condensed", sizes=[7])
