"""`palpate study|sweep|touch|bench|scoreboard`: what shows how far simulators and results reach."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.candidates.outside import DEFAULT_TIME_LIMIT, OutsideSimulator
from palpate.validation.commands.options import (
    AskedIntegrator,
    ChosenElements,
    Device,
    Folder,
    Force,
    NearTool,
    NearToolEdge,
    OneCase,
    OptionalCases,
    TimeLimit,
    is_condensed,
    near_tool_metres,
    print_lines,
    progress_lines,
)
from palpate.validation.quoting import listed
from palpate.validation.solving import Simulator
from palpate.validation.states import Elements
from palpate.validation.studies import STUDIES

# Keys that are stated once, under the table of a benchmark.
_STATED_ONCE = ("version", "rate_unit")
# Time limit of a run of the scoreboard [s]: with it two simulators that fail slowly on sixteen
# cases take 24 minutes of two cores.
_TIME_LIMIT = 90.0


def study(
    name: Annotated[
        str,
        typer.Argument(
            help="one of those below",
            autocompletion=lambda incomplete: [s for s in STUDIES if s.startswith(incomplete)],
        ),
    ],
    output: Folder,
) -> None:
    """Remake a study of the paper, or one of what the results depend on."""
    from palpate.validation.run_folder import run_folder
    from palpate.validation.studies import run_study

    progress = progress_lines()
    with run_folder(output) as fresh:
        code = run_study(name, fresh, progress, Console(highlight=False))
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)


study.__doc__ = f"{study.__doc__}\n\n{listed('Studies:', STUDIES.items())}"


def sweep(
    case: OneCase,
    output: Folder,
    vary: Annotated[
        list[str],
        typer.Option(
            help="KEY=FIRST:LAST:COUNT or KEY=VALUE,...; load[0].factor scales; for "
            "--simulator with {iterations}: iterations and time_step"
        ),
    ],
    with_: Annotated[
        Simulator, typer.Option("--with", help="reference, or condensed: solved by it as well")
    ] = Simulator.FASTSIM,
    simulator: Annotated[
        str | None,
        typer.Option(
            help='"mysim {case} {result}" beside fastsim; with {iterations} its error over these'
        ),
    ] = None,
    integrator: AskedIntegrator = None,
    limit: Annotated[
        float, typer.Option(help="of --simulator's error over its displacement: has it converged?")
    ] = 0.01,
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    element: Annotated[
        Elements, typer.Option(help="of the tetrahedra; both: beside one another")
    ] = Elements.LINEAR,
    device: Device = "cpu",
    jobs: Annotated[int, typer.Option(min=1, help="runs at a time, on this machine")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="ADDRESS of a dask scheduler, whose workers solve instead")
    ] = None,
) -> None:
    """Solve a case with other values: a table, figures, and a page; says where equilibrium ends."""
    from palpate.reference.availability import require_available
    from palpate.validation.case import load_case
    from palpate.validation.case.variants import read_axis
    from palpate.validation.output_files import input_files
    from palpate.validation.run_folder import require_run_folder, run_folder
    from palpate.validation.studies.sweep import sweep as run_sweep

    if scheduler is not None and jobs > 1:
        raise InputError("--jobs is for this machine: give it or --scheduler, not both")
    if device != "cpu" and jobs > 1:
        raise InputError("--device does one run at a time: leave out --jobs")
    loaded = load_case(case)
    inputs = input_files([loaded], command=simulator)
    require_run_folder(output, inputs=inputs)
    is_fastsims = element is not Elements.LINEAR or device != "cpu" or scheduler
    if simulator is not None and (is_fastsims or with_ is not Simulator.FASTSIM):
        raise InputError("--simulator takes no --element, --device, --with or --scheduler")
    if simulator is not None and "{iterations}" in simulator:
        from palpate.validation.studies.sweep_iterations import read_moves, sweep_iterations

        iterations, steps = read_moves(vary)
        program = OutsideSimulator(simulator, time_limit, iterations[0])
        require_available()
        with run_folder(output, inputs=inputs) as fresh:
            code = sweep_iterations(
                loaded,
                program,
                iterations,
                steps,
                fresh,
                Console(highlight=False),
                integrator=integrator,
                limit=limit,
                progress=progress_lines(),
            )
        print(f"{output / 'report.html'}")
        raise typer.Exit(code)
    if integrator is not None:
        raise InputError("--integrator is of another simulator: give --simulator with {iterations}")
    if any(words.partition("=")[0].strip() == "iterations" for words in vary):
        raise InputError('--vary iterations: give --simulator "mysim {case} {result} {iterations}"')
    outside = [] if simulator is None else [OutsideSimulator(simulator, time_limit)]
    axes = [read_axis(words, loaded) for words in vary]
    if with_ is Simulator.REFERENCE and scheduler is None:
        require_available()
    with run_folder(output, inputs=inputs) as fresh:
        code = run_sweep(
            loaded,
            axes,
            fresh,
            Console(highlight=False),
            simulators=[*dict.fromkeys((Simulator.FASTSIM, with_)), *outside],
            elements=element.each,
            device=device,
            jobs=jobs,
            scheduler=scheduler,
            progress=progress_lines(),
        )
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)


def touch(
    case: OneCase,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="folder for recordings and what is judged")
    ] = Path("out/touch"),
    element: ChosenElements = None,
    engine: Annotated[
        Simulator,
        typer.Option("--with", help="condensed: its condensed linear model in a pane besides"),
    ] = Simulator.FASTSIM,
    loads: Annotated[bool, typer.Option(help="begin with the case's own loads")] = False,
    tool: Annotated[
        str | None, typer.Option(help="sphere, capsule, or a closed surface beside the case")
    ] = None,
    radius: Annotated[
        float | None, typer.Option(help="of the sphere or the capsule, in the case's unit")
    ] = None,
    near_tool: NearTool = False,
    near_tool_edge: NearToolEdge = None,
    damping: Annotated[
        float | None, typer.Option(help="mass damping [1/s]; default: the case's")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: a free one")] = 0,
    browser: Annotated[bool, typer.Option(help="open the page")] = True,
    wait: Annotated[
        float,
        typer.Option(min=0, help="for a page that was closed [s], then end; inf: until Ctrl-C"),
    ] = 60.0,
) -> None:
    """Show a body on a local page and touch it: linear beside Green strain, in real time.

    The page is for this machine and one window: it has a token in its address, and a second one is
    refused. Without a page the bodies stand still. All ends a while after the page was closed, or
    by Ctrl-C. Needs the extra `touch`.
    """
    import contextlib
    import math

    from palpate.validation.case import load_case
    from palpate.validation.live.live_case import Touch, tool_table
    from palpate.validation.live.near_touch import near_touch
    from palpate.validation.live.opening import opened
    from palpate.validation.live.panes import condensed_words
    from palpate.validation.live.server import PageServer
    from palpate.validation.states import Elements

    loaded = load_case(case)
    progress_lines()(f"reading and meshing {loaded.name}")
    touched = Touch(tool_table(loaded, tool, radius), loads, damping, is_condensed(engine))
    edge = near_tool_metres(near_tool_edge)
    if near_tool or edge is not None:
        loaded, touched = near_touch(loaded, touched, edge)
        progress_lines()(loaded.mesh.origin)
    elements = (Elements.LINEAR if element is None else element).each
    if touched.is_condensed:
        progress_lines()(condensed_words(loaded.problem, elements[0]))
    server = PageServer(loaded, touched, elements, folder=output, patience=wait, port=port)

    ends = "Ctrl-C ends it."
    if math.isfinite(wait):
        ends = f"It ends {wait:g} s after the page was closed, or by Ctrl-C."

    def ready(address: str) -> None:
        print(f"touch {loaded.name} at {address}", flush=True)
        print(ends, flush=True)
        if browser:
            ends_with_server.enter_context(opened(address, output))

    with contextlib.ExitStack() as ends_with_server:
        server.serve(ready)


def bench(
    name: Annotated[
        str,
        typer.Argument(help="steps, static, truth, delaunay, mesh, collision, touch or condensed"),
    ],
    json: Annotated[Path | None, typer.Option(help="file for the rows")] = None,
    size: Annotated[list[int] | None, typer.Option(help="only this size; repeatable")] = None,
    device: Annotated[
        str, typer.Option(help="of steps: ours on cuda:0 or warp:cpu as well, beside its core")
    ] = "cpu",
    force: Force = False,
) -> None:
    """Time palpate beside the rivals that are installed, in one run.

    PALPATE_BENCH_PYTHON names more interpreters, separated like PATH, whose rivals are timed too.
    """
    from palpate.meshes.own_files import write_own_text
    from palpate.validation.output_files import require_outputs
    from palpate.validation.peers.bench import bench_json, run_benchmark

    require_outputs({"--json": json}, force=force)
    console = Console(stderr=True, highlight=False, markup=False)
    document = run_benchmark(
        name,
        sizes=size,
        device=device,
        progress=lambda line: console.print(f"  {line}", style="dim", soft_wrap=True),
    )
    if json is not None:
        write_own_text(json, bench_json(document))
    out = Console(highlight=False)
    # A file or a pipe has no width of its own, and 80 columns would truncate every number.
    print_bench(document, out if out.is_terminal else Console(highlight=False, width=200))


def print_bench(document: dict[str, Any], console: Console) -> None:
    """Print the rows, and one line each for versions, machine and rivals left out."""
    from palpate.validation.peers.bench import COMMON

    rows = document["rows"]
    present = dict.fromkeys(key for row in rows for key in row)
    wanted = document.get("table") or [key for key in present if key not in _STATED_ONCE]
    columns = [*COMMON, *(key for key in wanted if key in present and key not in COMMON)]
    if len({(row["tool"], row.get("version")) for row in rows}) > len({r["tool"] for r in rows}):
        columns.insert(1, "version")  # a tool has rows in two versions
    table = Table(title=f"bench {document['bench']}", title_justify="left")
    for column in columns:
        is_text = any(isinstance(row.get(column), str) for row in rows)
        table.add_column(column, justify="left" if is_text else "right")
    for row in rows:
        table.add_row(*(_shown(column, row.get(column)) for column in columns))
    console.print(table)
    for line in document.get("summary", ()):
        console.print(line, markup=False, soft_wrap=True)
    versions = sorted({f"{row['tool']} {row['version']}" for row in rows if row.get("version")})
    for line in (
        "rate: " + ", ".join(sorted({row["rate_unit"] for row in rows})),
        "versions: " + ", ".join(versions),
        "machine: " + ", ".join(f"{k} {v}" for k, v in document["machine"].items()),
        *(f"left out: {tool}, {how}" for tool, how in document["left_out"].items()),
    ):
        console.print(line, markup=False, soft_wrap=True)


def _shown(column: str, value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.7g}" if column.endswith("displacement") else f"{value:.4g}"
    return str(value)


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
    time_limit: Annotated[float, typer.Option(help="of one run, in seconds")] = _TIME_LIMIT,
    processes: Annotated[
        int | None, typer.Option(help="how many at once; default: as many as there are cores")
    ] = None,
    cached: Annotated[
        Path | None,
        typer.Option(
            help="folder of results of earlier calls, as DIR-runs: unchanged ones are used"
        ),
    ] = None,
) -> None:
    """Run every simulator that is installed on every case, each under its own law.

    Results are written to DIR-runs, or to the folder of --cached. They are used again where that is
    asked for and case, law, time limit and all that made them (palpate, adapter, interpreter with
    its modules, program, system) are as they were; those of --simulator never are. What is cached
    is shown with its date.
    PALPATE_BENCH_PYTHON names more interpreters that have simulators, separated like PATH.
    """
    from palpate.validation.cached_results import ResultCache
    from palpate.validation.case import builtin_cases, load_cases
    from palpate.validation.output_files import input_files
    from palpate.validation.peers.board import compute_board
    from palpate.validation.peers.board_page import words_on_cached, write_board
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
    if cached is not None and not cached.is_dir():
        raise InputError(f"--cached {cached}: no folder of results; leave it out to run everything")
    folder = cached or output.with_name(f"{output.name}-runs")
    board = compute_board(
        everybody,
        cases,
        ResultCache(folder, is_read=cached is not None),
        time_limit=time_limit,
        progress=progress_lines(),
        processes=processes,
    )
    with run_folder(output, inputs=inputs) as fresh:
        page = write_board(board, fresh)
    said = words_on_cached(board)
    print_lines([*([said] if said else []), str(output / page.name)])
