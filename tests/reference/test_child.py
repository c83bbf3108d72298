"""The reference in its own process: answers, failures, time limits, spoiled caches."""

from __future__ import annotations

import pickle
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from bank import support

from palpate.meshes.boundary_conditions import BodyForce, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_modes import UnsupportedBodyError
from palpate.reference import child
from palpate.reference.availability import is_available
from palpate.reference.child import child_environment, run_task
from palpate.reference.errors import (
    ReferenceBlowUpError,
    ReferenceCrashedError,
    ReferenceNotConvergedError,
    ReferenceStepError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)
from palpate.reference.tasks import StaticTask

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx


@pytest.fixture
def beam(box):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    supports = (support(mesh, "x0"),)
    return Problem(mesh, Material(1e4, 0.35), supports, (BodyForce((0.0, 90.0, -300.0)),))


@pytest.mark.parametrize("strain", list(Strain))
def test_the_child_gives_the_same_answer_bit_for_bit(beam, strain):
    lines = []
    there = run_task(StaticTask(strain), beam, time_limit=120, progress=lines.append)
    here = solve_static(beam, strain=strain)
    assert np.array_equal(there.displacement, here.displacement)
    assert there.strain is strain
    assert (there.volume, there.load_steps) == (here.volume, here.load_steps)
    assert there.versions["dolfinx"]
    assert any("relative residual" in line for line in lines)


def test_bad_input_comes_back_as_one_line(beam):
    with pytest.raises(InputError, match="degree = 7") as caught:
        run_task(StaticTask(degree=7), beam, time_limit=120)
    assert "\n" not in str(caught.value)


def test_lost_equilibrium_comes_back_with_the_last_state(beam):
    pushed = beam.mesh.facet_groups["x1"]
    crushed = Problem(
        beam.mesh, beam.material, beam.supports, (Traction(pushed, (-4000.0, 0.0, 0.0)),)
    )
    with pytest.raises(ReferenceNotConvergedError) as caught:
        run_task(StaticTask(), crushed, time_limit=120)
    assert 0.0 < caught.value.load_factor < 1.0
    assert caught.value.displacement.shape == beam.mesh.points.shape
    assert caught.value.displacement[:, 0].min() < 0.0


def test_the_time_limit_ends_the_child_and_its_children(tmp_path, monkeypatch, beam):
    # Stands in for a solve that hangs: a process that starts another and waits for ever.
    hang = tmp_path / "hang.py"
    hang.write_text(
        "import subprocess, sys, pathlib\n"
        "p = subprocess.Popen(['sleep', '1000'])\n"
        f"pathlib.Path({str(tmp_path / 'pid')!r}).write_text(str(p.pid))\n"
        "print('stuck', file=sys.stderr, flush=True)\n"
        "p.wait()\n"
    )
    monkeypatch.setattr(child, "_command", lambda *_: [sys.executable, str(hang)])
    start = time.monotonic()
    with pytest.raises(ReferenceTimeoutError, match="2 s") as caught:
        run_task(StaticTask(), beam, time_limit=2.0)
    assert time.monotonic() - start < 20.0
    assert "stuck" in caught.value.stderr_tail
    assert not is_running(int((tmp_path / "pid").read_text()))


def is_running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.parametrize(
    ("program", "how"),
    [
        ("import os; os.abort()", "SIGABRT"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "memory"),
        ("raise RuntimeError('inner wheel fell off')", "inner wheel fell off"),
        ("pass", "no readable answer"),
    ],
)
def test_a_crash_is_told_with_its_cause(monkeypatch, beam, program, how):
    monkeypatch.setattr(child, "_command", lambda *_: [sys.executable, "-c", program])
    with pytest.raises(ReferenceCrashedError, match=how):
        run_task(StaticTask(), beam, time_limit=60)


def test_a_half_written_answer_is_a_crash(monkeypatch, beam):
    def command(_given, answer):
        return [sys.executable, "-c", f"open({str(answer)!r}, 'wb').write(b'PK half')"]

    monkeypatch.setattr(child, "_command", command)
    with pytest.raises(ReferenceCrashedError, match="no readable answer"):
        run_task(StaticTask(), beam, time_limit=60)


@pytest.mark.parametrize(
    "error",
    [
        ReferenceNotConvergedError(0.5, "lost", 0.3, np.ones((2, 3)), 0.6, np.arange(3.0)),
        ReferenceStepError(0.2, 1e-6, "no convergence", np.ones((2, 3))),
        ReferenceBlowUpError(7, 0.1, np.ones((2, 3))),
        UnsupportedBodyError(3, 1, 2, 0),
    ],
)
def test_a_failure_arrives_with_all_that_it_carries(error):
    arrived = pickle.loads(pickle.dumps(error))
    assert type(arrived) is type(error)
    assert str(arrived) == str(error)
    np.testing.assert_equal(vars(arrived), vars(error))


def test_no_fenicsx_is_said_with_the_remedy(monkeypatch, beam):
    def refuse():
        raise ReferenceUnavailableError("FEniCSx (dolfinx) is not installed")

    monkeypatch.setattr(child, "require_available", refuse)
    with pytest.raises(ReferenceUnavailableError, match="not installed"):
        run_task(StaticTask(), beam)


def test_a_broken_fenicsx_is_unavailable_not_a_crash(tmp_path, monkeypatch, beam):
    (tmp_path / "dolfinx").mkdir()
    (tmp_path / "dolfinx" / "__init__.py").write_text("raise ImportError('libmpi.so.12')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ReferenceUnavailableError, match=r"libmpi\.so\.12"):
        run_task(StaticTask(), beam, time_limit=60)


def test_a_time_limit_of_zero_is_refused(beam):
    with pytest.raises(InputError, match="time_limit"):
        run_task(StaticTask(), beam, time_limit=0.0)


@pytest.mark.long
def test_a_cache_spoiled_by_a_killed_run_is_mended(tmp_path, monkeypatch, beam):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = run_task(StaticTask(Strain.LINEAR), beam, time_limit=300)
    ready = list(tmp_path.rglob("*.c.cached"))
    assert ready
    for mark in ready:
        # What a run killed inside the compiler leaves: the source without its mark.
        mark.unlink()
    again = run_task(StaticTask(Strain.LINEAR), beam, time_limit=300)
    assert np.array_equal(first.displacement, again.displacement)
    assert len(list(tmp_path.rglob("*.c.cached"))) == len(ready)


def test_the_child_ends_when_its_caller_is_killed():
    caller = (
        "import sys\n"
        "from palpate.reference.child import run_child\n"
        "child = 'import os, time; print(\"progress:\", os.getpid(), flush=True)'\n"
        "child += '; time.sleep(600)'\n"
        "run_child([sys.executable, '-c', child], 600.0, lambda line: print(line, flush=True))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", caller], stdout=subprocess.PIPE, env=child_environment()
    )
    child_number = int(process.stdout.readline())
    assert is_running(child_number)
    process.kill()
    process.communicate()
    while is_running(child_number):  # the test's own time limit is the deadline
        time.sleep(0.05)
