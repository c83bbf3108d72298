"""`palpate report`: solve with both, judge, and leave a folder with the pages."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.validation.candidates.outside import DEFAULT_TIME_LIMIT
from palpate.validation.commands.gate import require_builtin, tell_unexpected
from palpate.validation.commands.words import (
    AskedTimeStep,
    ChosenElements,
    ChosenEngine,
    Folder,
    GrantedPrecision,
    OptionalCases,
    SimulatorCommand,
    StatedIntegrator,
    TimeLimit,
    ToldIterations,
    is_condensed,
    progress_lines,
)
from palpate.validation.report import FigureForm
from palpate.validation.solving import Simulator


def report(
    output: Folder,
    names: OptionalCases = None,
    every: Annotated[bool, typer.Option("--all", help="every built-in case, and an index")] = False,
    element: ChosenElements = None,
    with_: ChosenEngine = Simulator.FASTSIM,
    simulator: SimulatorCommand = None,
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    integrator: StatedIntegrator = None,
    time_step: AskedTimeStep = None,
    iterations: ToldIterations = None,
    precision: GrantedPrecision = None,
    expected: Annotated[
        bool, typer.Option(help="1 where a built-in verdict is not the one expected of fastsim")
    ] = False,
    pdf: Annotated[bool, typer.Option(help="print the pages as PDF too; needs Chromium")] = False,
    figures: Annotated[
        FigureForm | None, typer.Option(help="each figure for a paper too, in a column's width")
    ] = None,
) -> None:
    """Solve with both, judge, and write the report with everything beside it.

    One case gives report.html; several give a page each, and index.html.
    """
    from palpate.validation.candidates.candidate import candidates_for
    from palpate.validation.case import builtin_cases, load_cases
    from palpate.validation.judging import outputs
    from palpate.validation.judging.expectation import read_expected, unexpected
    from palpate.validation.judging.judge import exit_code, judge_case, suitable_cases
    from palpate.validation.output_files import input_files
    from palpate.validation.report.html import write_report
    from palpate.validation.report.pdf import print_pdf, require_browser
    from palpate.validation.run_folder import RESULTS, require_run_folder, run_folder

    if every == bool(names):
        raise InputError("name the cases, or say --all for every built-in one")
    if expected and (simulator or with_ is not Simulator.FASTSIM):
        raise InputError(
            "--expected is about fastsim's verdicts: it takes no --simulator or --with"
        )
    known = read_expected() if expected else {}
    if pdf:
        require_browser()
    loaded = load_cases(names or builtin_cases())
    if expected:
        require_builtin(loaded)
    if len(loaded) > 1 and any(case.name == "index" for case in loaded):
        raise InputError("with several cases index.html is the first page; rename case 'index'")
    inputs = input_files(loaded, command=simulator)
    require_run_folder(output, inputs=inputs)
    progress = progress_lines()
    candidates = candidates_for(
        simulator,
        time_limit,
        element,
        integrator=integrator,
        time_step=time_step,
        iterations=iterations,
        is_condensed=is_condensed(with_),
    )
    if every:
        loaded = suitable_cases(loaded, candidates, progress)
    results = [
        judge_case(c, live=True, candidate=candidates, precision=precision, progress=progress)
        for c in loaded
    ]
    with run_folder(output, inputs=inputs) as fresh:
        progress("drawing the report")
        page = write_report(results, fresh, figures=figures)
        if pdf:
            for written in sorted(fresh.glob("*.html")):
                print_pdf(written)
        outputs.write_outputs(
            results,
            json=fresh / RESULTS,
            junit=fresh / "junit.xml",
            summary=fresh / "summary.md",
        )
    outputs.print_results(results, Console(highlight=False))
    print(f"{output / page.name}")
    if expected:
        raise typer.Exit(tell_unexpected(unexpected(results, known), len(results)))
    raise typer.Exit(exit_code(results))
