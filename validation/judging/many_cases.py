"""Many cases judged side by side, each by one of a few processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor

from palpate.validation.candidates.candidate import Candidate
from palpate.validation.case import Case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.states import Precision, Progress, in_silence

# A process needs a second to begin, as long as a few cases take.
_CASES_OF_A_PROCESS = 6
_MOST_PROCESSES = 4

Told = tuple[list[str], CaseResult]


def judge_cases(
    cases: Sequence[Case],
    candidates: Sequence[Candidate],
    *,
    precision: Precision | None = None,
    progress: Progress = in_silence,
    processes: int | None = None,
) -> list[CaseResult]:
    """Judge candidates on cases by their stored references, on several cores; see `judge_case`.

    Args:
        cases: In the order of the results.
        candidates: Those of fastsim: their solve functions go to other processes.
        precision: Granted to them.
        progress: Called with the lines of a case once it is judged, in the order of the cases.
        processes: How many; by the cores at hand and the number of cases where None.

    Raises:
        InputError: As `judge_case` does, for the first case that cannot be judged.
    """
    count = _processes_for(cases) if processes is None else processes
    waiting: list[Future[Told] | None] = [None] * len(cases)
    results = []
    with ProcessPoolExecutor(
        max(count, 1), multiprocessing.get_context("spawn"), _leave_interrupts_alone
    ) as pool:
        if count > 1:
            waiting = [pool.submit(_judged, case, candidates, precision) for case in cases]
        for case, future in zip(cases, waiting, strict=True):
            told = None if future is None else _told(future)
            if told is None:  # here its error is told as ever
                found = judge_case(
                    case, candidate=candidates, precision=precision, progress=progress
                )
            else:
                lines, found = told
                for line in lines:
                    progress(line)
            results.append(found)
    return results


def _processes_for(cases: Sequence[Case]) -> int:
    """By the cores that this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    return min(cores, _MOST_PROCESSES, len(cases) // _CASES_OF_A_PROCESS)


def _told(future: Future[Told]) -> Told | None:
    """What a process found; None where it failed, for whatever reason."""
    try:
        return future.result()
    except Exception:  # also a process that was killed
        return None


def _judged(case: Case, candidates: Sequence[Candidate], precision: Precision | None) -> Told:
    lines: list[str] = []
    found = judge_case(case, candidate=candidates, precision=precision, progress=lines.append)
    return lines, found


def _leave_interrupts_alone() -> None:
    """Ctrl-C ends the process that asked, which ends these."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
