"""A process of its own for the reference: time limit, progress lines, exit codes.

dolfinx can abort, hang or be killed for memory; the caller must survive all three. Problem and
answer travel as files, progress as lines on standard output.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any

from palpate.meshes.errors import InputError
from palpate.meshes.supervised import supervised
from palpate.reference.availability import require_available
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)

EXIT_INPUT = 2
EXIT_FAILED = 3
EXIT_UNAVAILABLE = 4
_PROGRESS = "progress: "
_STDERR_LINES = 40

_STREAMS: dict[str, Any] = {
    "stdin": subprocess.DEVNULL,
    "stdout": subprocess.PIPE,
    "stderr": subprocess.PIPE,
    "text": True,
    "errors": "replace",
}

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
    """Run a command that ends, with all it started, when this process does.

    Args:
        command: Program and arguments.
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
    tell = progress or say_nothing
    errors: deque[str] = deque(maxlen=_STDERR_LINES)
    lines: deque[str] = deque()
    readers: list[threading.Thread] = []
    deadline = time.monotonic() + time_limit
    with contextlib.ExitStack() as ends:
        ends.callback(_join, readers)
        process = ends.enter_context(supervised(command, env=child_environment(), **_STREAMS))
        for stream, kept in ((process.stderr, errors), (process.stdout, lines)):
            readers.append(threading.Thread(target=_drain, args=(stream, kept), daemon=True))
            readers[-1].start()
        while True:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=min(0.05, max(0.0, deadline - time.monotonic())))
            _pass_on(lines, tell)
            if process.returncode is not None:
                break
            if time.monotonic() >= deadline:
                raise ReferenceTimeoutError(time_limit, "".join(errors))
        _join(readers)
        _pass_on(lines, tell)
    return process.returncode, "".join(errors)


def say_nothing(_line: str) -> None:
    """Where nobody wants to hear of progress."""


def _drain(stream: IO[str], lines: deque[str]) -> None:
    with stream:
        lines.extend(stream)


def _join(readers: list[threading.Thread]) -> None:
    for reader in readers:
        reader.join(timeout=5.0)


def _pass_on(lines: deque[str], progress: Callable[[str], None]) -> None:
    while lines:
        line = lines.popleft()
        if line.startswith(_PROGRESS):
            progress(line.removeprefix(_PROGRESS).rstrip("\n"))


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


def serve(solve: Callable[[Say], int]) -> int:
    """The child's side: run `solve` with a way to say lines; return the exit status."""

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
