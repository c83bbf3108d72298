"""Runs one simulator on one case, with a result, a failure or a refusal; and caches the runs.

A cached run is used where that is asked for and everything that made it is as it was; see
`palpate.validation.cached_results` and `makers`.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import time
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.fingerprint import date_now
from palpate.validation.cached_results import CachedResult, Maker, ResultCache, text_hash
from palpate.validation.candidates.candidate import candidate_name, fastsim_candidate
from palpate.validation.candidates.outside import CannotPoseError, OutsideSimulator
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.case import Case
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.exchange.result_files import ResultFile, read_result, room_for_result
from palpate.validation.metrics.validity import state_out_of_reach, unmeasurable_state
from palpate.validation.peers.makers import maker_of
from palpate.validation.peers.registry import Peer
from palpate.validation.states import CandidateFailedError, Progress, State, in_silence
from palpate.validation.versions import version_of

_ARRAYS = ("times", "points", "cells", "original_id", "cauchy_stress")


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
        is_cached: Whether an earlier call ran it.
    """

    entry: str
    case: str
    status: Status
    why: str = ""
    state: State | None = None
    seconds: float = 0.0
    says: dict[str, Any] = field(default_factory=dict)
    date: str = ""
    is_cached: bool = False


def run_entry(
    entry: Peer, case: Case, cache: ResultCache, time_limit: float, progress: Progress
) -> Run:
    """Run a simulator on a case under its law, or read its cached result.

    Args:
        entry: The simulator.
        case: The case under the entry's law.
        cache: Where results are stored.
        time_limit: Time limit of one run [s].
        progress: Called with one line for each run, and with why a cached one is not used.
    """
    name = case.path.stem
    if not entry.is_outside:
        return _run_fastsim(entry, case, progress)
    command = entry.command_line()
    if command is None:
        return Run(entry.name, name, Status.MISSING, entry.why_missing())
    label, asked, maker = _question(entry, case, time_limit)
    found = read_run(entry, case, cache, time_limit, progress)
    if found is None:
        simulator = OutsideSimulator(command, time_limit)
        record: dict[str, Any] = {}
        result = None
        try:
            result, seconds = simulator.run(case.problem, case.strain, progress, case_name=name)
            record |= {"status": Status.ANSWERED, "seconds": seconds}
        except CannotPoseError as error:
            record |= {"status": Status.NOT_POSED, "why": str(error)}
        except (CandidateFailedError, InputError) as error:
            record |= {"status": Status.FAILED, "why": str(error)}
        file = None if result is None else functools.partial(_write_result, result)
        cache.write(label, asked, maker, record, file)
        date, is_cached = date_now(), False
    else:
        cached, result = found
        record, date, is_cached = dict(cached.record), cached.date, cached.is_from_before
    run = Run(
        entry.name,
        name,
        Status(record["status"]),
        str(record.get("why", "")),
        seconds=float(record.get("seconds", 0.0)),
        date=date,
        is_cached=is_cached,
    )
    if result is None:
        return run
    try:
        name = candidate_name(entry.title)
        state = state_of_result(result, case.problem, name, case.strain, element=entry.element)
    except (CandidateFailedError, InputError) as error:
        return _failed(run, str(error))
    return _with_state(run, case, state, dict(result.about))


def read_run(
    entry: Peer, case: Case, cache: ResultCache, time_limit: float, progress: Progress
) -> tuple[CachedResult, ResultFile | None] | None:
    """A cached run with its result, None where it has to be run; see `run_entry`."""
    label, asked, maker = _question(entry, case, time_limit)
    found = cache.read(label, asked, maker, progress)
    if found is None or found.file is None:
        return None if found is None else (found, None)
    return found, read_result(found.file, most_bytes=room_for_result(case.problem))


def _write_result(result: ResultFile, path: Path) -> None:
    fields = {one: getattr(result, one) for one in _ARRAYS}
    what = "positions" if result.are_positions else "displacement"
    with path.open("wb") as stream:
        np.savez_compressed(
            stream,
            **{what: result.values},
            **{one: value for one, value in fields.items() if value is not None},
            case_key=result.case_key,
            about=json.dumps(result.about, default=str),
        )


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


def _question(entry: Peer, case: Case, time_limit: float) -> tuple[str, str, Maker | None]:
    """The name of a run in the cache, a hash of what is asked, and what would answer it now."""
    asked = text_hash(case_key(case.problem, case.strain), entry.command, f"{time_limit:g}")
    return f"{entry.name}-{case.name}", asked, maker_of(entry)


def _run_fastsim(entry: Peer, case: Case, progress: Progress) -> Run:
    run = Run(entry.name, case.path.stem, Status.ANSWERED, date=date_now())
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
