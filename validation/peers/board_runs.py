"""Runs one simulator on one case, with a result, a failure or a refusal; and caches the runs.

The key of a cached file is a hash of all that the result depends on: a case, a law, an adapter or
a time limit that has changed has another key, and is computed anew. Each file is written whole or
not at all.
"""

from __future__ import annotations

import dataclasses
import datetime
import hashlib
import json
import re
import time
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import atomic_path, write_text_atomically
from palpate.meshes.untrusted import UntrustedTextError, parse_json, read_text
from palpate.validation.candidates.candidate import candidate_name, fastsim_candidate
from palpate.validation.candidates.outside import CannotPoseError, OutsideSimulator
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.case import Case
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.exchange.result_files import ResultFile, ResultFileError, read_result
from palpate.validation.metrics.validity import state_out_of_reach, unmeasurable_state
from palpate.validation.peers.registry import Peer
from palpate.validation.states import CandidateFailedError, Progress, State, in_silence
from palpate.validation.versions import version_of

_ARRAYS = ("times", "points", "cells", "original_id")


def key_of(*parts: str) -> str:
    """The key of several parts, as a hash."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


class Cache:
    """A folder of runs.

    Args:
        folder: Created if it does not exist.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder

    def path(self, name: str, key: str, suffix: str) -> Path:
        """The path of the file with this key."""
        return self.folder / f"{re.sub(r'[^A-Za-z0-9.-]', '_', name)}-{key[:16]}{suffix}"

    def read(self, name: str, key: str) -> tuple[dict[str, Any], ResultFile | None] | None:
        """A run's record and its result; None where no readable record exists."""
        try:
            record = parse_json(read_text(self.path(name, key, ".json")))
            if not isinstance(record, dict) or record.get("key") != key:
                return None
            if not record.get("has_result"):
                return record, None
            return record, read_result(self.path(name, key, ".npz"))
        except (OSError, UntrustedTextError, ResultFileError, ValueError):
            return None

    def write(self, name: str, key: str, record: dict[str, Any], result: ResultFile | None) -> None:
        """Store a run, the result first, so that no record exists without it."""
        if result is not None:
            fields = {one: getattr(result, one) for one in _ARRAYS}
            what = "positions" if result.are_positions else "displacement"
            with atomic_path(self.path(name, key, ".npz")) as new, new.open("wb") as stream:
                np.savez_compressed(
                    stream,
                    **{what: result.values},
                    **{one: value for one, value in fields.items() if value is not None},
                    case_key=result.case_key,
                    about=json.dumps(result.about, default=str),
                )
        document = {**record, "key": key, "has_result": result is not None}
        text = json.dumps(document, indent=1, default=str)
        write_text_atomically(self.path(name, key, ".json"), text + "\n")


# Time limit of the run that compiles [s].
_WARM_UP = 900.0


class Status(StrEnum):
    """How a run ended."""

    ANSWERED = "answered"
    FAILED = "failed"
    NOT_POSED = "not posed"
    MISSING = "not installed"


@dataclass(frozen=True, eq=False)
class Run:
    """The run of a simulator on a case.

    Attributes:
        entry: Name of the simulator.
        case: Name of the case, without the law.
        status: How the run ended.
        why: The reason where there is no result.
        state: The result.
        seconds: Wall time of the whole program, with start-up and reading [s].
        says: What the program states: version, method, iterations, processor time, memory.
        date: When it ran.
    """

    entry: str
    case: str
    status: Status
    why: str = ""
    state: State | None = None
    seconds: float = 0.0
    says: dict[str, Any] = field(default_factory=dict)
    date: str = ""


