"""The reference in a process of its own.

The child is python -m palpate.reference.child PROBLEM.npz TASK.npz RESULT.npz.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Problem
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.meshes.temporaries import scratch_folder
from palpate.reference.availability import require_available
from palpate.reference.child_process import (
    EXIT_FAILED,
    Say,
    one_line,
    raise_for,
    run_child,
    say_nothing,
    serve,
)
from palpate.reference.errors import (
    ReferenceBlowUpError,
    ReferenceCrashedError,
    ReferenceNotConvergedError,
    ReferenceStepError,
)
from palpate.reference.ranks import num_ranks, solve_on_ranks
from palpate.reference.result import load_result, save_result
from palpate.reference.tasks import Answer, Task, load_task

# How a solve may end without an answer; they travel as files too.
_FAILURES = (ReferenceNotConvergedError, ReferenceStepError, ReferenceBlowUpError)


def run_task(
    task: Task[Answer],
    problem: Problem,
    *,
    time_limit: float = 3600.0,
    progress: Say | None = None,
) -> Answer:
    """Do a task in a child process; under mpirun on all its ranks, in this process.

    One that cannot be spread over ranks has a child of rank 0's, for which the others wait.

    Args:
        task: What to do.
        problem: With what.
        time_limit: The child and whatever it started are ended after this [s], > 0.
        progress: Called with one line of text now and then.

    Returns:
        What the task's own function returns.

    Raises:
        InputError: The problem cannot be used.
        ReferenceNotConvergedError, ReferenceStepError, ReferenceBlowUpError: As that function.
        ReferenceUnavailableError: FEniCSx cannot be imported here.
        ReferenceTimeoutError: No answer within the time limit.
        ReferenceCrashedError: The child died, or left no answer.
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
        exit_code, errors = run_child(_command(given, todo, answer), time_limit, progress)
        return _read_answer(answer, exit_code, errors, task)


def _command(*files: Path) -> list[str]:
    # -P: a file called numpy.py in the current folder is not the child's numpy.
    return [sys.executable, "-P", "-m", "palpate.reference.child", *map(str, files)]


def _read_answer(answer: Path, exit_code: int, errors: str, task: Task[Answer]) -> Answer:
    raise_for(exit_code, errors)
    try:
        if exit_code == EXIT_FAILED:
            raise _load_failure(answer)
        answered: Answer = load_result(answer, task.answer)
        return answered
    except (FileFormatError, OSError, KeyError, ValueError) as error:
        raise ReferenceCrashedError(exit_code, f"{errors}\nno readable answer: {error}") from error


def _save_failure(path: Path, error: Exception) -> None:
    """Write what an error was made of: its attributes are called as its arguments."""
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
    """Do the task of a file with the problem of another; return the exit status."""
    given, todo, answer = map(Path, arguments)

    def solve(say: Say) -> int:
        problem, task = load_problem(given), load_task(todo)
        say("loading FEniCSx")
        try:
            save_result(answer, task(problem, say))
        except _FAILURES as error:
            _save_failure(answer, error)
            print(one_line(error), file=sys.stderr)
            return EXIT_FAILED
        return 0

    return serve(solve)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
