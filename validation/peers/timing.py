"""Times tools in turns, in processes of their own, each driven by its adapter.

Each has one thread unless its options state otherwise.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.supervised import supervised
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.peers.registry import ADAPTERS, OURS, Tool, interpreters
from palpate.validation.states import Progress

HARNESS = ADAPTERS / "harness.py"
_THREADS = ("OMP", "OPENBLAS", "MKL", "NUMBA", "NUMEXPR", "CCX_NPROC_EQUATION_SOLVER")


class ChildFailedError(RuntimeError):
    """A tool gave no result; the message says how it ended."""


@dataclass(frozen=True)
class Schedule:
    """How tools are timed.

    Attributes:
        turns: Timings of each tool. The first is not counted, unless processes are fresh.
        seconds: Approximate time of one timing [s]; 0 is one step.
        unit: A timing has a whole number of these [steps].
        long: A tool whose timing takes this time [s] gets `turns_if_long`.
        is_fresh: Whether every timing is a process of its own.
        time_limit: Time limit of one set-up or one timing [s].
    """

    turns: int
    seconds: float = 0.0
    unit: int = 1
    long: float = math.inf
    turns_if_long: int = 1
    is_fresh: bool = False
    time_limit: float = 300.0


class Child:
    """A tool in a process of its own; its version is empty where it is not installed.

    `timings` have processor and wall time of one step [s], and the tool's report.
    """

    def __init__(
        self, tool: Tool, task: str, job: Mapping[str, Any], interpreter: str, schedule: Schedule
    ) -> None:
        self.tool, self._schedule = tool, schedule
        self.timings: list[dict[str, Any]] = []
        self._num_steps = 0
        self._ends = contextlib.ExitStack()
        self._process = self._ends.enter_context(contextlib.ExitStack())
        folder = self._ends.enter_context(scratch_folder("bench"))
        self._job, self._result = folder / "job.npz", folder / "result.npz"
        np.savez(self._job, **job, **tool.options)
        programs = (interpreter, HARNESS, ADAPTERS / f"{tool.adapter}.py")
        self._command = [*map(str, (*programs, task, self._job, self._result))]

    def start(self) -> None:
        """Set the tool up in a new process; ChildFailedError where it fails or refuses the job."""
        self._process.close()
        errors = self._job.with_name("errors.txt").open("w+", encoding="utf-8")
        self._errors = self._process.enter_context(errors)
        process = self._process.enter_context(
            supervised(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                text=True,
                # Some write log files, or files of compilers and MPI.
                env=_environment(self._command[0]) | {"TMPDIR": str(self._job.parent)},
                cwd=self._job.parent,
            )
        )
        assert process.stdin is not None
        assert process.stdout is not None
        self._input, self._output, self._end = process.stdin, process.stdout, process.terminate
        for stream in (process.stdin, process.stdout):
            self._process.callback(_close, stream)
        about = self._read()
        if "unfit" in about:
            raise ChildFailedError(about["unfit"])
        self.version, self.precision = about.get("version", ""), about.get("precision", "")

    @property
    def result(self) -> dict[str, NDArray[Any]]:
        """The arrays of the tool's last result."""
        with np.load(self._result) as stored:
            return {name: stored[name] for name in stored.files}

    def time(self) -> None:
        """Time the tool once; its very first steps, which may compile, do not count."""
        if self._schedule.is_fresh and self.timings:
            self.start()
        if not self._num_steps:
            self._num_steps = self._calibrate()
        self.timings.append(self._time(self._num_steps))

    def _calibrate(self) -> int:
        unit, seconds = self._schedule.unit, self._schedule.seconds
        count = unit
        if seconds:
            self._time(count)
            while (wall := count * self._time(count)["wall"]) < 0.1 * seconds:
                count *= 4
            count = unit * max(1, round(count / unit * seconds / wall))
        return count

    def _time(self, num_steps: int) -> dict[str, Any]:
        with contextlib.suppress(BrokenPipeError):  # the next read says why
            self._input.write(f"{num_steps}\n")
            self._input.flush()
        timing = self._read()
        for clock in ("processor", "wall"):
            timing[clock] /= num_steps
        return timing

    def best(self, clock: str) -> float:
        """Shortest time of a step [s], by processor or wall clock."""
        first = 0 if self._schedule.is_fresh else 1
        return float(min(timing[clock] for timing in self.timings[first:] or self.timings))

    def close(self) -> None:
        """End the process and forget the result."""
        self._ends.close()

    def _read(self) -> dict[str, Any]:
        # A process that hangs is ended, and has failed.
        timer = threading.Timer(self._schedule.time_limit, self._end)
        timer.daemon = True
        timer.start()
        try:
            line = self._output.readline()
            is_late = not timer.is_alive()
        finally:
            timer.cancel()
        if line:
            words: dict[str, Any] = json.loads(line)
            return words
        if is_late:
            raise ChildFailedError(f"not done within {self._schedule.time_limit:g} s")
        self._errors.seek(0)
        last = self._errors.read().strip().splitlines()[-12:]
        raise ChildFailedError("\n".join(last) or "the process ended without output")


@contextlib.contextmanager
def timed(
    tools: Sequence[Tool],
    task: str,
    job: Mapping[str, Any],
    schedule: Schedule,
    progress: Progress,
) -> Iterator[list[Child]]:
    """Set tools up for a task, and time them in turns.

    Each runs in the first interpreter that has what it needs, our own in this one. A rival that is
    not installed is left out; so is one that fails or does not fit the job, and `progress` says so.

    Raises:
        ChildFailedError: Our own failed.
    """

    def report(tool: Tool, error: ChildFailedError) -> None:
        if tool.name == OURS:
            raise error
        progress(f"{tool.name}: {str(error).splitlines()[-1]}")

    children: list[Child] = []
    with contextlib.ExitStack() as ends:
        for tool in tools:
            for interpreter in interpreters()[: 1 if tool.name == OURS else None]:
                versions = {child.version for child in children if child.tool is tool}
                if versions and not tool.runs_everywhere:
                    break
                child = Child(tool, task, job, interpreter, schedule)
                ends.callback(child.close)
                try:
                    child.start()
                except ChildFailedError as error:
                    report(tool, error)
                    continue
                if child.version not in {"", *versions}:
                    children.append(child)
        for turn in range(schedule.turns):
            for child in tuple(children):
                if turn >= schedule.turns_if_long and child.best("wall") >= schedule.long:
                    continue
                try:
                    child.time()
                except ChildFailedError as error:
                    children.remove(child)
                    report(child.tool, error)
        yield children


def _close(stream: IO[str]) -> None:
    with contextlib.suppress(OSError):
        stream.close()


def _environment(interpreter: str) -> dict[str, str]:
    ranks = ("OMPI_", "PMIX_", "PMI_")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(ranks)}
    environment.pop("PYTHONPATH", None)
    if interpreter == sys.executable:
        paths = (str(Path(p).absolute()) for p in sys.path if p)
        environment["PYTHONPATH"] = os.pathsep.join(paths)
    for name in _THREADS:
        environment[name if "_" in name else f"{name}_NUM_THREADS"] = "1"
    # Tools installed beside an interpreter (compilers, say) are found as in its environment.
    environment["PATH"] = f"{Path(interpreter).parent}{os.pathsep}{environment.get('PATH', '')}"
    return environment
