"""The reference in a process of its own.

What the child does:

python -m palpate.reference.child PROBLEM.npz RESULT.npz --strain green --degree 2
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.meshes.temporaries import scratch_folder
from palpate.reference.availability import require_available
from palpate.reference.child_process import (
    EXIT_FAILED,
    Say,
    one_line,
    raise_for,
    run_child,
    serve,
)
from palpate.reference.errors import (
    ReferenceBlowUpError,
    ReferenceCrashedError,
    ReferenceNotConvergedError,
    ReferenceStepError,
)
from palpate.reference.ranks import num_ranks, solve_on_ranks
from palpate.reference.result import (
    Audit,
    ExplicitResult,
    Formulation,
    ImplicitResult,
    ReferenceResult,
    load_result,
    save_result,
)
from palpate.reference.tasks import StaticTask, Task, load_task

Answer: TypeAlias = ReferenceResult | Audit | ImplicitResult | ExplicitResult


def solve_static_in_child(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    degree: int = 1,
    relative_tolerance: float = 1e-10,
    formulation: Formulation = Formulation.DISPLACEMENT,
    element: Element = Element.LINEAR,
    time_limit: float = 3600.0,
    progress: Callable[[str], None] | None = None,
) -> ReferenceResult:
    """Do `palpate.reference.statics.solve_static` in a child process.

    Args:
        problem: Mesh, material, supports and loads.
        strain: Strain measure.
        degree: Polynomial degree of the displacement.
        relative_tolerance: See `solve_static`.
        formulation: Likewise.
        element: Likewise.
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
    task = StaticTask(Strain(strain), degree, relative_tolerance, formulation, Element(element))
    answer = run_task(task, problem, time_limit=time_limit, progress=progress)
    assert isinstance(answer, ReferenceResult)
    return answer


def run_task(
    task: Task,
    problem: Problem,
    *,
    time_limit: float = 3600.0,
    progress: Say | None = None,
) -> Answer:
    """Do a task in a child process; under mpirun on all its ranks, in this process.

    Args:
        task: What to do.
        problem: With what.
        time_limit: See `solve_static_in_child`; so are the errors.
        progress: Called with one line of text now and then.
    """
    require_available()
    if num_ranks() > 1:
        answered: Answer = solve_on_ranks(
            task, problem, time_limit=time_limit, progress=progress or _say_nothing
        )
        return answered
    with scratch_folder("reference") as folder:
        given, answer, todo = (folder / f"{name}.npz" for name in ("problem", "result", "task"))
        save_problem(given, problem)
        save_result(todo, task)
        exit_code, errors = run_child(_command(given, answer, todo), time_limit, progress)
        return _read_answer(answer, exit_code, errors, task)


def _command(given: Path, answer: Path, task: Path) -> list[str]:
    return [
        # -P: a file called numpy.py in the current folder is not the child's numpy.
        *(sys.executable, "-P", "-m", "palpate.reference.child", str(given), str(answer)),
        *("--task", str(task)),
    ]


def _read_answer(answer: Path, exit_code: int, errors: str, task: Task) -> Answer:
    raise_for(exit_code, errors)
    try:
        if exit_code == EXIT_FAILED:
            with np.load(answer, allow_pickle=False) as stored:
                if "step" in stored:
                    raise ReferenceBlowUpError(
                        int(stored["step"]), float(stored["time"]), stored["displacement"]
                    )
                if "time" in stored:
                    raise ReferenceStepError(
                        float(stored["time"]),
                        float(stored["time_step"]),
                        str(stored["reason"]),
                        stored["displacement"],
                    )
                raise ReferenceNotConvergedError(
                    float(stored["load_factor"]),
                    str(stored["reason"]),
                    float(stored["smallest_det_f"]),
                    stored["displacement"],
                    float(stored["smallest_stretch"]),
                    stored["place"],
                )
        answered: Answer = load_result(answer, task.answer)
        return answered
    except (FileFormatError, OSError, KeyError, ValueError) as error:
        raise ReferenceCrashedError(exit_code, f"{errors}\nno readable answer: {error}") from error


def _save_failure(
    path: Path, error: ReferenceNotConvergedError | ReferenceStepError | ReferenceBlowUpError
) -> None:
    names = (
        *("load_factor", "reason", "smallest_det_f", "displacement", "smallest_stretch", "place"),
        *("time", "time_step", "step"),
    )
    fields = {name: np.asarray(getattr(error, name)) for name in names if hasattr(error, name)}
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **fields)


def _say_nothing(_line: str) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve the problem of a file and write the answer to another; return the exit status."""
    parser = argparse.ArgumentParser(prog="palpate.reference.child", description=__doc__)
    parser.add_argument("problem", type=Path)
    parser.add_argument("result", type=Path)
    parser.add_argument("--strain", type=Strain, choices=list(Strain), default=Strain.GREEN)
    parser.add_argument("--degree", type=int, default=1)
    parser.add_argument("--element", type=Element, choices=list(Element), default=Element.LINEAR)
    parser.add_argument("--relative-tolerance", type=float, default=1e-10)
    parser.add_argument("--task", type=Path, help="file of a task; then it says all of these")
    options = parser.parse_args(arguments)

    def solve(say: Say) -> int:
        problem = load_problem(options.problem)
        if options.task is None:
            task: Task = StaticTask(
                options.strain,
                options.degree,
                options.relative_tolerance,
                element=options.element,
            )
        else:
            task = load_task(options.task)
        say("loading FEniCSx")
        try:
            result = task(problem, say)
        except (ReferenceNotConvergedError, ReferenceStepError, ReferenceBlowUpError) as error:
            _save_failure(options.result, error)
            print(one_line(error), file=sys.stderr)
            return EXIT_FAILED
        save_result(options.result, result)
        return 0

    return serve(solve)


if __name__ == "__main__":
    sys.exit(main())
