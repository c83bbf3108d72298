"""The reference in a process of its own: time limit, progress lines, exit codes.

dolfinx can abort, hang or be killed for memory; the caller must survive all three. The child is
python -m palpate.reference.child TASK RESULT, both pickled: a task with its problem, and what it
returns or raises. Its progress comes as lines on standard output.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.supervised import supervised
from palpate.meshes.temporaries import scratch_folder
from palpate.reference.availability import require_available
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceFailedError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)
from palpate.reference.ranks import num_ranks, solve_on_ranks
from palpate.reference.tasks import Answer, Progress, Task, say_nothing

_PROGRESS = "progress: "
_STDERR_LINES = 40

_STREAMS: dict[str, Any] = {
    "stdin": subprocess.DEVNULL,
    "stdout": subprocess.PIPE,
    "stderr": subprocess.PIPE,
    "text": True,
    "errors": "replace",
}


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


def run_child(
    command: Sequence[str],
    time_limit: float,
    progress: Progress | None,
    *,
    temporaries: Path | None = None,
) -> tuple[int, str]:
    """Run a command; it and the processes that it starts end at the latest with this process.

    `temporaries` is a folder for files of MPI and compilers, which a killed child leaves.

    Returns:
        The exit status and the last lines of the command's standard error.

    Raises:
        InputError: The time limit is not above 0.
        ReferenceTimeoutError: The command did not end within the time limit [s].
    """
    if not time_limit > 0.0:
        raise InputError(f"time_limit = {time_limit:g} s: needs a value above 0")
    tell = progress or say_nothing
    errors: deque[str] = deque(maxlen=_STDERR_LINES)
    lines: deque[str] = deque()
    readers: list[threading.Thread] = []
    deadline = time.monotonic() + time_limit
    environment = child_environment()
    if temporaries is not None:
        environment["TMPDIR"] = str(temporaries)
    with contextlib.ExitStack() as ends:
        ends.callback(_join, readers)
        process = ends.enter_context(supervised(command, env=environment, **_STREAMS))
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


def _drain(stream: IO[str], lines: deque[str]) -> None:
    with stream:
        lines.extend(stream)


def _join(readers: list[threading.Thread]) -> None:
    for reader in readers:
        reader.join(timeout=5.0)


def _pass_on(lines: deque[str], progress: Progress) -> None:
    while lines:
        line = lines.popleft()
        if line.startswith(_PROGRESS):
            progress(line.removeprefix(_PROGRESS).rstrip("\n"))


def run_task(
    task: Task[Answer],
    problem: Problem,
    *,
    time_limit: float = 3600.0,
    progress: Progress | None = None,
) -> Answer:
    """Do a task in a child process; under mpirun on all its ranks, in this process.

    A task that needs one rank runs in a child of rank 0, and the other ranks wait for it.

    Args:
        task: The task.
        problem: The problem that it is called with.
        time_limit: The child and its own children are ended after this [s], > 0.
        progress: Called with one line of text now and then.

    Returns:
        What the task's own function returns.

    Raises:
        InputError: The problem cannot be used.
        ReferenceNotConvergedError, ReferenceStepError, ReferenceBlowUpError: Raised by it.
        ReferenceUnavailableError: FEniCSx cannot be imported here.
        ReferenceTimeoutError: There was no result within the time limit.
        ReferenceCrashedError: The child died, or left no result.
    """
    require_available()
    if num_ranks() > 1 and not task.needs_one_rank:
        answered: Answer = solve_on_ranks(
            task, problem, time_limit=time_limit, progress=progress or say_nothing
        )
        return answered
    with scratch_folder("reference") as folder:
        given, answer = folder / "task.pickle", folder / "result.pickle"
        given.write_bytes(pickle.dumps((task, problem)))
        exit_code, errors = run_child(
            _command(given, answer), time_limit, progress, temporaries=folder
        )
        if exit_code != 0:
            raise ReferenceCrashedError(exit_code, errors)
        try:
            answered = pickle.loads(answer.read_bytes())
        except Exception as error:  # damage shows as any kind of error
            reason = " ".join(str(error).split())
            unread = f"{errors}\nno readable answer: {reason}"
            raise ReferenceCrashedError(exit_code, unread) from error
        if isinstance(answered, Exception):
            raise answered
        found: Answer = answered
        return found


def _command(*files: Path) -> list[str]:
    # -P: the child must not import a file called numpy.py from the current folder.
    return [sys.executable, "-P", "-m", "palpate.reference.child", *map(str, files)]


def main(arguments: Sequence[str]) -> int:
    """Read a task and its problem, write what it returns or raises; return the exit status."""
    given, answer = map(Path, arguments)

    def say(line: str) -> None:
        print(f"{_PROGRESS}{line}", flush=True)

    result: Any
    try:
        require_available()
        task, problem = pickle.loads(given.read_bytes())
        say("loading FEniCSx")
        result = task(problem, say)
    except (ReferenceFailedError, InputError) as error:
        result = error
    except ImportError as error:
        result = ReferenceUnavailableError(f"FEniCSx cannot be imported: {error}")
    answer.write_bytes(pickle.dumps(result))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
