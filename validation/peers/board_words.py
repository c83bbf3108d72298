"""Numbers and outcomes of the scoreboard as a page shows them."""

from __future__ import annotations

import math
from statistics import median

from palpate.validation.peers.board_judge import Score
from palpate.validation.peers.board_runs import Status
from palpate.validation.states import Verdict

# How adapters say that there is something in a case that they do not pass on.
_NOT_HANDED = ": not handed to this simulator here"
# Less than this is nothing to anybody.
_LEAST = 1e-5


def percent(value: float | None, *, signed: bool = False) -> str:
    """A part as two digits of per cent."""
    if value is None or not math.isfinite(value):
        return "–"
    if abs(value) < _LEAST:
        return "0 %" if signed else "< 0.001 %"
    digits = max(0, 1 - math.floor(math.log10(abs(100.0 * value))))
    return f"{100.0 * value:{'+' if signed else ''}.{digits}f} %"


def seconds(value: float | None) -> str:
    """Two digits of seconds."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return "–"
    return f"{value:.2g} s" if value < 100.0 else f"{value:.0f} s"


def minutes(value: float) -> str:
    """Whole minutes, with their unit."""
    whole = round(value)
    return "less than a minute" if whole < 1 else "1 minute" if whole == 1 else f"{whole} minutes"


def memory(value: float | None) -> str:
    """Whole megabytes."""
    return f"{value:.0f} MB" if isinstance(value, int | float) else "–"


def outcome(score: Score) -> str:
    """What a cell of the table says of a run."""
    if score.run.status is Status.FAILED:
        return "failed"
    if score.run.status is not Status.ANSWERED:
        return "–"
    return percent(score.distance) if score.distance is not None else "no truth"


def kind(score: Score) -> str:
    """The class of such a cell: what colour it has."""
    if score.run.status is Status.NOT_POSED or score.run.status is Status.MISSING:
        return "none"
    if score.verdict is Verdict.SKIPPED:
        return "told"
    return score.verdict.value


def bar(value: float | None) -> str:
    """An error bar."""
    return "no bar" if value is None or not math.isfinite(value) else f"± {percent(value)}"


def reason(score: Score) -> str:
    """Why there is no distance, in short: a program's own words where it gave some."""
    why = score.why
    if score.run.status is Status.NOT_POSED:
        why = why.removeprefix("the case cannot be posed to it: ").strip('"')
        if not why.endswith(_NOT_HANDED):
            return why
        asked = why.removesuffix(_NOT_HANDED).split(", ")
        wanted = ", ".join("motion" if word == "time" else word for word in asked)
        return f"asks for {wanted}, which its adapter does not pass on"
    if " s, its last line: " in why:  # a log's line says nothing of why time ran out
        return why.partition(", its last line: ")[0]
    return why.removeprefix("it ended with 1, its last line: ").strip('"')


def hint(score: Score) -> str:
    """What it says when it is pointed at."""
    if score.distance is None:
        return reason(score)
    need = "" if score.limit is None else f"; its user needs {percent(score.limit)}"
    return f"{bar(score.bar)}{need}"


def need(scores: list[Score]) -> str:
    """What a case's user needs, where it says so."""
    limit = scores[0].limit if scores else None
    return "" if limit is None else percent(limit)


def median_distance(scores: list[Score]) -> float | None:
    """In the middle of what was answered."""
    found = [s.distance for s in scores if s.distance is not None and math.isfinite(s.distance)]
    return median(found) if found else None


def said(score: Score, name: str) -> float | None:
    """A number that a simulator says of its run."""
    value = score.run.says.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None
