"""A process of its own for the reference: time limit, progress lines, exit codes.

dolfinx can abort, hang or be killed for memory; the caller must survive all three. Problem and
answer travel as files, progress as lines on standard output.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO

from palpate.meshes.errors import InputError
from palpate.reference.availability import require_available
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)

EXIT_INPUT = 2
EXIT_FAILED = 3
EXIT_UNAVAILABLE = 4
UNTIL_STDIN_CLOSES = "--until-stdin-closes"
_PROGRESS = "progress: "
_STDERR_LINES = 40

Say = Callable[[str], None]


def child_environment() -> dict[str, str]:
    """Environment of the child: this one, the same import path, one thread per solve.

    One thread keeps the order of every sum, so that a run repeats bit for bit.
    """
    # Under mpirun a child must not take itself for one of the ranks.
    ranks = ("OMPI_", "PMIX_", "PMI_")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(ranks)}
    environment["PYTHONPATH"] = os.pathsep.join(str(Path(p).absolute()) for p in sys.path if p)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        environment[name] = "1"
    return environment


def run_child(command: Sequence[str], time_limit: float, progress: Say | None) -> tuple[int, str]:
    """Run a command in its own process group.

    Args:
        command: Program and arguments; `UNTIL_STDIN_CLOSES` among them ends it with its caller.
        time_limit: It and whatever it started are ended after this [s], > 0.
        progress: Called with one line of text now and then.

    Returns:
        Its exit status and the last lines of its standard error.

    Raises:
        InputError: A time limit that is not above 0.
        ReferenceTimeoutError: No end within the time limit.
    """
    if not time_limit > 0.0:
        raise InputError(f"time_limit = {time_limit:g} s: needs a value above 0")
    told = progress or _say_nothing
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=child_environment(),
        start_new_session=True,
    )
    errors: deque[str] = deque(maxlen=_STDERR_LINES)
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    lines: deque[str] = deque()
    readers = [
        threading.Thread(target=_drain, args=(process.stderr, errors), daemon=True),
        threading.Thread(target=_drain, args=(process.stdout, lines), daemon=True),
    ]
    deadline = time.monotonic() + time_limit
    try:
        for reader in readers:
            reader.start()
        while True:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=min(0.05, max(0.0, deadline - time.monotonic())))
            _pass_on(lines, told)
            if process.returncode is not None:
                break
            if time.monotonic() >= deadline:
                raise ReferenceTimeoutError(time_limit, "".join(errors))
        for reader in readers:
            reader.join(timeout=5.0)
        _pass_on(lines, told)
    finally:
        _end_group(process)
        for reader in readers:
            reader.join(timeout=5.0)
        process.stdin.close()
        process.stdout.close()
        process.stderr.close()
    return process.returncode, "".join(errors)


def _say_nothing(_line: str) -> None:
    pass


def _drain(stream: IO[str], lines: deque[str]) -> None:
    lines.extend(stream)


def _pass_on(lines: deque[str], progress: Callable[[str], None]) -> None:
    while lines:
        line = lines.popleft()
        if line.startswith(_PROGRESS):
            progress(line.removeprefix(_PROGRESS).rstrip("\n"))


def _end_group(process: subprocess.Popen[str]) -> None:
    """End the child and whatever it started (a compiler, say)."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def raise_for(exit_code: int, errors: str) -> None:
    """Raise what the child could not: bad input, no FEniCSx, a crash; nothing for 0 and failure.

    Raises:
        InputError, ReferenceUnavailableError, ReferenceCrashedError: As the exit status says.
    """
    message = errors.strip().splitlines()[-1:] or [""]
    if exit_code == EXIT_INPUT:
        raise InputError(message[0])
    if exit_code == EXIT_UNAVAILABLE:
        raise ReferenceUnavailableError(message[0])
    if exit_code not in (0, EXIT_FAILED):
        raise ReferenceCrashedError(exit_code, errors)


def serve(solve: Callable[[Say], int], *, ends_with_caller: bool) -> int:
    """The child's side: run `solve` with a way to say lines; return the exit status."""
    if ends_with_caller:
        threading.Thread(target=_end_with_caller, daemon=True).start()

    def say(line: str) -> None:
        print(f"{_PROGRESS}{line}", flush=True)

    try:
        require_available()
        return solve(say)
    except InputError as error:
        print(one_line(error), file=sys.stderr)
        return EXIT_INPUT
    except (ReferenceUnavailableError, ImportError) as error:
        print(f"FEniCSx cannot be imported: {one_line(error)}", file=sys.stderr)
        return EXIT_UNAVAILABLE


def one_line(error: BaseException) -> str:
    """An error's message without line breaks."""
    return " ".join(str(error).split())


def _end_with_caller() -> None:
    # Not sys.stdin: a thread inside its buffer aborts the interpreter's shutdown.
    while os.read(0, 4096):
        pass
    os._exit(1)
