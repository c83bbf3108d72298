"""The board as pages that need no server, and its data as CSV and JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from palpate.meshes.problem import Problem, Strain
from palpate.validation.case import Case
from palpate.validation.peers import board_words as words
from palpate.validation.peers.bench import describe_machine
from palpate.validation.peers.board import Board
from palpate.validation.peers.board_causes_plot import causes_svg
from palpate.validation.peers.board_judge import CAUSES, Score
from palpate.validation.peers.board_runs import Status
from palpate.validation.peers.registry import Peer
from palpate.validation.quoting import for_json, for_markdown, visible
from palpate.validation.report.html import page_environment
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
    "smallest_det_f": ".4g", "method": "", "why": "", "date": "",
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
        words.percent, words.seconds, words.memory, words.minutes, words.outcome, words.kind,
        words.hint, words.said, words.need, words.bar, words.reason,
    ):  # fmt: skip
        environment.globals[word.__name__] = word
    environment.globals["version_of_entry"] = version_of_entry
    common = {
        "board": board,
        "machine": describe_machine(),
        "palpate": version_of("palpate"),
        "command": COMMAND,
        "took": minutes_of(board),
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
    """A row for each simulator and case."""
    rows = [
        _row(entry, board.score(entry, case)) for entry in board.entries for case in board.cases
    ]
    return Table("Scores", _COLUMNS, rows)


def _row(entry: Peer, score: Score) -> Sequence[Any]:
    run = score.run
    return [
        entry.name, run.case, run.status.value, score.verdict.value, score.law.value,
        str(run.says.get("version", "")), score.metric, score.distance, score.bar, score.limit,
        score.same_mesh, *(score.causes.get(cause) for cause in CAUSES), score.follows,
        score.law_apart, words.said(score, "seconds"), run.seconds or None,
        words.said(score, "peak_memory_mb"), score.smallest_det_f,
        visible(str(run.says.get("method", ""))), visible(score.why), run.date,
    ]  # fmt: skip


def document(board: Board, table: Table) -> dict[str, Any]:
    """Everything, as plain data."""
    truths = [
        {
            "case": name,
            "law": law.value,
            "why": truth.why,
            "origin": "" if truth.references is None else truth.references.origin,
            "seconds": truth.seconds or None,
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
        "machine": describe_machine(),
        "simulators": [entry.model_dump(mode="json") for entry in board.entries],
        "absent": [entry.name for entry in board.absent],
        "cases": [{"name": case.path.stem, "title": case.title} for case in board.cases],
        "truths": truths,
        "scores": table.records,
    }


def minutes_of(board: Board) -> dict[str, float]:
    """What runs and truths solved here took by the clock, whenever that was, one after the other.

    Failures by time count with the time limit; what is refused, not at all.
    """
    runs = [score.run for score in board.scores.values()]
    waited = sum("no answer within" in run.why for run in runs) * board.time_limit
    return {
        "runs": (sum(run.seconds for run in runs) + waited) / 60.0,
        "truths": sum(truth.seconds for truth in board.truths.values()) / 60.0,
    }


def version_of_entry(entry: Peer, board: Board) -> str:
    """As it says itself, of any run."""
    said = (score.run.says.get("version") for score in board.of_entry(entry))
    return visible(str(next(filter(None, said), "–")))


def entry_row(entry: Peer, board: Board) -> dict[str, Any]:
    """A simulator in one line."""
    scores = board.of_entry(entry)
    answered = [score for score in scores if score.run.status is Status.ANSWERED]
    verdicts = [score.verdict for score in scores if score.limit is not None]
    memories = [m for s in answered if (m := words.said(s, "peak_memory_mb")) is not None]
    return {
        "entry": entry,
        "version": version_of_entry(entry, board),
        "answered": len(answered),
        "failed": sum(score.run.status is Status.FAILED for score in scores),
        "not_posed": sum(score.run.status is Status.NOT_POSED for score in scores),
        "within": verdicts.count(Verdict.PASSED),
        "asked": len([v for v in verdicts if v is not Verdict.SKIPPED]),
        "median": words.median_distance(answered),
        "seconds": sum(words.said(score, "seconds") or 0.0 for score in answered) or None,
        "memory": max(memories, default=None),
    }


def about_case(problem: Problem, strain: Strain) -> str:
    """What is asked of a body, in a sentence."""
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
    """One line a simulator, for a README."""
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
            words.percent(row["median"]),
            words.seconds(row["seconds"]),
            words.memory(row["memory"]),
        ]
        lines.append(f"| {' | '.join(map(for_markdown, cells))} |")
    return "\n".join(lines) + "\n"


def cases_posed(board: Board) -> list[Case]:
    """Those that somebody's simulator answered."""
    return [
        case
        for case in board.cases
        if any(
            score.run.status is Status.ANSWERED and entry.is_outside
            for entry, score in zip(board.entries, board.of_case(case), strict=True)
        )
    ]
