"""Programs that end with whoever started them, whatever they started and however that ends."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from palpate.meshes.supervised import run_supervised, supervised

needs_linux = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="elsewhere only the process group ends"
)
# Says its number and waits: a child, its child in a session of its own, and one left by its parent.
FAMILY = """
import os, sys, time
def say():
    with open(sys.argv[1], "a") as file:
        file.write(f"{os.getpid()}\\n")
say()
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        say()
        time.sleep(600)
    os._exit(0)
if os.fork() == 0:
    os.setsid()
    say()
    time.sleep(600)
with open(sys.argv[1]) as file:
    while len(file.readlines()) < 3:
        file.seek(0)
        time.sleep(0.01)
print("all there", flush=True)
"""


def is_running(number: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{number}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def family_of(file: Path) -> list[int]:
    return [int(line) for line in file.read_text().split()]


def wait_for_the_end_of(numbers: list[int]) -> None:
    """The test's own time limit is the deadline."""
    while any(is_running(number) for number in numbers):
        time.sleep(0.02)


def test_a_program_ends_as_it_would_alone() -> None:
    code = "import sys; print('said'); print('wrong', file=sys.stderr); sys.exit(7)"
    done = run_supervised([sys.executable, "-c", code], time_limit=60)
    assert (done.returncode, done.stdout, done.stderr) == (7, "said\n", "wrong\n")
    for number in (signal.SIGSEGV, signal.SIGKILL, signal.SIGTERM, signal.SIGPIPE):
        code = (
            f"import os, signal; signal.signal(13, signal.SIG_DFL); os.kill(os.getpid(), {number})"
        )
        assert run_supervised([sys.executable, "-c", code], time_limit=60).returncode == -number


def test_a_program_that_cannot_be_started_is_an_os_error(tmp_path: Path) -> None:
    text = tmp_path / "text"
    text.write_text("no program")
    with pytest.raises(PermissionError):
        run_supervised([text], time_limit=60)
    text.chmod(0o755)
    with pytest.raises(OSError, match="Exec format error"):
        run_supervised([text], time_limit=60)
    with pytest.raises(FileNotFoundError):
        run_supervised([tmp_path / "nowhere"], time_limit=60)


@needs_linux
def test_what_python_ignores_is_not_ignored_in_the_program() -> None:
    reported = run_supervised(["grep", "SigIgn", "/proc/self/status"], time_limit=60).stdout
    assert not int(reported.split()[1], 16) & (1 << (signal.SIGPIPE - 1))


@needs_linux
def test_what_a_program_leaves_behind_ends_with_it(tmp_path: Path) -> None:
    done = run_supervised([sys.executable, "-c", FAMILY, tmp_path / "family"], time_limit=60)
    assert done.stdout == "all there\n"
    assert len(family_of(tmp_path / "family")) == 3
    assert not any(map(is_running, family_of(tmp_path / "family")))


@needs_linux
def test_at_the_time_limit_a_program_ends_with_all_it_started(tmp_path: Path) -> None:
    lasting = FAMILY + "time.sleep(600)\n"
    words = [sys.executable, "-c", lasting, str(tmp_path / "family")]
    with supervised(words, stdout=subprocess.PIPE, text=True) as process, process.stdout as said:
        assert said.readline() == "all there\n"
    assert process.returncode is not None
    assert len(family_of(tmp_path / "family")) == 3
    assert not any(map(is_running, family_of(tmp_path / "family")))


@needs_linux
@pytest.mark.parametrize("killed", ["caller", "supervisor", "caller that forked"])
def test_a_kill_leaves_nothing_running(tmp_path: Path, killed: str) -> None:
    caller = (
        "import os, sys, time\n"
        "from palpate.meshes.supervised import supervised\n"
        "with supervised([sys.executable, *sys.argv[2:]]) as process:\n"
        "    print(process.pid, flush=True)\n"
        "    if sys.argv[1] == 'caller that forked' and os.fork() == 0:\n"
        "        open(sys.argv[4] + '.forked', 'w').write(str(os.getpid()))\n"
        "        time.sleep(600)\n"  # and holds every pipe of its parent
        "    time.sleep(600)\n"
    )
    # Killed itself, the supervisor takes the program along, and nothing else can be promised.
    lasting = (FAMILY if killed != "supervisor" else FAMILY.split("if os.fork")[0]) + (
        "\nprint('all there', flush=True)\ntime.sleep(600)\n"
    )
    words = [sys.executable, "-c", caller, killed, "-c", lasting, str(tmp_path / "family")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = {process.stdout.readline(), process.stdout.readline()}
        supervisor = int((said - {"all there\n"}).pop())
        numbers = family_of(tmp_path / "family")
        assert all(map(is_running, [*numbers, supervisor]))
        os.kill(supervisor if killed == "supervisor" else process.pid, signal.SIGKILL)
        wait_for_the_end_of([*numbers, supervisor])
        if killed == "caller that forked":
            os.kill(int((tmp_path / "family.forked").read_text()), signal.SIGKILL)
        with contextlib.suppress(ProcessLookupError):
            process.kill()
