"""The reference in a process of its own, with a time limit.

dolfinx can abort, hang or be killed for memory; the caller must survive all three. Problem and
answer travel as files, progress as lines on standard output. What the child does:

    python -m palpate.reference.child PROBLEM.npz RESULT.npz --strain green --degree 2
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO

import numpy as np

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.reference.availability import require_available
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceNotConvergedError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)
from palpate.reference.result import ReferenceResult, load_result, save_result

_EXIT_INPUT = 2
_EXIT_NOT_CONVERGED = 3
_EXIT_UNAVAILABLE = 4
_PROGRESS = "progress: "
_STDERR_LINES = 40


def solve_static_in_child(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    degree: int = 1,
    relative_tolerance: float = 1e-10,
    time_limit: float = 3600.0,
    progress: Callable[[str], None] | None = None,
) -> ReferenceResult:
    """Do `palpate.reference.statics.solve_static` in a child process.

    Args:
        problem: Mesh, material, supports and loads.
        strain: Strain measure.
        degree: Polynomial degree of the displacement.
        relative_tolerance: See `solve_static`.
        time_limit: The child and whatever it started are ended after this [s], > 0.
        progress: Called with one line of text now and then.

    Returns:
        The converged state.

    Raises:
        InputError: The problem cannot be used.
        ReferenceNotConvergedError: No equilibrium under the full load.
        ReferenceUnavailableError: FEniCSx cannot be imported here.
        ReferenceTimeoutError: No answer within the time limit.
        ReferenceCrashedError: The child died, or left no answer.
    """
    if not time_limit > 0.0:
        raise InputError(f"time_limit = {time_limit:g} s: needs a value above 0")
    require_available()
    with tempfile.TemporaryDirectory(prefix="palpate-reference-") as folder:
        given, answer = Path(folder, "problem.npz"), Path(folder, "result.npz")
        save_problem(given, problem)
        command = _command(given, answer, Strain(strain), degree, relative_tolerance)
        exit_code, errors = _run(command, time_limit, progress or _say_nothing)
        return _read_answer(answer, exit_code, errors)


def _command(
    given: Path, answer: Path, strain: Strain, degree: int, relative_tolerance: float
) -> list[str]:
    return [
        # -P: a file called numpy.py in the current folder is not the child's numpy.
        *(sys.executable, "-P", "-m", "palpate.reference.child", str(given), str(answer)),
        *("--strain", strain.value, "--degree", str(degree)),
        *("--relative-tolerance", repr(relative_tolerance), "--until-stdin-closes"),
    ]


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


def _run(
    command: Sequence[str], time_limit: float, progress: Callable[[str], None]
) -> tuple[int, str]:
    """Run a command in its own process group; return its exit status and last error lines."""
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
            _pass_on(lines, progress)
            if process.returncode is not None:
                break
            if time.monotonic() >= deadline:
                raise ReferenceTimeoutError(time_limit, "".join(errors))
        for reader in readers:
            reader.join(timeout=5.0)
        _pass_on(lines, progress)
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


def _read_answer(answer: Path, exit_code: int, errors: str) -> ReferenceResult:
    message = errors.strip().splitlines()[-1:] or [""]
    if exit_code == _EXIT_INPUT:
        raise InputError(message[0])
    if exit_code == _EXIT_UNAVAILABLE:
        raise ReferenceUnavailableError(message[0])
    try:
        if exit_code == _EXIT_NOT_CONVERGED:
            with np.load(answer, allow_pickle=False) as stored:
                raise ReferenceNotConvergedError(
                    float(stored["load_factor"]),
                    str(stored["reason"]),
                    float(stored["smallest_det_f"]),
                    stored["displacement"],
                )
        if exit_code == 0:
            return load_result(answer)
    except (FileFormatError, OSError, KeyError, ValueError) as error:
        raise ReferenceCrashedError(exit_code, f"{errors}\nno readable answer: {error}") from error
    raise ReferenceCrashedError(exit_code, errors)


def _save_failure(path: Path, error: ReferenceNotConvergedError) -> None:
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(
            stream,
            load_factor=error.load_factor,
            reason=np.array(error.reason),
            smallest_det_f=error.smallest_det_f,
            displacement=error.displacement,
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve the problem of a file and write the answer to another; return the exit status."""
    parser = argparse.ArgumentParser(prog="palpate.reference.child", description=__doc__)
    parser.add_argument("problem", type=Path)
    parser.add_argument("result", type=Path)
    parser.add_argument("--strain", type=Strain, choices=list(Strain), default=Strain.GREEN)
    parser.add_argument("--degree", type=int, default=1)
    parser.add_argument("--relative-tolerance", type=float, default=1e-10)
    parser.add_argument(
        "--until-stdin-closes",
        action="store_true",
        help="end when standard input does, which is when the caller dies",
    )
    options = parser.parse_args(arguments)
    if options.until_stdin_closes:
        threading.Thread(target=_end_with_caller, daemon=True).start()

    def say(line: str) -> None:
        print(f"{_PROGRESS}{line}", flush=True)

    try:
        problem = load_problem(options.problem)
        require_available()
        result = _solve(problem, options, say)
        save_result(options.result, result)
    except InputError as error:
        print(_one_line(error), file=sys.stderr)
        return _EXIT_INPUT
    except ReferenceNotConvergedError as error:
        _save_failure(options.result, error)
        print(_one_line(error), file=sys.stderr)
        return _EXIT_NOT_CONVERGED
    except (ReferenceUnavailableError, ImportError) as error:
        print(f"FEniCSx cannot be imported: {_one_line(error)}", file=sys.stderr)
        return _EXIT_UNAVAILABLE
    return 0


def _solve(
    problem: Problem, options: argparse.Namespace, say: Callable[[str], None]
) -> ReferenceResult:
    say("loading FEniCSx")
    from palpate.reference.statics import solve_static

    return solve_static(
        problem,
        strain=options.strain,
        degree=options.degree,
        relative_tolerance=options.relative_tolerance,
        progress=say,
    )


def _end_with_caller() -> None:
    # Not sys.stdin: a thread inside its buffer aborts the interpreter's shutdown.
    while os.read(0, 4096):
        pass
    os._exit(1)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
