"""A tool in a process of its own: it may crash or hang, and its memory is its own.

The child prints one JSON object as its last line; seconds are CPU time of the work alone,
peak_memory_mb that of the whole process.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import palpate
from palpate.meshes.supervised import run_supervised
from palpate.meshes.temporaries import scratch_folder

# One thread in every tool; the variables that OpenMP and the BLAS libraries read.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class ChildFailedError(RuntimeError):
    """A tool gave no answer; the message says how it ended."""


def run_tool(
    module: str,
    arguments: Sequence[str],
    *,
    time_limit: float,
    interpreter: str | None = None,
) -> dict[str, Any]:
    """Run `python -m module arguments` and read the JSON object it prints last.

    Args:
        module: Of palpate; of what palpate needs, it uses numpy alone.
        arguments: For it.
        time_limit: Seconds before it is ended.
        interpreter: One that need not have palpate; this one where None.

    Raises:
        ChildFailedError: It crashed, ran out of time or printed no object.
    """
    words = ["-m", module, *arguments]
    if interpreter is None or interpreter == sys.executable:
        return run_program([sys.executable, *words], time_limit=time_limit)
    with scratch_folder("import") as folder:
        # palpate, and nothing else of this environment.
        (folder / "palpate").symlink_to(Path(palpate.__file__).absolute().parent)
        others = {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
        return run_program([interpreter, "-P", *words], time_limit=time_limit, environment=others)


def run_program(
    command: Sequence[str], *, time_limit: float, environment: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Run a program on one thread and read the JSON object it prints last.

    Args:
        command: Program and arguments.
        time_limit: Seconds before it is ended.
        environment: Variables besides those of this process.

    Raises:
        ChildFailedError: It crashed, ran out of time or printed no object.
    """
    variables = {**os.environ, **dict.fromkeys(_ONE_THREAD, "1"), **(environment or {})}
    try:
        done = run_supervised(command, time_limit=time_limit, env=variables)
    except subprocess.TimeoutExpired:
        raise ChildFailedError(f"not done within {time_limit:g} s") from None
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
        raise ChildFailedError(f"exit {done.returncode}: {said[:200]}")
    try:
        answer: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    except (ValueError, IndexError):
        raise ChildFailedError("it printed no JSON object") from None
    return answer


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far [MiB].

    From /proc where there is one: the figure of getrusage starts at that of the parent.
    """
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        found = re.search(r"VmHWM:\s+(\d+) kB", status)
    except OSError:
        found = None
    kilobytes = int(found[1]) if found else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return kilobytes / 1024.0
