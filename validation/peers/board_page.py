"""The scoreboard as pages that need no server, and its data as CSV and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from markupsafe import Markup
from matplotlib import pyplot
from matplotlib.ticker import PercentFormatter

from palpate.meshes.problem import Problem, Strain
from palpate.validation.peers.bench import describe_machine
from palpate.validation.peers.board import Board
from palpate.validation.peers.board_judge import CAUSES, CONTACT, LAW, MESH, SOLVER, STEP, Score
from palpate.validation.peers.board_runs import Status
from palpate.validation.peers.registry import Peer
from palpate.validation.quoting import for_json, for_markdown, visible
from palpate.validation.report.html import page_environment
from palpate.validation.report.plots import (
    BLUE,
    GREY,
    OCHRE,
    PURPLE,
    RED,
    figure_svg,
    plot_style,
    tidy,
)
from palpate.validation.report.study_page import Table
from palpate.validation.run_folder import RESULTS
from palpate.validation.states import Verdict
from palpate.validation.versions import version_of

INDEX = "index.html"
COMMAND = ("make peers", "make scoreboard")
_COLUMNS = {
    "simulator": "", "case": "", "status": "", "verdict": "", "law": "", "version": "",
    "metric": "", "distance": ".4g", "bar": ".4g", "limit": ".4g", "same_mesh": ".4g",
    **{f"error_{cause}": ".4g" for cause in CAUSES}, "follows": "", "law_apart": ".4g",
    "processor_seconds": ".4g", "wall_seconds": ".4g", "peak_memory_mb": ".4g",
    "smallest_det_f": ".4g", "tool_force": ".4g", "method": "", "why": "", "date": "", "cached": "",
}  # fmt: skip


def write_board(board: Board, folder: Path) -> Path:
    """Write every page, scores.csv, results.json and summary.md into a folder that exists.

    Returns:
        The page to open first.
    """
    table = scores_table(board)
    (folder / "scores.csv").write_text(table.csv, encoding="utf-8")
    text = json.dumps(for_json(document(board, table)), indent=1, allow_nan=False)
    (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
    (folder / "summary.md").write_text(summary_markdown(board), encoding="utf-8")
    environment = page_environment()
    for word in (
        percent, seconds, memory, minutes, outcome, kind, hint, stated, need, bar, reason,
    ):  # fmt: skip
        environment.globals[word.__name__] = word
    common = {
        "board": board,
        "machine": describe_machine(),
        "palpate": version_of("palpate"),
        "command": COMMAND,
        "took": minutes_of(board),
        "cached": words_on_cached(board),
    }

    def write(name: str, template: str, **more: Any) -> None:
        page = environment.get_template(template).render(**common, **more)
        (folder / name).write_text(page, encoding="utf-8")

    rows = [entry_row(entry, board) for entry in board.entries]
    write(INDEX, "scoreboard.html.j2", rows=rows)
    for entry in board.entries:
        scores = board.of_entry(entry)
        write(
            f"simulator-{entry.name}.html",
            "scoreboard_simulator.html.j2",
            entry=entry,
            row=entry_row(entry, board),
            pairs=list(zip(board.cases, scores, strict=True)),
            plot=Markup(causes_svg([s.run.case for s in scores], scores)),
        )
    for case in board.cases:
        scores = board.of_case(case)
        write(
            f"case-{case.path.stem}.html",
            "scoreboard_case.html.j2",
            case=case,
            about=about_case(case.problem, case.strain),
            truths=[t for (name, _), t in board.truths.items() if name == case.path.stem],
            pairs=list(zip(board.entries, scores, strict=True)),
            plot=Markup(causes_svg([entry.title for entry in board.entries], scores)),
        )
    return folder / INDEX


def scores_table(board: Board) -> Table:
    """The table of scores, with a row for each simulator and case."""
    rows = [_row(entry, score) for entry in board.entries for score in board.of_entry(entry)]
    return Table("Scores", _COLUMNS, rows)


def _row(entry: Peer, score: Score) -> Sequence[Any]:
    run = score.run
    return [
        entry.name, run.case, run.status.value, score.verdict.value, score.law.value,
        str(run.says.get("version", "")), score.metric, score.distance, score.bar, score.limit,
        score.same_mesh, *(score.causes.get(cause) for cause in CAUSES), score.follows,
        score.law_apart, stated(score, "seconds"), run.seconds or None,
        stated(score, "peak_memory_mb"), score.smallest_det_f, score.tool_force,
        visible(str(run.says.get("method", ""))), visible(score.why), run.date,
        run.is_cached,
    ]  # fmt: skip


def document(board: Board, table: Table) -> dict[str, Any]:
    """The whole board as plain data."""
    truths = [
        {
            "case": name,
            "law": law.value,
            "why": truth.why,
            "origin": "" if truth.references is None else truth.references.origin,
            "seconds": truth.seconds or None,
            "cached": truth.cached or None,
        }
        for (name, law), truth in board.truths.items()
    ]
    return {
        "palpate": version_of("palpate"),
        "date": board.date,
        "minutes": board.minutes,
        "processor_minutes": board.processor_minutes,
        "minutes_of_all": minutes_of(board),
        "time_limit": board.time_limit,
        "cached": dict(board.cached),
        "machine": describe_machine(),
        "simulators": [entry.model_dump(mode="json") for entry in board.entries],
        "absent": [entry.name for entry in board.absent],
        "cases": [{"name": case.path.stem, "title": case.title} for case in board.cases],
        "truths": truths,
        "scores": table.records,
    }


def words_on_cached(board: Board) -> str:
    """How much of a board earlier calls made, and when; "" where they made nothing of it."""
    if not board.cached:
        return ""
    dates = sorted(board.cached.values())
    when = dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}"
    runs = sum(score.run.is_cached for score in board.scores.values())
    rest = len(board.cached) - runs
    return f"Cached: {runs} of {len(board.scores)} runs, {rest} truths and references, of {when}"


def minutes_of(board: Board) -> dict[str, float]:
    """Wall time of all runs and truths solved here, whenever that was, one after the other.

    Runs that hit the time limit count with it; cases that were refused do not count.
    """
    runs = [score.run for score in board.scores.values()]
    waited = sum("no result within" in run.why for run in runs) * board.time_limit
    return {
        "runs": (sum(run.seconds for run in runs) + waited) / 60.0,
        "truths": sum(truth.seconds for truth in board.truths.values()) / 60.0,
    }


def entry_row(entry: Peer, board: Board) -> dict[str, Any]:
    """The summary of a simulator in one row."""
    scores = board.of_entry(entry)
    answered = [score for score in scores if score.run.status is Status.ANSWERED]
    verdicts = [score.verdict for score in scores if score.limit is not None]
    distances = [d for s in answered if (d := s.distance) is not None and math.isfinite(d)]
    memories = [m for s in answered if (m := stated(s, "peak_memory_mb")) is not None]
    versions = (score.run.says.get("version") for score in scores)
    return {
        "entry": entry,
        "version": visible(str(next(filter(None, versions), "–"))),
        "answered": len(answered),
        "failed": sum(score.run.status is Status.FAILED for score in scores),
        "not_posed": sum(score.run.status is Status.NOT_POSED for score in scores),
        "within": verdicts.count(Verdict.PASSED),
        "asked": len([v for v in verdicts if v is not Verdict.SKIPPED]),
        "median": median(distances) if distances else None,
        "seconds": sum(stated(score, "seconds") or 0.0 for score in answered) or None,
        "memory": max(memories, default=None),
    }


def about_case(problem: Problem, strain: Strain) -> str:
    """The problem in a sentence."""
    material, mesh = problem.material, problem.mesh
    kinds = ", ".join(dict.fromkeys(type(x).__name__ for x in (*problem.loads, *problem.springs)))
    kinds = kinds or "none"
    motion = "" if problem.time is None else f", {problem.time.end_time:g} s of motion"
    return (
        f"{mesh.num_cells} tetrahedra, {mesh.num_points} points; E = "
        f"{material.youngs_modulus:g} Pa, nu = {material.poissons_ratio:g}; {strain} strain; "
        f"{len(problem.supports)} support(s), {len(problem.tools)} tool(s), loads: {kinds}{motion}"
    )


def summary_markdown(board: Board) -> str:
    """A table with a line for each simulator, for a README."""
    lines = [
        "| simulator | law | answered | within need | median distance | processor time | memory |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for entry in board.entries:
        row = entry_row(entry, board)
        cells = [
            f"{entry.title} {row['version']}",
            entry.law.value,
            f"{row['answered']} of {len(board.cases)}, {row['failed']} failed",
            f"{row['within']} of {row['asked']}",
            percent(row["median"]),
            seconds(row["seconds"]),
            memory(row["memory"]),
        ]
        lines.append(f"| {' | '.join(map(for_markdown, cells))} |")
    for entry in board.absent:
        cells = [entry.title, entry.law.value, "not run here", *4 * ["–"]]
        lines.append(f"| {' | '.join(map(for_markdown, cells))} |")
    cached = words_on_cached(board)
    return "\n".join([*lines, *(["", f"{cached}."] if cached else [])]) + "\n"


_COLOURS = {LAW: RED, MESH: BLUE, STEP: OCHRE, SOLVER: GREY, CONTACT: PURPLE}
# Bars end here: beyond, a body is not where it should be at all; the table has the number.
_MOST = 1.0


def causes_svg(labels: Sequence[str], scores: Sequence[Score]) -> str:
    """Bars to both sides of zero for each result whose causes are known; "" where there is none."""
    rows = [(label, s.causes) for label, s in zip(labels, scores, strict=True) if s.causes]
    if not rows:
        return ""
    with plot_style():
        figure, axes = pyplot.subplots(figsize=(8.4, 1.0 + 0.3 * len(rows)))
        ends = {is_right: [0.0] * len(rows) for is_right in (True, False)}
        for cause, colour in _COLOURS.items():
            for row, (_, causes) in enumerate(rows):
                value = causes.get(cause, 0.0)
                if math.isfinite(value) and value:
                    begin = ends[value > 0.0][row]
                    axes.barh(row, value, left=begin, color=colour, height=0.6)
                    ends[value > 0.0][row] = begin + value
            if any(cause in causes for _, causes in rows):
                axes.barh(0, 0.0, color=colour, label=cause)
        low = min(-0.02, max(-_MOST, min(ends[False])))
        high = max(0.02, min(_MOST, max(ends[True])))
        axes.set_xlim(1.06 * low, 1.06 * high)
        axes.set_yticks(range(len(rows)), [visible(label) for label, _ in rows])
        axes.invert_yaxis()
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set_axisbelow(True)
        axes.axvline(0.0, color="#5c6670", lw=0.8)
        axes.legend(ncols=len(_COLOURS), loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
        tidy(axes)
        figure.tight_layout()
        return figure_svg(figure, "Errors by cause")


# How adapters state that a case has something that they do not pass on.
_NOT_HANDED = ": not handed to this simulator here"
# Values below this are shown as zero.
_LEAST = 1e-5


def percent(value: float | None, *, signed: bool = False) -> str:
    """Format a fraction in per cent with two digits."""
    if value is None or not math.isfinite(value):
        return "–"
    if abs(value) < _LEAST:
        return "0 %" if signed else "< 0.001 %"
    digits = max(0, 1 - math.floor(math.log10(abs(100.0 * value))))
    return f"{100.0 * value:{'+' if signed else ''}.{digits}f} %"


def seconds(value: float | None) -> str:
    """Format seconds with two digits."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return "–"
    return f"{value:.2g} s" if value < 100.0 else f"{value:.0f} s"


