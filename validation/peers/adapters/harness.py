"""What runs an adapter in its own process: it answers a case folder, or is timed.

python ADAPTER.py CASE RESULT.npz                       see `answer_case`
python harness.py ADAPTER.py TASK JOB.npz ANSWER.npz    see `main`
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

# Exit code of a program to which a case cannot be posed: it has not failed.
NOT_POSED = 77
_LAWS = {"linear": "linear elasticity", "green": "Saint-Venant-Kirchhoff"}
_COMMON = "saint-venant-kirchhoff"


def answer_case(adapter: Any) -> None:
    """Answer the case folder given first on the command line in the file given second.

    Args:
        adapter: The class `Static` of an adapter; it also has `tool`, a name for people, and may
            have `law`, where that is not the case's, and `laws`, those for finite strain that it
            takes from a case, if there are others than Saint-Venant-Kirchhoff's.
    """
    _answer(adapter, is_motion=False)


def answer_motion(adapter: Any) -> None:
    """Likewise a case in motion, by a class `Motion`; its job has `output_times` [s] as well.

    Loads and supports stay as they are: those that change in time are not known here.
    """
    _answer(adapter, is_motion=True)


def _answer(adapter: Any, *, is_motion: bool) -> None:
    case, result = (Path(word).absolute() for word in sys.argv[1:])
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    kinds = [load["kind"] for load in given["loads"]]
    job = {**read_arrays(case / "rest.npz"), "strain": given["strain"], "load_kinds": kinds}
    span = given["time"]
    moves = any(one["amplitude"] for one in (*given["loads"], *given["supports"]))
    if is_motion and span:
        moves = moves or bool(job["prescribed_displacement"].any())
        job |= {"output_times": np.array(span["output_times"])}
        job |= {key: span[key] for key in ("mass_damping", "stiffness_damping")}
    damps = is_motion and span and span["stiffness_damping"] > 0.0
    has = {
        "time": span and not is_motion,
        "statics": is_motion and not span,
        "loads or supports that change in time": is_motion and moves,
        "stiffness damping": damps and not getattr(adapter, "has_stiffness_damping", False),
        "tools": given["tools"],
        "springs": given["springs"],
        "follower pressure": len(job["pressure"]),
        "inclusions": given["has_inclusions"],
        "slanted supports": "sliding_normals" in job,
    }
    if any(has.values()):
        refuse(f"{', '.join(name for name in has if has[name])}: not handed to this simulator here")
    job["law"] = given["material"].get("law", _COMMON) if given["strain"] == "green" else _COMMON
    known = getattr(adapter, "laws", (_COMMON,))
    if job["law"] not in known:
        refuse(f"law {job['law']}: not posed to {adapter.tool} here, only {', '.join(known)}")
    os.chdir(result.parent)  # some write a log into the working folder
    try:
        simulator = adapter(job)
    except (ImportError, ValueError) as error:
        refuse(str(error))
    start = processor_seconds()
    says = simulator.advance(1)
    about = {
        "peak_memory_mb": max(peak_memory_mb(), children_memory_mb()),
        "tool": simulator.tool,
        "version": simulator.version,
        "law": getattr(simulator, "law", _LAWS[given["strain"]])
        if job["law"] == _COMMON
        else job["law"],
        "seconds": processor_seconds() - start,
        **says,
    }
    np.savez(result, **simulator.answer, case_key=given["case_key"], about=json.dumps(about))


def main() -> None:
    """Time a tool until standard input ends.

    Answers one line of JSON when the tool is set up, then one for each number of steps it reads:
    seconds of the processor and of the clock, memory, and what the tool says.
    """
    # What libraries print must not mix with the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def say(**answer: Any) -> None:
        answers.write(json.dumps(answer) + "\n")
        answers.flush()

    adapter, task, job, target = sys.argv[1:]
    sys.path.insert(0, str(Path(adapter).parent))
    try:
        tool = getattr(importlib.import_module(Path(adapter).stem), task)(read_arrays(job))
    except ImportError as error:
        say(missing=str(error))
        return
    except ValueError as error:
        say(unfit=str(error))
        return
    say(version=str(tool.version), precision=tool.precision)
    saved: dict[str, Any] | None = None
    for line in sys.stdin:
        before = processor_seconds(), time.perf_counter()
        says = tool.advance(int(line)) or {}
        after = processor_seconds(), time.perf_counter()
        answer = getattr(tool, "answer", {})
        if answer is not saved:
            np.savez(target, **answer)
            saved = answer
        say(
            processor=after[0] - before[0],
            wall=after[1] - before[1],
            **{"peak_memory_mb": peak_memory_mb(), **says},
        )


def read_arrays(path: str | Path) -> dict[str, Any]:
    """All arrays of an .npz file."""
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far, without what it inherited at its start."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
        return next(float(x.split()[1]) for x in lines if x.startswith("VmHWM")) / 1024.0
    except (OSError, StopIteration):
        return _most_held_mb("RUSAGE_SELF")


def refuse(why: str) -> NoReturn:
    """End: the case cannot be posed to this simulator; some libraries say goodbye after that."""
    print(why, flush=True)
    os._exit(NOT_POSED)


def children_memory_mb() -> float:
    """The most that a process started here has held; 0 where the system does not tell."""
    return _most_held_mb("RUSAGE_CHILDREN")


def _most_held_mb(whose: str) -> float:
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    return resource.getrusage(getattr(resource, whose)).ru_maxrss / 1024.0


def processor_seconds() -> float:
    """Of this process, all threads, and of the processes it has waited for."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


if __name__ == "__main__":
    main()
