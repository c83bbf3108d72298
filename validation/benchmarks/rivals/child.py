"""Times one rival in this process: `python child.py RIVAL.py BODY.npz FORCE.npy`.

Answers one line of JSON when the rival is ready, then one for each number of steps it reads:
processor and wall seconds of that many steps. Ends with its standard input.
"""

from __future__ import annotations

import importlib.util
import json
import os
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far, without what it inherited at its start."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
        return next(float(x.split()[1]) for x in lines if x.startswith("VmHWM")) / 1024.0
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def processor_seconds() -> float:
    """Of this process, all threads, and of the processes it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def load(path: str) -> Any:
    """The module of a rival's file."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> None:
    """Serve until standard input ends."""
    # What libraries print must not mix with the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def say(**answer: Any) -> None:
        answers.write(json.dumps(answer) + "\n")
        answers.flush()

    with np.load(sys.argv[2]) as stored:
        body = {name: stored[name] for name in stored.files}
    try:
        rival = load(sys.argv[1]).prepare(body)
    except ImportError as error:
        say(missing=str(error))
        return
    except ValueError as error:
        say(unfit=str(error))
        return
    if rival.force is not None:
        np.save(sys.argv[3], np.asarray(rival.force, dtype=np.float64))
    say(
        tool=rival.tool,
        version=rival.version,
        precision=rival.precision,
        has_force=rival.force is not None,
    )
    for line in sys.stdin:
        before = processor_seconds(), time.perf_counter()
        extra = rival.advance(int(line)) or {}
        after = processor_seconds(), time.perf_counter()
        answer = {
            "processor": after[0] - before[0],
            "wall": after[1] - before[1],
            "peak_memory_mb": peak_memory_mb(),
        }
        say(**(answer | extra))


if __name__ == "__main__":
    main()
