"""Truths, stored and live, held against known answers: bar and error of each number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.reference.errors import ReferenceFailedError
from palpate.validation.metrics import WHOLE_BODY_METRICS, measure
from palpate.validation.references.adaptive_truth import TruthRequest, solve_truth
from palpate.validation.references.motions import solve_motion_set, truth_metrics
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.references.statics import solve_live
from palpate.validation.states import Progress, State
from palpate.validation.studies.calibration.answers import Answer
from palpate.validation.studies.calibration.drawn import Drawn
from palpate.validation.studies.kept import kept_file, load_rows, save_rows

STORED, LIVE = "stored", "live"
WAYS = (STORED, LIVE)
# What is asked of every truth: bars this small, or the budget spent, which is the same on every
# machine.
_BAR, _SECONDS, _UNKNOWNS = 0.02, 1800.0, 50_000.0
# An answer is known where its own doubt is at most this part of the bar.
KNOWN = 0.1
# Both below this are equal: what solvers leave.
_ROUNDING = 1e-7


class Number(NamedTuple):
    """One number of one truth; bar, error and the answer's doubt are relative."""

    problem: str
    family: str
    is_apart: bool
    way: str
    metric: str
    bar: float
    error: float
    doubt: float

    @property
    def is_known(self) -> bool:
        """Whether the answer is known ten times better than the bar, or the bar missed for sure."""
        return self.doubt <= max(KNOWN * self.bar, _ROUNDING) or self.miss > 1.0 + KNOWN

    @property
    def miss(self) -> float:
        """Error over bar, the answer's doubt in the error's favour."""
        error = max(self.error - self.doubt, 0.0)
        return 0.0 if error <= _ROUNDING else error / self.bar

    @property
    def width(self) -> float:
        """Bar over error, neither of which is below rounding."""
        return max(self.bar, _ROUNDING) / max(self.error, self.doubt, _ROUNDING)


class Summary(NamedTuple):
    """What the numbers of one way say together; parts are of the finite bars whose answer is known.

    `infinite` bars say that nothing is known: they cover nothing, and are the widest of all in the
    median. `unknown` are left out: their answers are not known well enough.
    """

    numbers: int
    covered: float
    worst: float
    width: float
    infinite: int
    unknown: int


def summarise(numbers: Sequence[Number]) -> Summary:
    """Coverage and sharpness."""
    known = [n for n in numbers if n.is_known]
    finite = [n for n in known if math.isfinite(n.bar)]
    misses = [n.miss for n in finite]
    return Summary(
        len(finite),
        float(np.mean([m <= 1.0 for m in misses])) if misses else math.nan,
        max(misses, default=math.nan),
        float(np.median([n.width for n in known])) if known else math.nan,
        len(known) - len(finite),
        len(numbers) - len(known),
    )


def hold(
    drawn: Drawn, way: str, progress: Progress, *, answer: Answer | None = None
) -> list[Number]:
    """The numbers of one problem; none where the reference gives no truth at all.

    Args:
        drawn: The problem.
        way: STORED or LIVE.
        progress: Called with one line now and then.
        answer: What to hold it against instead of what is known.
    """
    problem, strain, known = drawn.make()
    answer = answer or known
    if answer is None:
        progress("its answer has not been found")
        return []
    try:
        truth, bars = (_stored if way == STORED else _live)(problem, strain, progress)
    except ReferenceFailedError as failure:
        progress(f"no truth: {failure}")
        return []
    found = []
    for metric, bar in bars.items():
        try:
            error = _error(metric, problem, truth, answer)
        except InputError:  # nothing swings
            continue
        doubt = answer.doubts.get(metric, answer.doubts.get("", 0.0))
        found.append(
            Number(drawn.name, drawn.family, drawn.is_apart, way, metric, bar, error, doubt)
        )
    return found


def hold_all(
    problems: Iterable[Drawn],
    progress: Progress,
    *,
    ways: Sequence[str] = WAYS,
    kept: Path | None = None,
    jobs: int = 1,
) -> list[Number]:
    """The numbers of problems, stored and live.

    Args:
        problems: Which.
        progress: Called with one line now and then.
        ways: STORED, LIVE or both.
        kept: Folder of numbers that were found before, and where new ones go; see `studies.kept`.
        jobs: How many are solved at once, each in a process of its own.
    """

    def one(drawn: Drawn, way: str) -> list[Number]:
        file = None if kept is None else file_of(kept, drawn, way)
        rows = None if file is None else load_rows(file)
        if rows is not None:
            progress(f"{drawn.name}, {way}: kept")
            return [Number(*row) for row in rows]
        found = hold(drawn, way, lambda line: progress(f"{drawn.name}, {way}: {line}"))
        if file is not None and found:
            save_rows(file, found)
        return found

    with ThreadPoolExecutor(jobs) as pool:  # truths are solved in child processes
        lists = [pool.submit(one, drawn, way) for drawn in problems for way in ways]
        try:
            return [number for each in lists for number in each.result()]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def file_of(folder: Path, drawn: Drawn, way: str) -> Path:
    """Where the numbers of a problem, found in a way, are kept."""
    solved = [drawn.name, drawn.maker, dict(drawn.given), way]
    return kept_file(folder, f"{drawn.name}-{way}", solved, Path(__file__).parent)


def _error(metric: str, problem: Problem, truth: State, answer: Answer) -> float:
    return measure(metric, problem, truth, answer.state).value


def _stored(problem: Problem, strain: Strain, progress: Progress) -> tuple[State, dict[str, float]]:
    if problem.time is None:
        request = _request(strain)
        state, bars, _ = solve_truth(problem, strain, request, progress)
        return state, {metric: bars[metric] for metric in WHOLE_BODY_METRICS}
    found = solve_motion_set(
        problem, progress, wanted=("truth",), is_for_storing=True, truth_strains=(strain,)
    )
    return _of(found, problem, strain)


def _live(problem: Problem, strain: Strain, progress: Progress) -> tuple[State, dict[str, float]]:
    found = solve_live(
        problem,
        progress,
        wanted=("truth",),
        request=_request(strain),
        has_stress=False,
        strains=(strain,),
    )
    return _of(found, problem, strain)


def _request(strain: Strain) -> TruthRequest:
    metrics = {strain: tuple(WHOLE_BODY_METRICS)}
    return TruthRequest(_BAR, _SECONDS, metrics=metrics, unknowns=_UNKNOWNS)


def _of(found: ReferenceSet, problem: Problem, strain: Strain) -> tuple[State, dict[str, float]]:
    truth = found.truth(strain)
    if truth is None:
        raise ReferenceFailedError(found.failure("truth", strain) or "no truth")
    names = tuple(WHOLE_BODY_METRICS) if problem.time is None else truth_metrics(problem)
    return truth, {name: found.bars.get((name, strain), math.inf) for name in names}
