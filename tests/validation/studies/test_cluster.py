"""`palpate sweep --scheduler`: the same answers from the workers of a dask scheduler."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element
from palpate.validation.case import load_case
from palpate.validation.case.variants import read_axis, variants
from palpate.validation.solving import Simulator
from palpate.validation.states import in_silence
from palpate.validation.studies.sweep_runs import (
    Run,
    SchedulerError,
    _require_workers,
    run_all,
    solve_row,
)

CASE = load_case("block")
AXES = [read_axis("load[0].factor=0.5,1", CASE)]


@pytest.fixture
def scheduler() -> Iterator[str]:
    """A scheduler with one worker, in this process."""
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as started:
        yield started.scheduler_address


def require_same(ours: list[Run], theirs: list[Run]) -> None:
    assert [(r.values, r.who, r.strain) for r in ours] == [
        (r.values, r.who, r.strain) for r in theirs
    ]
    for one, other in zip(ours, theirs, strict=True):
        assert one.state is not None
        assert other.state is not None
        np.testing.assert_array_equal(one.state.displacement, other.state.displacement)


def test_workers_compute_as_this_machine_does(scheduler: str) -> None:
    found, lines = variants(CASE, AXES), []
    here = run_all(AXES, found, [Simulator.FASTSIM], progress=in_silence)
    there = run_all(AXES, found, [Simulator.FASTSIM], scheduler=scheduler, progress=lines.append)
    require_same(here, there)
    assert len(lines) == 2
    assert lines[-1].endswith("2 of 2 rows done")


@pytest.mark.parametrize("element", Element)
def test_a_row_travels_and_is_solved_as_it_was(element: Element) -> None:
    given = [(variant.values, variant.case.problem) for variant in variants(CASE, AXES)]
    row = (AXES, given, CASE.spec.units, Simulator.FASTSIM, element, CASE.strain)
    solve, sent = pickle.loads(pickle.dumps((solve_row, row)))
    require_same(solve_row(*row), solve(*sent))


def sweep_cli(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = ["sweep", "block", "--vary", "load[0].factor=0.5,1", "-o", str(folder / "out")]
    return subprocess.run(
        [sys.executable, "-m", "palpate.validation.cli", *command, *options],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


@pytest.mark.long
def test_nobody_at_the_address_is_said_and_nothing_is_written(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    done = sweep_cli(tmp_path, "--scheduler", "tcp://127.0.0.1:9")
    assert done.returncode == 2
    assert "no dask scheduler answers there" in done.stderr
    assert not (tmp_path / "out").exists()


def test_without_the_extra_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SchedulerError, match=r"palpate\[cluster\]") as caught:
        run_all(
            AXES, variants(CASE, AXES), [Simulator.FASTSIM],
            scheduler="tcp://nowhere:1", progress=in_silence,
        )  # fmt: skip
    assert caught.value.address == "tcp://nowhere:1"


def test_threads_here_and_workers_there_are_not_both_asked_for(tmp_path: Path) -> None:
    done = sweep_cli(tmp_path, "--scheduler", "tcp://127.0.0.1:9", "--jobs", "2")
    assert done.returncode == 2
    assert "not both" in done.stderr


@pytest.mark.parametrize(
    ("versions", "words"),
    [
        ({}, "no worker"),
        ({"tcp://w:1": "0.0.1"}, "has palpate 0.0.1"),
        ({"tcp://w:1": ModuleNotFoundError("No module named 'palpate'")}, "has no palpate"),
    ],
)
def test_workers_that_would_compute_otherwise_are_refused(
    versions: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        _require_workers("tcp://s:1", versions)
