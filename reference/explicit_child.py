"""The explicit twin in a process of its own.

What the child does:

python -m palpate.reference.explicit_child PROBLEM.npz RESULT.npz --strain green
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.atomic_write import atomic_path
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
from palpate.reference.errors import ReferenceBlowUpError, ReferenceCrashedError

if TYPE_CHECKING:  # needs FEniCSx when it is imported for real
    from palpate.reference.explicit import ExplicitResult


@dataclasses.dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion, as it travels between processes.

    Attributes:
        times: [s], shape (num_times,), from 0.
        displacements: [m], shape (num_times, num_points, 3).
        strain_energies: [J], shape (num_times,).
        time_step: [s].
        num_steps: Steps done.
    """

    times: Points
    displacements: Points
    strain_energies: Points
    time_step: float
    num_steps: int


def simulate_explicit_in_child(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    time_limit: float = 3600.0,
    progress: Callable[[str], None] | None = None,
) -> Trajectory:
    """Do `palpate.reference.explicit.simulate_explicit` in a child process.

    Raises:
        InputError: The problem cannot be used.
        ReferenceBlowUpError: A value stopped being finite.
        ReferenceUnavailableError, ReferenceTimeoutError, ReferenceCrashedError: See
            `solve_static_in_child`.
    """
    require_available()
    with tempfile.TemporaryDirectory(prefix="palpate-reference-") as folder:
        given, answer = Path(folder, "problem.npz"), Path(folder, "result.npz")
        save_problem(given, problem)
        # -P: a file called numpy.py in the current folder is not the child's numpy.
        command = [
            *(sys.executable, "-P", "-m", "palpate.reference.explicit_child"),
            *(str(given), str(answer), "--strain", Strain(strain).value, UNTIL_STDIN_CLOSES),
        ]
        exit_code, errors = run_child(command, time_limit, progress)
        raise_for(exit_code, errors)
        try:
            with np.load(answer, allow_pickle=False) as stored:
                if exit_code == EXIT_FAILED:
                    raise ReferenceBlowUpError(
                        int(stored["step"]), float(stored["time"]), stored["displacement"]
                    )
                return Trajectory(
                    times=stored["times"],
                    displacements=stored["displacements"],
                    strain_energies=stored["strain_energies"],
                    time_step=float(stored["time_step"]),
                    num_steps=int(stored["num_steps"]),
                )
        except (OSError, KeyError, ValueError, EOFError) as error:
            raise ReferenceCrashedError(
                exit_code, f"{errors}\nno readable answer: {error}"
            ) from error


def main(arguments: Sequence[str] | None = None) -> int:
    """Step the problem of a file and write the trajectory to another; return the exit status."""
    parser = argparse.ArgumentParser(prog="palpate.reference.explicit_child", description=__doc__)
    parser.add_argument("problem", type=Path)
    parser.add_argument("result", type=Path)
    parser.add_argument("--strain", type=Strain, choices=list(Strain), default=Strain.GREEN)
    parser.add_argument(UNTIL_STDIN_CLOSES, action="store_true")
    options = parser.parse_args(arguments)

    def solve(say: Say) -> int:
        problem = load_problem(options.problem)
        say("loading FEniCSx")
        from palpate.reference.explicit import simulate_explicit

        try:
            found = simulate_explicit(problem, strain=options.strain)
        except ReferenceBlowUpError as error:
            last = {"step": error.step, "time": error.time, "displacement": error.displacement}
            _write(options.result, last)
            print(one_line(error), file=sys.stderr)
            return EXIT_FAILED
        _write(options.result, _arrays(found))
        return 0

    return serve(solve, ends_with_caller=options.until_stdin_closes)


def _arrays(found: ExplicitResult) -> dict[str, object]:
    names = [part.name for part in dataclasses.fields(Trajectory)]
    return {name: getattr(found, name) for name in names}


def _write(path: Path, arrays: dict[str, object]) -> None:
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **{name: np.asarray(value) for name, value in arrays.items()})


if __name__ == "__main__":
    sys.exit(main())
