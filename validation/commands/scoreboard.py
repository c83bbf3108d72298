"""`palpate scoreboard -o DIR`: who is how far off, and is it the law, the mesh or the solver?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.commands.words import Folder, OptionalCases, progress_lines
from palpate.validation.quoting import for_terminal

# Of a run [s]: two that fail slowly on sixteen cases take 24 minutes of two cores then.
TIME_LIMIT = 90.0


def scoreboard(
    output: Folder,
    names: OptionalCases = None,
    entry: Annotated[
        list[str] | None, typer.Option(help="only this simulator; repeatable; see the page")
    ] = None,
    simulator: Annotated[
        str | None, typer.Option(help='your own beside them: "mysim {case} {result}"')
    ] = None,
    law: Annotated[Law, typer.Option(help="of your own")] = Law.SAINT_VENANT_KIRCHHOFF,
    time_limit: Annotated[float, typer.Option(help="of one run, in seconds")] = TIME_LIMIT,
    processes: Annotated[
        int | None, typer.Option(help="how many at once; default: as many as there are cores")
    ] = None,
    kept: Annotated[
        Path | None, typer.Option(help="folder of answers and truths; default: DIR-runs")
    ] = None,
) -> None:
    """Run every simulator that is installed on every case, each under its own law.

    Answers are kept in DIR-runs, by all that they hang on: case, law, adapter, versions, time
    limit. A second call only computes what is missing there.
    PALPATE_BENCH_PYTHON names more interpreters that have simulators, separated like PATH.
    """
    from palpate.validation.candidates.outside import OutsideSimulator
    from palpate.validation.case import builtin_cases, load_cases
    from palpate.validation.output_files import input_files
    from palpate.validation.peers.board import compute_board
    from palpate.validation.peers.board_page import write_board
    from palpate.validation.peers.board_runs import Cache
    from palpate.validation.peers.registry import Peer, peers_on_board
    from palpate.validation.run_folder import require_run_folder, run_folder

    everybody = peers_on_board(entry)
    if simulator is not None:
        program = OutsideSimulator(simulator, time_limit)
        mine = Peer(name="mine", title=program.name, law=law, command=simulator)
        everybody = (*everybody, mine)
    if not time_limit > 0.0:
        raise InputError(f"--time-limit {time_limit:g}: needs a value above 0")
    if processes is not None and processes < 1:
        raise InputError(f"--processes {processes}: needs at least 1")
    cases = load_cases(names or builtin_cases())
    inputs = input_files(cases, command=simulator)
    require_run_folder(output, inputs=inputs)
    folder = kept or output.with_name(f"{output.name}-runs")
    board = compute_board(
        everybody,
        cases,
        Cache(folder),
        time_limit=time_limit,
        progress=progress_lines(),
        processes=processes,
    )
    with run_folder(output, inputs=inputs) as fresh:
        page = write_board(board, fresh)
    print(for_terminal(str(output / page.name)))
