"""The scoreboard: every simulator on every case; a failure of one does not stop the others.

Simulators of others run side by side, each in a process of its own; truths under other laws are
solved here meanwhile, one after the other. Quick cases come first, so that a call that is
interrupted has cached most of the results.
"""

from __future__ import annotations

import datetime
import os
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field

from palpate.meshes.material_law import Law
from palpate.validation.cached_results import ResultCache
from palpate.validation.case import Case
from palpate.validation.peers.board_judge import Score, judge_run
from palpate.validation.peers.board_references import OwnSteps, Truth, case_under, find_truth
from palpate.validation.peers.board_runs import Run, Status, read_run, run_entry, warm_up
from palpate.validation.peers.registry import Peer
from palpate.validation.states import Progress, Verdict, in_silence

# A motion takes about as long as this many statics of its mesh; it only affects the order.
_STEPS_OF_A_MOTION = 10.0


@dataclass(frozen=True, eq=False)
class Board:
    """The results of the scoreboard.

    Attributes:
        entries: Simulators that are installed, in their order.
        absent: Simulators that are not installed.
        cases: Cases in their order.
        scores: Scores by name of entry and case.
        truths: Truths by name of case and law.
        time_limit: Time limit of one run [s].
        date: When the board was made.
        minutes: Wall time of this call [min].
        processor_minutes: Processor time of everything that was run for it [min].
        cached: Dates of the runs, truths and references of earlier calls that it shows, by name.
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
    cached: Mapping[str, str] = field(default_factory=dict)

    def of_entry(self, entry: Peer) -> list[Score]:
        """The scores of an entry, in the order of the cases."""
        return [self.scores[entry.name, case.path.stem] for case in self.cases]

    def of_case(self, case: Case) -> list[Score]:
        """The scores on a case, in the order of the entries."""
        return [self.scores[entry.name, case.path.stem] for entry in self.entries]


def compute_board(
    entries: Sequence[Peer],
    cases: Sequence[Case],
    cache: ResultCache,
    *,
    time_limit: float,
    progress: Progress,
    processes: int | None = None,
) -> Board:
    """Run everything that no cached result may be used of, and judge it.

    Args:
        entries: The simulators.
        cases: The cases that they solve.
        cache: Where results go; those of earlier calls are used where it says so.
        time_limit: Time limit of one run [s].
        progress: Called with one line for each run or truth.
        processes: How many runs there are at once; the number of cores where None.
    """
    begin, spent = time.monotonic(), _processor_seconds()
    lock, processes = threading.Lock(), processes or _cores()

    def say(line: str) -> None:
        """Report a line, of any thread, with the minutes since the start."""
        minutes, seconds = divmod(int(time.monotonic() - begin), 60)
        with lock:
            progress(f"{minutes:2d}:{seconds:02d} {line}")

    absent = [e for e in entries if e.is_outside and e.command_line() is None]
    for entry in absent:
        progress(f"{entry.name}: {entry.why_missing()}")
    present = [entry for entry in entries if entry not in absent]
    # Every case under each entry's law and under its own; each body is meshed once.
    under = {
        (case.path.stem, law): case_under(case, law)
        for case in cases
        for law in {case.spec.material.law, *(entry.law for entry in present)}
    }
    wanted = [(entry, case) for case in sorted(cases, key=_cost) for entry in present]
    runs: dict[tuple[str, str], Run] = {}
    truths: dict[tuple[str, Law], Truth] = {}
    at_once = threading.Semaphore(processes)

    def run(entry: Peer, case: Case) -> None:
        name = case.path.stem
        runs[entry.name, name] = run_entry(entry, under[name, entry.law], cache, time_limit, say)

    def run_beside(entry: Peer, case: Case) -> tuple[Peer, Case]:
        with at_once:
            run(entry, case)
        return entry, case

    def need(case: Case, law: Law) -> None:
        of = under[case.path.stem, law]
        key = case.path.stem, of.problem.material.law
        if key not in truths:
            with at_once:
                say(f"truth of {of.name}")
                truths[key] = find_truth(of, cache, say)

    for entry, case in wanted:  # in this process, which is timed while it does nothing else
        if not entry.is_outside:
            run(entry, case)
    for entry in (one for one in present if one.compiles):
        bodies = [under[case.path.stem, entry.law] for other, case in wanted if other is entry]
        missing = (o for o in bodies if not read_run(entry, o, cache, time_limit, in_silence))
        any(warm_up(entry, of, say) for of in missing)  # until it takes one of them
    # Cases under another law come first: their truths are solved here while the others run.
    outside = [(entry, case) for entry, case in wanted if entry.is_outside]
    outside.sort(key=lambda one: (_cost(one[1]), one[0].law is one[1].spec.material.law))
    pool = ThreadPoolExecutor(processes)
    try:
        waiting = [pool.submit(run_beside, *one) for one in outside]
        for case in cases:
            need(case, case.spec.material.law)
        for future in as_completed(waiting):
            entry, case = future.result()
            if runs[entry.name, case.path.stem].status is Status.ANSWERED:
                need(case, entry.law)
    finally:  # after an error here nothing more begins
        pool.shutdown(cancel_futures=True)
    say("every run has ended; judged now")
    scores: dict[tuple[str, str], Score] = {}
    own_steps = OwnSteps(cache, say)
    for entry, case in wanted:
        name, of = case.path.stem, under[case.path.stem, entry.law]
        law = of.problem.material.law
        truth = truths.get((name, law), Truth(of, why="not needed"))
        of_case = truths.get((name, case.problem.material.law), truth)
        score = _judged(runs[entry.name, name], entry, truth, of_case, own_steps)
        scores[entry.name, name] = score
        say(line_on(score))
    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="minutes")
    minutes = (time.monotonic() - begin) / 60.0
    processor = (_processor_seconds() - spent) / 60.0
    say(f"done: {processor:.0f} min of processor time")
    numbers = time_limit, date, minutes, processor
    return Board(present, absent, cases, scores, truths, *numbers, dict(cache.used))


def _processor_seconds() -> float:
    """Processor time of this process with all threads, and of ended children [s]."""
    now = os.times()
    return now.user + now.system + now.children_user + now.children_system


def _cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def _cost(case: Case) -> float:
    """A cost that orders cases by their time: the number of cells, for motions times steps."""
    is_motion = case.problem.time is not None
    return case.problem.mesh.num_cells * (_STEPS_OF_A_MOTION if is_motion else 1.0)


def _judged(run: Run, entry: Peer, truth: Truth, of_case: Truth, own_steps: OwnSteps) -> Score:
    """Judge a run; one that cannot be judged has a score that says so, and stops no other."""
    try:
        return judge_run(run, entry, truth, of_case, own_steps)
    except Exception as error:
        why = f"could not be judged ({type(error).__name__}: {error})"
        return Score(run, truth.law, verdict=Verdict.INCONCLUSIVE, why=why)


def line_on(score: Score) -> str:
    """One line on a score."""
    run = score.run
    before = f" (cached, of {run.date})" if run.is_cached else ""
    if score.distance is None:
        why = f": {score.why}" if score.why else ""
        return f"{run.entry} on {run.case}: {run.status}{why}{before}"
    percent = f"{100.0 * score.distance:.3g} % from the truth of {score.law}"
    return f"{run.entry} on {run.case}: {percent}{before}"
