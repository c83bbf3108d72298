"""Rivals and our own code, each timed in a child process, taking turns.

A rival may live in another Python environment: PALPATE_BENCH_PYTHON names interpreters to try
besides this one, separated like PATH. One thread each unless the body says otherwise.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.supervised import supervised
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.benchmarks.child import ChildFailedError
from palpate.validation.simulators.interpreters import interpreters

FOLDER = Path(__file__).parent / "rivals"
TIME_LIMIT = 300.0  # of one set-up or one timing [s]
_THREADS = ("OMP", "OPENBLAS", "MKL", "NUMBA", "NUMEXPR", "CCX_NPROC_EQUATION_SOLVER")


class TimedChild:
    """One rival that is set up and waits to be timed.

    Attributes:
        about: tool, version, precision.
        force: Its internal force at the test displacement, or None.
        refused: Why there is nothing to time, or "".
        num_threads: Of the body; 1 where it says nothing.
        answers: One for each timing so far: processor and wall seconds, and more.
    """

    def __init__(self, file: str, body: Mapping[str, Any], interpreter: str) -> None:
        self.is_ours = is_ours(file)
        self.num_threads = int(body.get("num_threads", 1))
        self._ends = contextlib.ExitStack()
        folder = self._ends.enter_context(scratch_folder("bench"))
        given, force = folder / "body.npz", folder / "force.npy"
        np.savez(given, **body)
        self._errors = self._ends.enter_context(
            (folder / "errors.txt").open("w+", encoding="utf-8")
        )
        self._process = self._ends.enter_context(
            supervised(
                [interpreter, "-P", FOLDER / "child.py", FOLDER / file, given, force],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                text=True,
                env=_environment(interpreter),
                cwd=folder,  # some write log files
            )
        )
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            self._ends.callback(_close, stream)
        self.answers: list[dict[str, Any]] = []
        self.about = self._read()
        self.refused = str(self.about.get("missing", self.about.get("unfit", "")))
        self.is_missing = "missing" in self.about
        self.force: Points | None = np.load(force) if self.about.get("has_force") else None

    def time(self, num_steps: int) -> dict[str, Any]:
        """Time that many steps; return the answer and keep it."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the answer says why
            self._process.stdin.write(f"{num_steps}\n")
            self._process.stdin.flush()
        self.answers.append(self._read())
        return self.answers[-1]

    def best(self, clock: str) -> float:
        """Least seconds of all timings but the first, by processor or wall clock."""
        return float(min(answer[clock] for answer in self.answers[1:] or self.answers))

    def close(self) -> None:
        """End the child."""
        self._ends.close()

    def _read(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        # Whoever hangs is ended, and has failed.
        timer = threading.Timer(TIME_LIMIT, self._process.terminate)
        timer.start()
        line = self._process.stdout.readline()
        timer.cancel()
        if line:
            answer: dict[str, Any] = json.loads(line)
            return answer
        self._errors.seek(0)
        last = self._errors.read().strip().splitlines()[-12:]
        self.close()
        raise ChildFailedError("\n".join(last) or "the process ended without a word")


@contextlib.contextmanager
def started(
    files: Iterable[tuple[str, Mapping[str, Any]]],
    progress: Callable[[str], None] | None,
    every_version: Sequence[str] = (),
) -> Iterator[list[TimedChild]]:
    """Children for (file, body) pairs, each in the first interpreter that has what it needs.

    Files of `every_version` run in all interpreters that have another version of their tool; our
    own run in this one alone. What is installed but fails, or does not fit the body, goes to
    `progress`.
    """
    tell = progress or _say_nothing
    children: list[TimedChild] = []
    begun: list[TimedChild] = []
    try:
        for file, body in files:
            seen = set()
            for interpreter in interpreters()[: 1 if is_ours(file) else None]:
                try:
                    child = TimedChild(file, body, interpreter)
                except ChildFailedError as error:
                    if is_ours(file):
                        raise
                    tell(f"{file} failed: {str(error).splitlines()[-1]}")
                    continue
                version = child.about.get("version")
                if child.refused or version in seen:
                    if child.refused and not child.is_missing:
                        tell(f"{file} left out: {child.refused}")
                    child.close()
                    continue
                seen.add(version)
                children.append(child)
                begun.append(child)
                if file not in every_version:
                    break
        yield children
    finally:
        for child in begun:
            child.close()


def take_turns(
    children: list[TimedChild],
    num_turns: int,
    count: Callable[[TimedChild, int], int],
    progress: Callable[[str], None] | None,
) -> None:
    """Time every child in each turn; a rival that fails leaves the list, and that is said.

    Args:
        children: What to time; rivals that fail are taken out.
        num_turns: How often.
        count: Steps for a child in a turn, 0 to let it rest.
        progress: Told of failures.
    """
    for turn in range(num_turns):
        for child in tuple(children):
            try:
                if steps := count(child, turn):
                    child.time(steps)
            except ChildFailedError as error:
                if child.is_ours:
                    raise
                children.remove(child)
                (progress or _say_nothing)(
                    f"{child.about['tool']} failed: {str(error).splitlines()[-1]}"
                )


def is_ours(file: str) -> bool:
    """Whether a file times palpate itself."""
    return file.startswith("palpate_")


def _say_nothing(_line: str) -> None:
    pass


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
    # Tools installed beside an interpreter (compilers, say) are found as in its own environment.
    environment["PATH"] = f"{Path(interpreter).parent}{os.pathsep}{environment.get('PATH', '')}"
    return environment
