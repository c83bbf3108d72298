"""The command line: `palpate ...`. It only calls what can be called from Python."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.validation.commands import reference as reference_cli
from palpate.validation.commands.audit import audit
from palpate.validation.commands.bench import bench
from palpate.validation.commands.exchange import compare, export
from palpate.validation.commands.mesh import mesh
from palpate.validation.commands.progress_lines import progress_lines
from palpate.validation.simulators import Fault
from palpate.validation.simulators.outside import DEFAULT_TIME_LIMIT

# Exit codes, the same for every verb (README).
USAGE, INTERNAL = 2, 4

app = typer.Typer(
    name="palpate",
    help="Judge fast soft-tissue simulators against a FEniCSx reference.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(reference_cli.app, name="reference")

Cases = Annotated[list[str], typer.Argument(help="built-in names, or paths to .toml files")]
OptionalCases = Annotated[
    list[str] | None, typer.Argument(help="built-in names, or paths to .toml files")
]
Folder = Annotated[Path, typer.Option("--output", "-o", help="folder for the results")]
OptionalFile = Annotated[Path | None, typer.Option()]
Command = Annotated[
    str | None, typer.Option(help='judge another simulator: "mysim {case} {result}"')
]
TimeLimit = Annotated[float, typer.Option(help="of the simulator, in seconds")]


class Simulator(StrEnum):
    """Who solves."""

    FASTSIM = "fastsim"
    REFERENCE = "reference"


@app.command()
def cases() -> None:
    """List the built-in cases, one line each."""
    from palpate.validation.case import builtin_cases, load_case

    for name in builtin_cases():
        print(f"{name:12} {load_case(name).title}")


app.command()(mesh)
app.command()(export)
app.command()(compare)
app.command()(audit)


@app.command()
def solve(
    case: Annotated[str, typer.Argument(help="built-in name, or path to a .toml file")],
    output: Annotated[Path, typer.Option("--output", "-o", help=".vtu or .vtk")],
    simulator: Annotated[Simulator, typer.Option("--with")] = Simulator.FASTSIM,
    strain: Annotated[Strain | None, typer.Option(help="default: the case's")] = None,
    degree: Annotated[int, typer.Option(min=1, max=2, help="of the reference")] = 1,
) -> None:
    """Solve a case and write the displacement."""
    from palpate.meshes.files import MESH_SUFFIXES, write_mesh
    from palpate.validation.case import load_case
    from palpate.validation.references.sets import solve_state
    from palpate.validation.simulators import CandidateFailedError, run_fastsim

    if output.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{output}: unknown kind; use {', '.join(MESH_SUFFIXES)}")
    loaded = load_case(case)
    problem, used, progress = loaded.problem, strain or loaded.strain, progress_lines()
    if simulator is Simulator.FASTSIM:
        try:
            displacement = run_fastsim(problem, used, progress).displacement
        except CandidateFailedError as error:
            print(f"palpate: {error}", file=sys.stderr)
            raise typer.Exit(1) from error
    else:
        displacement = solve_state(problem, used, degree, progress).displacement
    write_mesh(output, problem.mesh, point_data={"displacement": displacement})
    print(f"{output}: displacement [m] of {problem.mesh.num_points} points, {used} strain")


@app.command()
def gate(
    names: OptionalCases = None,
    json: OptionalFile = None,
    junit: OptionalFile = None,
    summary: OptionalFile = None,
    live: Annotated[bool, typer.Option(help="solve the reference here")] = False,
    fault: Annotated[Fault, typer.Option(help="seed a fault, to see the gate go red")] = Fault.NONE,
    simulator: Command = None,
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    metamorphic: Annotated[
        bool, typer.Option(help="judge by relations that need no reference")
    ] = False,
    self_test: Annotated[bool, typer.Option(help="seed faults; the gate must go red")] = False,
    quick: Annotated[bool, typer.Option(help="a few small cases, in seconds")] = False,
    every: Annotated[bool, typer.Option("--all", help="every built-in case")] = False,
    since: Annotated[
        Path | None, typer.Option(help="an accepted results.json: tell what changed")
    ] = None,
) -> None:
    """Judge fastsim, or another simulator, on cases; the exit code is the verdict."""
    from palpate.meshes.atomic_write import write_text_atomically
    from palpate.validation.case import QUICK, builtin_cases, load_case
    from palpate.validation.evidence.metamorphic import judge_relations
    from palpate.validation.evidence.self_test import run_self_test
    from palpate.validation.judging import outputs
    from palpate.validation.judging.annotations import github_annotations
    from palpate.validation.judging.judge import exit_code, judge_case
    from palpate.validation.judging.result_changes import read_accepted, with_changes
    from palpate.validation.simulators.candidate import candidate_for

    candidate = candidate_for(simulator, time_limit, fault)
    accepted = read_accepted(since) if since else None
    if self_test + quick + every + bool(names) != 1:
        raise InputError("name the cases, or say one of --quick, --all and --self-test")
    chosen = QUICK if quick else builtin_cases() if every else names or ()
    loaded = [load_case(name) for name in chosen]
    progress = progress_lines()
    if self_test:
        results = [run_self_test(progress)]
    elif metamorphic:
        results = [judge_relations(case, candidate, progress) for case in loaded]
    else:
        results = [judge_case(c, live=live, candidate=candidate, progress=progress) for c in loaded]
    if accepted is not None:
        results = with_changes(results, accepted)
    texts = {
        json: outputs.results_json(results, _version()),
        junit: outputs.junit_xml(results),
        summary: outputs.summary_markdown(results),
    }
    for path, text in texts.items():
        if path is not None:
            write_text_atomically(path, text)
    outputs.print_results(results, Console(highlight=False))
    if os.environ.get("GITHUB_ACTIONS") == "true":
        print("\n".join(github_annotations(results)))
    raise typer.Exit(exit_code(results))


@app.command()
def report(
    output: Folder,
    names: OptionalCases = None,
    every: Annotated[bool, typer.Option("--all", help="every built-in case, and an index")] = False,
    simulator: Command = None,
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    pdf: Annotated[bool, typer.Option(help="print the pages as PDF too; needs Chromium")] = False,
) -> None:
    """Solve with both, judge, and write the report with everything beside it.

    One case gives report.html; several give a page each, and index.html.
    """
    from palpate.validation.case import builtin_cases, load_case
    from palpate.validation.judging import outputs
    from palpate.validation.judging.judge import exit_code, judge_case
    from palpate.validation.report.html import write_report
    from palpate.validation.report.pdf import print_pdf, require_browser
    from palpate.validation.run_folder import MARK, run_folder
    from palpate.validation.simulators.candidate import candidate_for

    if every == bool(names):
        raise InputError("name the cases, or say --all for every built-in one")
    if pdf:
        require_browser()
    loaded = [load_case(name) for name in names or builtin_cases()]
    twice = {case.name for case in loaded if sum(c.name == case.name for c in loaded) > 1}
    if twice:
        raise InputError(f"more than one case is called {sorted(twice)[0]!r}; rename a file")
    progress = progress_lines()
    candidate = candidate_for(simulator, time_limit)
    results = [judge_case(c, live=True, candidate=candidate, progress=progress) for c in loaded]
    with run_folder(output) as fresh:
        progress("drawing the report")
        page = write_report(results, fresh)
        if pdf:
            for written in sorted(fresh.glob("*.html")):
                print_pdf(written)
        (fresh / "junit.xml").write_text(outputs.junit_xml(results), encoding="utf-8")
        (fresh / "summary.md").write_text(outputs.summary_markdown(results), encoding="utf-8")
        (fresh / MARK).write_text(outputs.results_json(results, _version()), encoding="utf-8")
    outputs.print_results(results, Console(highlight=False))
    print(f"{output / page.name}")
    raise typer.Exit(exit_code(results))


@app.command()
def study(
    name: Annotated[
        str,
        typer.Argument(
            help="meshing, beam, kidney, contact, csm3, grading, iterations, "
            "validity, convergence, sensitivity"
        ),
    ],
    output: Folder,
) -> None:
    """Remake a study of the paper: meshing (Fig. 1), beam (Fig. 2), kidney (Fig. 5, Table I)..."""
    from palpate.validation.run_folder import run_folder
    from palpate.validation.studies import run_study

    progress = progress_lines()
    with run_folder(output) as fresh:
        code = run_study(name, fresh, progress, Console(highlight=False))
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)


app.command()(bench)


def _version() -> str:
    from importlib import metadata

    try:
        return metadata.version("palpate")
    except metadata.PackageNotFoundError:
        return "sources in place"


def main() -> None:
    """Run the command line; every end has its exit code, and no traceback looks like a verdict.

    Under mpirun the first process does; the others do their share of what it solves.
    """
    from palpate.reference import ranks

    if ranks.is_follower():
        sys.exit(ranks.follow())
    try:
        _lead()
    finally:
        ranks.dismiss()


def _lead() -> None:
    try:
        code = app(standalone_mode=False)
        sys.exit(code if isinstance(code, int) else 0)
    except (KeyboardInterrupt, typer.Abort):
        print("palpate: stopped; nothing half-written was left", file=sys.stderr)
        sys.exit(130)
    except InputError as error:
        print(f"palpate: {error}", file=sys.stderr)
        sys.exit(USAGE)
    except OSError as error:
        print(f"palpate: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        sys.exit(USAGE)
    except Exception as error:
        sys.exit(_other_end(error))


def _other_end(error: Exception) -> int:
    """Usage errors of the command line, a reference that failed, or an error of palpate's own."""
    # typer brings its own copy of click or the real one: known by what they can do.
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        print(f"palpate: {error.format_message()}", file=sys.stderr)
        return USAGE
    from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError

    if isinstance(error, ReferenceUnavailableError):
        print(f"palpate: {error}", file=sys.stderr)
        return USAGE
    if isinstance(error, ReferenceFailedError):
        print(f"palpate: {error}", file=sys.stderr)
        return 3
    handle, name = tempfile.mkstemp(prefix="palpate-error-", suffix=".txt", text=True)
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        traceback.print_exception(error, file=stream)
    print(f"palpate: internal error: {type(error).__name__}: {error} ({name})", file=sys.stderr)
    return INTERNAL


if __name__ == "__main__":
    main()
