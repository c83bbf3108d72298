"""One simulator on one case: an answer, a failure, or why the case cannot be posed to it."""

from __future__ import annotations

import datetime
import time
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from palpate.meshes.errors import InputError
from palpate.validation.candidates.candidate import candidate_name, fastsim_candidate
from palpate.validation.candidates.outside import CannotPoseError, OutsideSimulator
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.case import Case
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.metrics.possible_motion import state_out_of_reach, unmeasurable_state
from palpate.validation.peers.board_kept import Kept, key_of
from palpate.validation.peers.registry import Peer
from palpate.validation.states import CandidateFailedError, Progress, State, in_silence
from palpate.validation.versions import version_of

# Time to compile [s].
_WARM_UP = 900.0


class Status(StrEnum):
    """How a run ended."""

    ANSWERED = "answered"
    FAILED = "failed"
    NOT_POSED = "not posed"
    MISSING = "not installed"


@dataclass(frozen=True, eq=False)
class Run:
    """How a simulator fared with a case.

    Attributes:
        entry: Its name.
        case: The case's, without the law.
        status: How it ended.
        why: Of what is not answered.
        state: The answer.
        seconds: Of the whole program, by the clock, with start-up and reading.
        says: Words of its own: version, method, iterations, processor time, memory.
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


def run_entry(entry: Peer, case: Case, kept: Kept, time_limit: float, progress: Progress) -> Run:
    """Run a simulator on a case under its law, or read what it answered before.

    Args:
        entry: Who.
        case: Under the entry's law.
        kept: Where answers are kept.
        time_limit: Of one run [s].
        progress: Called with one line for each run.
    """
    name = case.path.stem
    if entry.element is not None:
        return _run_fastsim(entry, case, progress)
    command = entry.command_line()
    if command is None:
        return Run(entry.name, name, Status.MISSING, entry.why_missing())
    problem = case.problem
    label, key = _place(entry, case, time_limit)
    found = kept.read(label, key)
    if found is None:
        simulator = OutsideSimulator(command, time_limit)
        record: dict[str, Any] = {"date": _now()}
        answer = None
        try:
            answer, seconds = simulator.run(problem, case.strain, progress, case_name=name)
            record |= {"status": Status.ANSWERED, "seconds": seconds}
        except CannotPoseError as error:
            record |= {"status": Status.NOT_POSED, "why": str(error)}
        except (CandidateFailedError, InputError) as error:
            record |= {"status": Status.FAILED, "why": str(error)}
        kept.write(label, key, record, answer)
        found = kept.read(label, key)
        if found is None:
            raise InputError(f"{kept.folder}: what was written there cannot be read again")
    record, answer = found
    run = Run(
        entry.name,
        name,
        Status(record["status"]),
        str(record.get("why", "")),
        seconds=float(record.get("seconds", 0.0)),
        date=str(record.get("date", "")),
    )
    if answer is None:
        return run
    try:
        state = state_of_result(answer, problem, candidate_name(entry.title), case.strain)
    except (CandidateFailedError, InputError) as error:
        return _failed(run, str(error))
    return _judged(run, case, state, dict(answer.about))


def is_kept(entry: Peer, case: Case, kept: Kept, time_limit: float) -> bool:
    """Whether a run has been done already; see `run_entry`."""
    return kept.read(*_place(entry, case, time_limit)) is not None


def warm_up(entry: Peer, case: Case, progress: Progress) -> bool:
    """Run a simulator once for nothing, so that no answer waits for what is compiled at first.

    Returns:
        Whether it ran: False where the case cannot be posed to it.
    """
    command = entry.command_line()
    if command is None:
        return False
    progress(f"{entry.name} compiles: once for nothing, on {case.path.stem}")
    try:
        simulator = OutsideSimulator(command, _WARM_UP)
        simulator.run(case.problem, case.strain, in_silence, case_name=case.path.stem)
    except CannotPoseError:
        return False
    except (CandidateFailedError, InputError):
        return True
    return True


def _place(entry: Peer, case: Case, time_limit: float) -> tuple[str, str]:
    """Where a run is kept: its name, and the key of all that it hangs on."""
    sources = entry.sources_hash()
    key = key_of(case_key(case.problem, case.strain), sources, f"{time_limit:g}")
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
    return _judged(run, case, state, {**says, **state.details})


def _judged(run: Run, case: Case, state: State, says: dict[str, Any]) -> Run:
    """An answer that cannot be is a failure."""
    impossible = unmeasurable_state(state) or state_out_of_reach(case.problem, state)
    if impossible:
        return _failed(run, impossible)
    seconds = run.seconds or state.seconds
    return Run(run.entry, run.case, run.status, "", state, seconds, says, run.date)


def _failed(run: Run, why: str) -> Run:
    return Run(run.entry, run.case, Status.FAILED, why, seconds=run.seconds, date=run.date)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