def minutes(value: float) -> str:
    """Format whole minutes, with their unit."""
    whole = round(value)
    return "less than a minute" if whole < 1 else "1 minute" if whole == 1 else f"{whole} minutes"


def memory(value: float | None) -> str:
    """Format whole megabytes."""
    return f"{value:.0f} MB" if isinstance(value, int | float) else "–"


def outcome(score: Score) -> str:
    """The text of a run's cell in the table."""
    if score.run.status is Status.ANSWERED:
        return percent(score.distance) if score.distance is not None else "no truth"
    return "failed" if score.run.status is Status.FAILED else "–"


def kind(score: Score) -> str:
    """The class of such a cell, which gives its colour."""
    if score.run.status in (Status.NOT_POSED, Status.MISSING):
        return "none"
    return "open" if score.verdict is Verdict.SKIPPED else score.verdict.value


def bar(value: float | None) -> str:
    """Format an error bar."""
    return "no bar" if value is None or not math.isfinite(value) else f"± {percent(value)}"


def reason(score: Score) -> str:
    """The reason in short why there is no distance: the program's own words where it gave any."""
    why = score.why
    if score.run.status is Status.NOT_POSED:
        why = why.removeprefix("the case cannot be posed to it: ").strip('"')
        if not why.endswith(_NOT_HANDED):
            return why
        asked = why.removesuffix(_NOT_HANDED).split(", ")
        wanted = ", ".join("motion" if word == "time" else word for word in asked)
        return f"asks for {wanted}, which its adapter does not pass on"
    if " s, its last line: " in why:  # the line does not say why time ran out
        return why.partition(", its last line: ")[0]
    return why.removeprefix("it ended with 1, its last line: ").strip('"')


def hint(score: Score) -> str:
    """The text that appears when the pointer is over a score."""
    if score.distance is None:
        return reason(score)
    need = "" if score.limit is None else f"; its user needs {percent(score.limit)}"
    return f"{bar(score.bar)}{need}"


def need(scores: list[Score]) -> str:
    """The need of a case's user, where the case states it."""
    limit = scores[0].limit if scores else None
    return "" if limit is None else percent(limit)


def stated(score: Score, name: str) -> float | None:
    """A number that a simulator states about its run."""
    value = score.run.says.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None
