"""`palpate bench`: rows as strict JSON, written whole, and a table that names what is missing."""

from __future__ import annotations

import dataclasses
import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.validation.commands.studies import bench, print_bench
from palpate.validation.peers import bench as run
from palpate.validation.peers import bench_steps as steps
from palpate.validation.peers.registry import Tool
from palpate.validation.states import in_silence


def _row(tool: str, seconds: float) -> run.Row:
    return {
        "tool": tool, "version": "1.0", "size": 10, "threads": 1, "precision": "float64",
        "seconds": seconds, "rate": 10 / seconds, "rate_unit": "cells per second",
        "boundary_kept": True,
    }  # fmt: skip


@pytest.fixture
def two_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    def rows(_benchmark, sizes, progress):
        assert tuple(sizes) == (10,)
        progress("one line")
        return [_row("palpate", 0.25), _row("numpy", 0.5)]

    tools = (
        Tool("palpate", "ours"),
        Tool("numpy", "numpy_dense", "pip install numpy"),
        Tool("absent", "absent", "not sold"),
    )
    benchmark = dataclasses.replace(
        steps.BENCHMARK,
        sizes=(10,),
        tools=tools,
        same=(),
        table=(),
        remark=lambda ours, rivals: [f"{len(ours)} row beside {len(rivals)}"],
    )
    monkeypatch.setattr(run, "time_all", rows)
    monkeypatch.setattr(steps, "BENCHMARK", benchmark)


@pytest.mark.usefixtures("two_rows")
def test_json_holds_rows_machine_and_what_was_left_out(tmp_path: Path) -> None:
    target = tmp_path / "rows.json"
    bench("steps", json=target, size=[10])
    document = json.loads(target.read_text("utf-8"))
    assert document["bench"] == "steps"
    assert [(row["tool"], row["rate"]) for row in document["rows"]] == [
        ("palpate", 40.0), ("numpy", 20.0)
    ]  # fmt: skip
    assert document["left_out"] == {"absent": "not sold"}
    assert document["machine"]["cores"] >= 1
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.usefixtures("two_rows")
def test_the_table_shows_every_column_and_names_rivals_left_out() -> None:
    out = io.StringIO()
    document = run.run_benchmark("steps", progress=in_silence)
    print_bench(document, Console(file=out, width=200))
    text = out.getvalue()
    assert "boundary_kept" in text
    assert "yes" in text
    assert "left out: absent, not sold" in text
    assert "10, float64: 2.0 times numpy 1.0, 1 row beside 1" in text
    assert "versions: numpy 1.0, palpate 1.0" in text


@pytest.mark.usefixtures("two_rows")
def test_a_benchmark_may_choose_its_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    benchmark = dataclasses.replace(steps.BENCHMARK, table=("absent_everywhere",))
    monkeypatch.setattr(steps, "BENCHMARK", benchmark)
    out = io.StringIO()
    print_bench(run.run_benchmark("steps", progress=print), Console(file=out, width=200))
    assert "boundary_kept" not in out.getvalue()
    assert "absent_everywhere" not in out.getvalue()


def test_a_number_that_is_none_is_no_json() -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        run.bench_json({"rows": [{"rate": float("nan")}]})


def test_unknown_names_and_sizes_are_refused_with_what_there_is() -> None:
    with pytest.raises(InputError, match="steps, static"):
        run.run_benchmark("nonsense")
    with pytest.raises(InputError, match="6000, 58080"):
        run.run_benchmark("steps", sizes=[7])
