"""How commands end: signals tidy up, readers that leave change no verdict."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from signals import PALPATE, default_signals, group_members

from palpate.validation.commands.endings import end_of, stoppable

SLEEPER = """
import os, subprocess, sys, time
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
print(os.getpid(), file=open(sys.argv[3] + ".new", "w"))
os.rename(sys.argv[3] + ".new", sys.argv[3])
time.sleep(600)
"""


def wait_until(is_so: Callable[[], bool]) -> None:
    """The test's own time limit is the deadline."""
    while not is_so():
        time.sleep(0.02)


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs /proc")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_ends_the_simulator_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    number = getattr(signal, name)
    scratch, ready = tmp_path / "scratch", tmp_path / "ready"
    scratch.mkdir()
    (tmp_path / "mysim.py").write_text(SLEEPER)
    line = f"{sys.executable} {tmp_path / 'mysim.py'} {{case}} {{result}} {ready}"
    words = ["gate", "block", "--simulator", line, "--json", str(tmp_path / "r.json")]
    with subprocess.Popen(
        [*PALPATE, *words],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(scratch)},
        start_new_session=True,  # the shell's Ctrl-C reaches palpate alone here
        preexec_fn=default_signals,
    ) as process:
        wait_until(ready.exists)
        assert len(group_members(scratch)) == 4  # palpate, supervisor, simulator, its child
        process.send_signal(number)
        _, reported = process.communicate()
    assert process.returncode == 128 + number, reported
    assert "stopped; nothing half-written was left" in reported
    assert "Traceback" not in reported
    assert group_members(scratch) == []
    assert list(scratch.iterdir()) == []
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mysim.py", "ready", "scratch"]


def run(code: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        capture_output=True, text=True, check=False, preexec_fn=default_signals,
    )  # fmt: skip


def test_a_signal_that_is_ignored_stays_so() -> None:
    done = run(
        "import os, signal\n"
        "from palpate.validation.commands.endings import stoppable\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "with stoppable():\n"
        "    os.kill(os.getpid(), signal.SIGHUP)\n"
        "print('still there')\n"
    )
    assert done.stdout == "still there\n", done.stderr


def test_a_second_signal_does_not_disturb_the_tidying() -> None:
    done = run(
        "import os, signal\n"
        "from palpate.validation.commands.endings import stoppable\n"
        "try:\n"
        "    with stoppable() as stop:\n"
        "        try:\n"
        "            os.kill(os.getpid(), signal.SIGTERM)\n"
        "        finally:\n"
        "            os.kill(os.getpid(), signal.SIGTERM); os.kill(os.getpid(), signal.SIGHUP)\n"
        "            print('tidied')\n"
        "except KeyboardInterrupt:\n"
        "    print(stop.number)\n"
    )
    assert done.stdout == f"tidied\n{int(signal.SIGTERM)}\n", done.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the lock is glibc's")
def test_a_computation_that_ignores_signals_is_ended_all_the_same() -> None:
    """A C mutex locked twice waits for ever, and no signal wakes it."""
    done = run(
        "import ctypes, os, signal, threading\n"
        "from palpate.validation.commands import endings\n"
        "endings._PATIENCE = 0.2\n"
        "library, mutex = ctypes.CDLL(None), ctypes.create_string_buffer(64)\n"
        "stop = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM))\n"
        "with endings.stoppable():\n"
        "    library.pthread_mutex_lock(mutex); stop.start(); library.pthread_mutex_lock(mutex)\n"
    )
    assert done.returncode == 128 + signal.SIGTERM, done.stderr


def test_signals_are_as_before_afterwards() -> None:
    before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with pytest.raises(KeyboardInterrupt), stoppable():
        os.kill(os.getpid(), signal.SIGTERM)
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


@pytest.mark.parametrize(
    ("words", "stream"),
    [
        (["cases"], "both"),
        (["gate", "block"], "stdout"),
        (["gate", "block", "--fault", "softer"], "both"),
    ],
)
def test_a_reader_that_leaves_does_not_change_the_verdict(words: list[str], stream: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    errors = writing if stream == "both" else subprocess.PIPE
    done = subprocess.run([*PALPATE, *words], stdout=writing, stderr=errors, check=False)
    os.close(writing)
    assert done.returncode == ("softer" in words)
    assert b"Error" not in (done.stderr or b"")


def test_a_closed_standard_output_does_not_change_the_verdict() -> None:
    shell = f"exec {sys.executable} -m palpate.validation.cli gate block >&-"
    assert subprocess.run(["sh", "-c", shell], capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_standard_output_is_one_clear_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([*PALPATE, "cases"], stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 2
    assert done.stderr.decode().splitlines() == ["palpate: : No space left on device"]


def test_an_end_of_file_inside_is_no_ctrl_c(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for cause, code in ((EOFError("no more data"), 4), (KeyboardInterrupt(), 130)):
        error = typer.Abort()
        error.__cause__ = cause
        assert end_of(error) == code
    reported = capsys.readouterr().err
    assert "internal error: EOFError: no more data" in reported
    assert "stopped" in reported
