"""Rivals are timed in processes of their own: absent, unfit, failing, hanging and fresh ones."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.validation.peers import timing
from palpate.validation.peers.registry import OURS, Tool
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
        ("os.abort()", "the process ended without a word"),
        ("raise SystemExit('no licence')", "no licence"),
        ("__import__('time').sleep(60)", "not done within 3 s"),
    ],
)
def test_a_rival_that_crashes_or_hangs_is_told_not_timed(adapter, code, says):
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


def test_memory_is_the_childs_own(adapter):
    # A child of a large parent starts small: the figure is not handed down.
    ballast = np.ones(2**27)
    with timed((adapter(""),), "Task", {}, Schedule(1), in_silence) as (child,):
        assert child.timings[0]["peak_memory_mb"] < ballast.nbytes / 2**20 / 2