def run_entry(entry: Peer, case: Case, cache: Cache, time_limit: float, progress: Progress) -> Run:
    """Run a simulator on a case under its law, or read its cached result.

    Args:
        entry: The simulator.
        case: The case under the entry's law.
        cache: Where results are stored.
        time_limit: Time limit of one run [s].
        progress: Called with one line for each run.
    """
    name = case.path.stem
    if entry.element is not None:
        return _run_fastsim(entry, case, progress)
    command = entry.command_line()
    if command is None:
        return Run(entry.name, name, Status.MISSING, entry.why_missing())
    label, key = _label_and_key(entry, case, time_limit)
    found = cache.read(label, key)
    if found is None:
        simulator = OutsideSimulator(command, time_limit)
        record: dict[str, Any] = {"date": _now()}
        result = None
        try:
            result, seconds = simulator.run(case.problem, case.strain, progress, case_name=name)
            record |= {"status": Status.ANSWERED, "seconds": seconds}
        except CannotPoseError as error:
            record |= {"status": Status.NOT_POSED, "why": str(error)}
        except (CandidateFailedError, InputError) as error:
            record |= {"status": Status.FAILED, "why": str(error)}
        cache.write(label, key, record, result)
        found = cache.read(label, key)
        if found is None:
            raise InputError(f"{cache.folder}: what was written there cannot be read again")
    record, result = found
    run = Run(
        entry.name,
        name,
        Status(record["status"]),
        str(record.get("why", "")),
        seconds=float(record.get("seconds", 0.0)),
        date=str(record.get("date", "")),
    )
    if result is None:
        return run
    try:
        state = state_of_result(result, case.problem, candidate_name(entry.title), case.strain)
    except (CandidateFailedError, InputError) as error:
        return _failed(run, str(error))
    return _with_state(run, case, state, dict(result.about))


def is_cached(entry: Peer, case: Case, cache: Cache, time_limit: float) -> bool:
    """Whether a run has been done already; see `run_entry`."""
    return cache.read(*_label_and_key(entry, case, time_limit)) is not None


def warm_up(entry: Peer, case: Case, progress: Progress) -> bool:
    """Run a simulator once without use of the result, so that later runs find it compiled.

    Returns:
        Whether it ran: False where the case cannot be posed to it.
    """
    command = entry.command_line()
    if command is None:
        return False
    progress(f"{entry.name} compiles: once for nothing, on {case.path.stem}")
    simulator = OutsideSimulator(command, _WARM_UP)
    try:
        simulator.run(case.problem, case.strain, in_silence, case_name=case.path.stem)
    except CannotPoseError:
        return False
    except (CandidateFailedError, InputError):
        pass  # a case that it fails on compiles as well
    return True


def _label_and_key(entry: Peer, case: Case, time_limit: float) -> tuple[str, str]:
    """The name and the key of a run in the cache; the key covers all that it depends on."""
    key = key_of(case_key(case.problem, case.strain), entry.sources_hash(), f"{time_limit:g}")
    return f"{entry.name}-{case.name}", key


def _run_fastsim(entry: Peer, case: Case, progress: Progress) -> Run:
    assert entry.element is not None
    run = Run(entry.name, case.path.stem, Status.ANSWERED, date=_now())
    try:
        progress(f"{entry.title}, {case.strain} strain, {case.problem.mesh.num_cells} cells")
        mine, begin = fastsim_candidate(element=entry.element), time.process_time()
        state = mine.solve(case.problem, case.strain, in_silence)
    except CandidateFailedError as error:
        return _failed(run, str(error))
    says = {
        "tool": entry.title,
        "version": version_of("palpate"),
        "seconds": time.process_time() - begin,
        "method": "Newton" if case.problem.time is None else "central differences",
    }
    return _with_state(run, case, state, {**says, **state.details})


def _with_state(run: Run, case: Case, state: State, says: dict[str, Any]) -> Run:
    """The run with its state; an unusable state makes it a failure."""
    impossible = unmeasurable_state(state) or state_out_of_reach(case.problem, state)
    if impossible:
        return _failed(run, impossible)
    return dataclasses.replace(run, state=state, seconds=run.seconds or state.seconds, says=says)


def _failed(run: Run, why: str) -> Run:
    return dataclasses.replace(run, status=Status.FAILED, why=why)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
