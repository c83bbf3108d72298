"""Any program as a candidate: it reads a case folder and writes a result file.

It runs under a supervisor with a time limit; all processes it started end with it. A crash, no
result in time, no result file or NaN in it is the candidate's failure; a file that cannot be
read is an input error.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.supervised import supervised
from palpate.meshes.temporaries import scratch_folder
from palpate.reference.schemes import Integrator
from palpate.validation.candidates.equations import TIME_LIMIT, AskedSteps
from palpate.validation.exchange.case_folder import write_case_folder
from palpate.validation.exchange.result_files import (
    ResultFile,
    read_result,
    room_for_result,
)
from palpate.validation.quoting import in_quotes
from palpate.validation.states import CandidateFailedError, Progress

DEFAULT_TIME_LIMIT = TIME_LIMIT
_FIELD = re.compile(r"\{(case|result|iterations|time_step)(?::(npz|vtu|csv))?\}")
_STDERR_CHARACTERS = 2000


# Exit code of a program to which the case cannot be posed (automake's for a skipped test).
NOT_POSED = 77


class CannotPoseError(CandidateFailedError):
    """The program says that the case is not for it: no result, but no wrong one either."""


class CommandError(InputError):
    """A simulator's command line that cannot be used."""


@dataclass(frozen=True)
class OutsideSimulator:
    """A command line with {case} (a folder) and {result} (a file to write).

    {result} ends in .npz; {result:vtu} and {result:csv} ask for the other kinds. {time_step} is
    that of the motion asked for [s], {iterations} is given as it is. No shell reads the line.

    Args:
        command: For example "mysim {case} {result:vtu}".
        time_limit: Time limit [s], > 0.
        iterations: Number for the field of that name, > 0; None where there is none.
        integrator: The scheme that it is judged by; None is the case's central differences.
        time_step: Time step that it is asked for instead of the case's [s]; None is the case's.

    Raises:
        CommandError: A field is missing or named twice, iterations without a field or a field
            without them, or the time limit is not above 0.
    """

    command: str
    time_limit: float = DEFAULT_TIME_LIMIT
    iterations: int | None = None
    integrator: Integrator | None = None
    time_step: float | None = None

    def __post_init__(self) -> None:
        try:
            words = shlex.split(self.command)
        except ValueError as error:
            raise CommandError(f"simulator {self.command!r}: {error}") from error
        fields = [match[1] for match in _FIELD.finditer(self.command)]
        if not words or fields.count("result") != 1 or fields.count("case") < 1:
            raise CommandError(
                f'simulator {self.command!r}: needs {{case}} and {{result}}, as in "mysim {{case}} '
                '{result}"'
            )
        if ("iterations" in fields) != (self.iterations is not None):
            raise CommandError(
                f"simulator {self.command!r}: {{iterations}} in the command and how many there are "
                "(--iterations) go together: give both or neither"
            )
        if self.iterations is not None and self.iterations < 1:
            raise CommandError(f"iterations = {self.iterations}: needs at least 1")
        if not self.time_limit > 0.0:
            raise CommandError(f"time limit {self.time_limit:g} s: needs a value above 0")

    @property
    def name(self) -> str:
        """The program's file name, for people."""
        words = [w for w in shlex.split(self.command) if not _FIELD.search(w)]
        scripts = [w for w in words if w.endswith(".py")]
        return Path((scripts or words or ["simulator"])[-1 if scripts else 0]).stem

    @property
    def asked(self) -> AskedSteps:
        """The scheme and step that it is judged by; the reference has its time limit."""
        return AskedSteps(self.integrator, self.time_step, self.time_limit)

    def stepped(self, problem: Problem) -> Problem:
        """The problem with the time step that is asked for; see `AskedSteps`."""
        return self.asked.stepped(problem)

    def run(
        self, problem: Problem, strain: Strain, progress: Progress, *, case_name: str = "case"
    ) -> tuple[ResultFile, float]:
        """Run it on a problem.

        Returns:
            The result as it was read, and how long the program took [s].

        Raises:
            CommandError: There is no such program.
            ResultFileError: The result cannot be read.
            CandidateFailedError: It crashed, took too long, or left no result.
            CannotPoseError: It ended with `NOT_POSED`.
        """
        with scratch_folder("simulator") as scratch:
            case = scratch / "case"
            write_case_folder(case, problem, strain, name=case_name)
            words, file = self._filled(case, scratch, problem)
            progress(f"{self.name}, {strain} strain, {problem.mesh.num_cells} cells")
            start = time.perf_counter()
            _run(words, scratch, self.time_limit)
            seconds = time.perf_counter() - start
            if not file.is_file():
                raise CandidateFailedError(f"{self.name} ended without writing a result")
            return read_result(file, most_bytes=room_for_result(problem)), seconds

    def _filled(self, case: Path, scratch: Path, problem: Problem) -> tuple[list[str], Path]:
        suffix = next(m[2] or "npz" for m in _FIELD.finditer(self.command) if m[1] == "result")
        result = scratch / f"result.{suffix}"
        values = {"case": str(case), "result": str(result), "iterations": str(self.iterations)}
        if "{time_step}" in self.command:
            step = None if problem.time is None else problem.time.time_step
            if step is None:
                raise CommandError(
                    f"simulator {self.command!r}: this case states no time step for {{time_step}}; "
                    "give time_step in [time], or --time-step"
                )
            values["time_step"] = f"{step:.17g}"
        words = [_FIELD.sub(lambda m: values[m[1]], w) for w in shlex.split(self.command)]
        return words, result


def _run(words: list[str], folder: Path, time_limit: float) -> None:
    """Run to the end or the time limit; nothing it started outlives this."""
    program = shutil.which(words[0])
    if program is None:
        raise CommandError(f"simulator: no program {words[0]!r} here; is it on the path?")
    with (folder / "output.txt").open("w+b") as output:
        start = [os.path.abspath(program), *words[1:]]  # noqa: PTH100  (links are kept: venvs)
        streams = {"stdin": subprocess.DEVNULL, "stdout": output, "stderr": subprocess.STDOUT}
        try:
            environment = {**os.environ, "TMPDIR": str(folder)}
            with supervised(start, env=environment, **streams) as process:
                process.wait(time_limit)
        except subprocess.TimeoutExpired:
            raise CandidateFailedError(
                f"no result within {time_limit:g} s{_last_line(output)}"
            ) from None
        except OSError as error:
            raise CommandError(
                f"simulator: {program} cannot be started ({error.strerror or error})"
            ) from error
        code = process.returncode
        if code == NOT_POSED:
            why = _last_words(output) or "it does not say why"
            raise CannotPoseError(f"the case cannot be posed to it: {why}")
        if code:
            how = f"it ended with {code}" if code > 0 else f"it crashed (signal {-code})"
            raise CandidateFailedError(how + _last_line(output))


def _last_line(stream: IO[bytes]) -> str:
    """The last thing it said, at the end of a sentence."""
    said = _last_words(stream)
    return f", its last line: {said}" if said else ""


def _last_words(stream: IO[bytes]) -> str:
    """The last thing it said, in quotes; nothing where it said nothing."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - _STDERR_CHARACTERS))
    lines = stream.read().decode("utf-8", errors="replace").strip().splitlines()
    return in_quotes(lines[-1]) if lines else ""
