"""Every simulator on every case: nothing that one of them does stops the others.

Simulators of others run side by side, each a process of its own; truths under other laws are
solved here meanwhile, one after the other. What is quick comes first, so that a call that is
interrupted has kept most of the answers.
"""

from __future__ import annotations

import datetime
import os
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass

from palpate.meshes.material_law import Law
from palpate.validation.case import Case
from palpate.validation.peers import board_words as words
from palpate.validation.peers.board_judge import Score, judge_run
from palpate.validation.peers.board_kept import Kept
from palpate.validation.peers.board_own_steps import OwnSteps
from palpate.validation.peers.board_runs import Run, Status, is_kept, run_entry, warm_up
from palpate.validation.peers.board_truths import Truth, case_under, find_truth
from palpate.validation.peers.registry import Peer
from palpate.validation.states import Progress, Verdict

# A motion takes about as long as so many statics of its mesh; only the order hangs on it.
_STEPS_OF_A_MOTION = 10.0


@dataclass(frozen=True, eq=False)
class Board:
    """What was computed and judged.

    Attributes:
        entries: In their order, those that are installed.
        absent: Those that are not.
        cases: In their order.
        scores: By name of entry and case.
        truths: By name of case and law.
        time_limit: Of one run [s].
        date: When the board was made.
        minutes: That making it took this time, by the clock.
        processor_minutes: Likewise of the processor, of everything that was run for it.
    """

    entries: Sequence[Peer]
    absent: Sequence[Peer]
    cases: Sequence[Case]
    scores: Mapping[tuple[str, str], Score]
    truths: Mapping[tuple[str, Law], Truth]
    time_limit: float
    date: str
    minutes: float
    processor_minutes: float

    def score(self, entry: Peer, case: Case) -> Score:
        """Of one simulator on one case."""
        return self.scores[entry.name, case.path.stem]

    def of_entry(self, entry: Peer) -> list[Score]:
        """Its scores, in the order of the cases."""
        return [self.score(entry, case) for case in self.cases]

    def of_case(self, case: Case) -> list[Score]:
        """Of everybody, in their order."""
        return [self.score(entry, case) for entry in self.entries]


def compute_board(
    entries: Sequence[Peer],
    cases: Sequence[Case],
    kept: Kept,
    *,
    time_limit: float,
    progress: Progress,
    processes: int | None = None,
) -> Board:
    """Run what is missing, and judge everything.

    Args:
        entries: Who is asked.
        cases: What they are asked.
        kept: What is there already, and where new answers go.
        time_limit: Of one run [s].
        progress: Called with one line for each thing done.
        processes: How many things are done at once; as many as there are cores where None.
    """
    begin, spent = time.monotonic(), _processor_seconds()
    absent = [e for e in entries if e.is_outside and e.command_line() is None]
    for entry in absent:
        progress(f"{entry.name}: {entry.why_missing()}")
    present = [entry for entry in entries if entry not in absent]
    clock = _Clock(begin, progress)
    under = _under_laws(cases, present)
    asked = [(entry, case) for case in sorted(cases, key=_cost) for entry in present]
    runs: dict[tuple[str, str], Run] = {}
    for entry, case in asked:  # by this process, whose time is told while it does nothing else
        if not entry.is_outside:
            name = case.path.stem
            runs[entry.name, name] = run_entry(
                entry, under[name, entry.law], kept, time_limit, clock.say
            )
    for entry in (one for one in present if one.compiles):
        missing = (
            of
            for who, case in asked
            if who is entry
            and not is_kept(entry, of := under[case.path.stem, entry.law], kept, time_limit)
        )
        any(warm_up(entry, of, clock.say) for of in missing)  # until one can be posed to it
    truths: dict[tuple[str, Law], Truth] = {}
    rooms = threading.Semaphore(processes or _cores())

    def answer(entry: Peer, case: Case) -> tuple[Case, Run]:
        with rooms:
            asked_of = under[case.path.stem, entry.law]
            return case, run_entry(entry, asked_of, kept, time_limit, clock.say)

    def need(case: Case, law: Law) -> None:
        of = under[case.path.stem, law]
        key = case.path.stem, of.problem.material.law
        if key not in truths:
            with rooms:
                clock.say(f"truth of {of.name}")
                truths[key] = find_truth(of, kept, clock.say)

    with _pool(processes or _cores()) as pool:
        # Under another law first: its truth is solved here while the others run.
        outside = [(e, c) for e, c in asked if e.is_outside]
        outside.sort(key=lambda one: (_cost(one[1]), one[0].law is one[1].spec.material.law))
        laws = {entry.name: entry.law for entry in present}
        waiting = [pool.submit(answer, *one) for one in outside]
        for case in cases:
            need(case, case.spec.material.law)
        for future in as_completed(waiting):
            case, run = future.result()
            runs[run.entry, case.path.stem] = run
            if run.status is Status.ANSWERED:
                need(case, laws[run.entry])
    clock.say("every run has ended; judged now")
    scores: dict[tuple[str, str], Score] = {}
    own_steps = OwnSteps(kept, clock.say)
    for entry, case in asked:
        name, own = case.path.stem, case.problem.material.law
        of = under[name, entry.law]
        truth = truths.get((name, of.problem.material.law), Truth(of, why="nobody asked"))
        scores[entry.name, name] = _judged(
            runs[entry.name, name], entry, truth, truths.get((name, own), truth), own_steps
        )
        clock.say(told(scores[entry.name, name]))
    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="minutes")
    minutes = (time.monotonic() - begin) / 60.0
    processor = (_processor_seconds() - spent) / 60.0
    clock.say(f"done: {words.minutes(processor)} of processor time")
    return Board(present, absent, cases, scores, truths, time_limit, date, minutes, processor)


