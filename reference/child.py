"""A static reference solve in a process of its own.

What the child does:

python -m palpate.reference.child PROBLEM.npz RESULT.npz --strain green --degree 2
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.reference.availability import require_available
from palpate.reference.child_process import (
    EXIT_FAILED,
    UNTIL_STDIN_CLOSES,
    Say,
    one_line,
    raise_for,
    run_child,
    serve,
)
from palpate.reference.errors import ReferenceCrashedError, ReferenceNotConvergedError
from palpate.reference.result import ReferenceResult, load_result, save_result


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
    require_available()
    with tempfile.TemporaryDirectory(prefix="palpate-reference-") as folder:
        given, answer = Path(folder, "problem.npz"), Path(folder, "result.npz")
        save_problem(given, problem)
        command = _command(given, answer, Strain(strain), degree, relative_tolerance)
        exit_code, errors = run_child(command, time_limit, progress)
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


def _read_answer(answer: Path, exit_code: int, errors: str) -> ReferenceResult:
    raise_for(exit_code, errors)
    try:
        if exit_code == EXIT_FAILED:
            with np.load(answer, allow_pickle=False) as stored:
                raise ReferenceNotConvergedError(
                    float(stored["load_factor"]),
                    str(stored["reason"]),
                    float(stored["smallest_det_f"]),
                    stored["displacement"],
                )
        return load_result(answer)
    except (FileFormatError, OSError, KeyError, ValueError) as error:
        raise ReferenceCrashedError(exit_code, f"{errors}\nno readable answer: {error}") from error


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
        UNTIL_STDIN_CLOSES,
        action="store_true",
        help="end when standard input does, which is when the caller dies",
    )
    options = parser.parse_args(arguments)

    def solve(say: Say) -> int:
        problem = load_problem(options.problem)
        say("loading FEniCSx")
        from palpate.reference.statics import solve_static

        try:
            result = solve_static(
                problem,
                strain=options.strain,
                degree=options.degree,
                relative_tolerance=options.relative_tolerance,
                progress=say,
            )
        except ReferenceNotConvergedError as error:
            _save_failure(options.result, error)
            print(one_line(error), file=sys.stderr)
            return EXIT_FAILED
        save_result(options.result, result)
        return 0

    return serve(solve, ends_with_caller=options.until_stdin_closes)


if __name__ == "__main__":
    sys.exit(main())
