"""The reference in a process of its own: time limit, progress lines, exit codes.

dolfinx can abort, hang or be killed for memory; the caller must survive all three. The child is
python -m palpate.reference.child PROBLEM.npz TASK.npz RESULT.npz; its progress comes as lines on
standard output.
"""

from __future__ import annotations

import contextlib
import inspect
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.problem import Problem
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.meshes.supervised import supervised
from palpate.meshes.temporaries import atomic_path, scratch_folder
from palpate.reference.availability import require_available
from palpate.reference.errors import (
    ReferenceBlowUpError,
    ReferenceCrashedError,
    ReferenceNotConvergedError,
    ReferenceStepError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)
from palpate.reference.ranks import num_ranks, solve_on_ranks
from palpate.reference.result import load_result, save_result
from palpate.reference.tasks import Answer, Progress, Task, load_task, say_nothing

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

    Args:
        command: Program and arguments.
        time_limit: The command and its own children are ended after this [s], > 0.
        progress: Called with one line of text now and then.
        temporaries: Folder for files of MPI and compilers, which a killed child leaves.

    Returns:
        The exit status and the last lines of the command's standard error.

    Raises:
        InputError: The time limit is not above 0.
        ReferenceTimeoutError: The command did not end within the time limit.
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


# Errors by which a solve may end without a result; the child writes them to a file too.
_FAILURES = (ReferenceNotConvergedError, ReferenceStepError, ReferenceBlowUpError)


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
        given, answer, todo = (folder / f"{name}.npz" for name in ("problem", "result", "task"))
        save_problem(given, problem)
        save_result(todo, task)
        command = _command(given, todo, answer)
        exit_code, errors = run_child(command, time_limit, progress, temporaries=folder)
        return _read_answer(answer, exit_code, errors, task)


def _command(*files: Path) -> list[str]:
    # -P: the child must not import a file called numpy.py from the current folder.
    return [sys.executable, "-P", "-m", "palpate.reference.child", *map(str, files)]


def _read_answer(answer: Path, exit_code: int, errors: str, task: Task[Answer]) -> Answer:
    message = (errors.strip().splitlines() or [""])[-1]
    if exit_code == EXIT_INPUT:
        raise InputError(message)
    if exit_code == EXIT_UNAVAILABLE:
        raise ReferenceUnavailableError(message)
    if exit_code not in (0, EXIT_FAILED):
        raise ReferenceCrashedError(exit_code, errors)
    try:
        if exit_code == EXIT_FAILED:
            raise _load_failure(answer)
        answered: Answer = load_result(answer, task.answer)
        return answered
    except (FileFormatError, OSError, KeyError, ValueError) as error:
        raise ReferenceCrashedError(exit_code, f"{errors}\nno readable answer: {error}") from error


def _save_failure(path: Path, error: Exception) -> None:
    """Write the arguments of an error: its attributes have their names."""
    fields = {name: np.asarray(getattr(error, name)) for name in _arguments(type(error))}
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, kind=type(error).__name__, **fields)


def _load_failure(path: Path) -> Exception:
    with np.load(path, allow_pickle=False) as stored:
        kind = {kind.__name__: kind for kind in _FAILURES}[str(stored["kind"])]
        given = {name: stored[name] for name in _arguments(kind)}
    return kind(**{name: v if v.ndim else v.item() for name, v in given.items()})


def _arguments(kind: type[Exception]) -> list[str]:
    return list(inspect.signature(kind).parameters)


def main(arguments: Sequence[str]) -> int:
    """Read a problem, a task and the path of the result; return the exit status."""
    given, todo, answer = map(Path, arguments)

    def say(line: str) -> None:
        print(f"{_PROGRESS}{line}", flush=True)

    def end(exit_code: int, error: BaseException, what: str = "") -> int:
        """Write the error as one line to standard error; return the exit status."""
        print(what + " ".join(str(error).split()), file=sys.stderr)
        return exit_code

    try:
        require_available()
        problem, task = load_problem(given), load_task(todo)
        say("loading FEniCSx")
        save_result(answer, task(problem, say))
    except _FAILURES as error:
        _save_failure(answer, error)
        return end(EXIT_FAILED, error)
    except InputError as error:
        return end(EXIT_INPUT, error)
    except (ReferenceUnavailableError, ImportError) as error:
        return end(EXIT_UNAVAILABLE, error, "FEniCSx cannot be imported: ")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
