"""Every simulator on every case: nothing that one of them does stops the others."""

from __future__ import annotations

import datetime
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.meshes.material_law import Law
from palpate.validation.case import Case
from palpate.validation.scoreboard.entries import Entry
from palpate.validation.scoreboard.judge import Score, judge_run
from palpate.validation.scoreboard.kept import Kept
from palpate.validation.scoreboard.runs import Run, Status, run_entry
from palpate.validation.scoreboard.truths import Truth, case_under, find_truth
from palpate.validation.states import Progress, Verdict


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
        minutes: That making it took this time.
    """

    entries: Sequence[Entry]
    absent: Sequence[Entry]
    cases: Sequence[Case]
    scores: Mapping[tuple[str, str], Score]
    truths: Mapping[tuple[str, Law], Truth]
    time_limit: float
    date: str
    minutes: float

    def score(self, entry: Entry, case: Case) -> Score:
        """Of one simulator on one case."""
        return self.scores[entry.name, case.path.stem]

    def of_entry(self, entry: Entry) -> list[Score]:
        """Its scores, in the order of the cases."""
        return [self.score(entry, case) for case in self.cases]

    def of_case(self, case: Case) -> list[Score]:
        """Of everybody, in their order."""
        return [self.score(entry, case) for entry in self.entries]


def compute_board(
    entries: Sequence[Entry],
    cases: Sequence[Case],
    kept: Kept,
    *,
    time_limit: float,
    progress: Progress,
) -> Board:
    """Run what is missing, and judge everything.

    Args:
        entries: Who is asked.
        cases: What they are asked.
        kept: What is there already, and where new answers go.
        time_limit: Of one run [s].
        progress: Called with one line for each thing done.
    """
    begin = time.monotonic()
    scores: dict[tuple[str, str], Score] = {}
    truths: dict[tuple[str, Law], Truth] = {}
    absent = [e for e in entries if e.is_outside and e.command_line() is None]
    for entry in absent:
        progress(f"{entry.name}: {entry.why_missing()}")
    present = [entry for entry in entries if entry not in absent]
    for case in cases:
        name, own = case.path.stem, case.problem.material.law
        for entry in present:
            asked = case_under(case, entry.law)
            run = run_entry(entry, asked, kept, time_limit, progress)
            law = asked.problem.material.law
            needs_truth = run.status is Status.ANSWERED
            for law_needed, of in ((law, asked), (own, case)):
                if needs_truth and (name, law_needed) not in truths:
                    progress(f"truth of {of.name}")
                    truths[name, law_needed] = find_truth(of, kept, progress)
            none = Truth(asked, why="nobody asked")
            truth, of_case = truths.get((name, law), none), truths.get((name, own), none)
            scores[entry.name, name] = _judged(run, entry, truth, of_case)
            progress(told(scores[entry.name, name]))
    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="minutes")
    minutes = (time.monotonic() - begin) / 60.0
    return Board(present, absent, cases, scores, truths, time_limit, date, minutes)


def _judged(run: Run, entry: Entry, truth: Truth, of_case: Truth) -> Score:
    """A score; what cannot be judged is shown as that, and stops nobody."""
    try:
        return judge_run(run, entry, truth, of_case)
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
