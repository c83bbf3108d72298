"""What is begun ends: nothing is left of `palpate touch` when its page is killed, or by Ctrl-C."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from palpate.validation.live.bench_touch import connected
from palpate.validation.report.pdf import find_browser

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
# The command, with a verdict that would take ten minutes, and a word whenever a page comes.
COMMAND = """
import signal, sys
from palpate.reference import availability
from palpate.validation import cli
from palpate.validation.live import judging
from palpate.validation.live.simulation import Simulation

seen = Simulation.seen


def say_and_see(simulation, is_seen):
    print("seen", is_seen, flush=True)
    seen(simulation, is_seen)


Simulation.seen = say_and_see
availability.is_available = lambda: True
judging.VERDICT = "sleeping_verdict"
signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # as PETSc and gmsh leave it
sys.argv = ["palpate", *sys.argv[1:]]
cli.main()
"""


def in_session(number: int) -> list[str]:
    """Command lines of the processes of a session."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            state = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(state[3]) == number and state[0] != "Z":
                found.append((folder / "cmdline").read_text().replace("\0", " "))
    return found


@contextmanager
def touching(folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The command in a session of its own, and the page's address."""
    (folder / "sleeping_verdict.py").write_text(
        "import time; print('begun', flush=True); time.sleep(600)"
    )
    words = [sys.executable, "-c", COMMAND, "touch", "block", "--no-browser", *options]
    with subprocess.Popen(
        [*words, "--damping", "100", "-o", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A shell ignores Ctrl-C for a job in the background.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path])},
    ) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().split()[-1]
        finally:
            process.kill()


def until(is_so: Callable[[], bool], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.long
def test_ctrl_c_ends_the_page_the_bodies_and_the_verdict(tmp_path: Path) -> None:
    from websockets.exceptions import ConnectionClosed

    with touching(tmp_path) as (process, address):
        with connected(address) as client:
            x, y, z = client.scene["tool"]["start"]
            client.say("tool", number=1, to=[x - 6.0, y, z])
            client.until_time(0.3)
            client.say("judge")
            client.until(lambda heard: heard.get("text", "").endswith("begun"))
            assert any("sleeping_verdict" in line for line in in_session(process.pid))
            process.send_signal(signal.SIGINT)
            with pytest.raises(ConnectionClosed):
                client.until_time(1e9)
        assert process.wait(30) in (0, 130)
        assert process.stderr is not None
        assert "Traceback" not in process.stderr.read()
        until(lambda: in_session(process.pid) == [])


@pytest.mark.long
def test_a_socket_that_breaks_ends_the_command_by_and_by(tmp_path: Path) -> None:
    with touching(tmp_path, "--wait", "0.2") as (process, address):
        with connected(address) as client:
            client.until_time(0.02)
            client.socket.socket.close()
        assert process.wait(30) == 0
        assert in_session(process.pid) == []


@pytest.mark.browser
def test_a_browser_that_is_killed_leaves_no_process(
    tmp_path: Path, require_browser_tests: Callable[[str], None]
) -> None:
    program = find_browser()
    if program is None:
        require_browser_tests("chromium")
    assert program is not None
    options = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"]
    options += ["--enable-unsafe-swiftshader", f"--user-data-dir={tmp_path / 'profile'}"]
    with touching(tmp_path, "--wait", "0.2") as (process, address):
        with subprocess.Popen(
            [program, *options, "--remote-debugging-port=0", address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as browser:
            try:
                assert process.stdout is not None
                assert any(line == "seen True\n" for line in process.stdout)
            finally:
                os.killpg(browser.pid, signal.SIGKILL)
        assert process.wait(30) == 0
        assert in_session(process.pid) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("broken")])
def test_an_interrupt_that_comes_in_a_task_is_no_trouble_of_it(
    error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    import asyncio

    from palpate.validation.live.server import _without_interrupts

    loop = asyncio.new_event_loop()
    try:
        loop.set_exception_handler(_without_interrupts)
        loop.call_exception_handler({"message": "never retrieved", "exception": error})
    finally:
        loop.close()
    assert ("never retrieved" in caplog.text) == isinstance(error, RuntimeError)