def _under_laws(cases: Sequence[Case], entries: Sequence[Peer]) -> dict[tuple[str, Law], Case]:
    """Every case under every entry's law and under its own; each body is made once."""
    found: dict[tuple[str, Law], Case] = {}
    for case in cases:
        for law in {case.spec.material.law, *(entry.law for entry in entries)}:
            found[case.path.stem, law] = case_under(case, law)
    return found


class _Clock:
    """Lines of several threads, each with the minutes since the start."""

    def __init__(self, begin: float, progress: Progress) -> None:
        self._begin, self._progress, self._lock = begin, progress, threading.Lock()

    def say(self, line: str) -> None:
        """Tell one line."""
        minutes, seconds = divmod(int(time.monotonic() - self._begin), 60)
        with self._lock:
            self._progress(f"{minutes:2d}:{seconds:02d} {line}")


@contextmanager
def _pool(threads: int) -> Iterator[ThreadPoolExecutor]:
    """One that begins nothing more where something goes wrong here."""
    pool = ThreadPoolExecutor(threads)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _processor_seconds() -> float:
    """Of this process, all threads, and of those that it has waited for."""
    now = os.times()
    return now.user + now.system + now.children_user + now.children_system


def _cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def _cost(case: Case) -> float:
    """What orders cases by how long they take: cells, and of motions many steps of them."""
    is_motion = case.problem.time is not None
    return case.problem.mesh.num_cells * (_STEPS_OF_A_MOTION if is_motion else 1.0)


def _judged(run: Run, entry: Peer, truth: Truth, of_case: Truth, own_steps: OwnSteps) -> Score:
    """A score; what cannot be judged is shown as that, and stops nobody."""
    try:
        return judge_run(run, entry, truth, of_case, own_steps)
    except Exception as error:
        why = f"could not be judged ({type(error).__name__}: {error})"
        return Score(run, truth.law, verdict=Verdict.INCONCLUSIVE, why=why)


def told(score: Score) -> str:
    """One line on a score."""
    run = score.run
    if score.distance is None:
        return f"{run.entry} on {run.case}: {run.status}" + (f": {score.why}" if score.why else "")
    return (
        f"{run.entry} on {run.case}: {100.0 * score.distance:.3g} % from the truth of {score.law}"
    )
