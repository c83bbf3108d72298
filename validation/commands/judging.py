"""`palpate gate|report|compare|compare-runs`: commands whose exit code is a verdict."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.candidates.faults import Fault
from palpate.validation.candidates.outside import DEFAULT_TIME_LIMIT
from palpate.validation.commands.options import (
    AskedContact,
    AskedIntegrator,
    AskedLaws,
    AskedTimeStep,
    ChosenElements,
    ChosenEngine,
    Device,
    ElementOfResult,
    Expected,
    Folder,
    Force,
    GrantedPrecision,
    Live,
    NearTool,
    NearToolEdge,
    OneCase,
    OptionalCases,
    OptionalFile,
    ResultFile,
    SimulatorCommand,
    TimeLimit,
    ToldIterations,
    is_condensed,
    near_tool_metres,
    print_lines,
    progress_lines,
)
from palpate.validation.quoting import for_terminal, listed
from palpate.validation.report import FigureForm
from palpate.validation.solving import Simulator
from palpate.validation.states import ExitCode, Precision

if TYPE_CHECKING:
    from palpate.meshes.rigid_tool import ContactRule
    from palpate.validation.case import Case
    from palpate.validation.judging.results import CaseResult
    from palpate.validation.report.trust import Trust


def gate(
    names: OptionalCases = None,
    json: OptionalFile = None,
    junit: OptionalFile = None,
    summary: OptionalFile = None,
    live: Live = False,
    fault: Annotated[
        Fault, typer.Option(metavar="FAULT", help="seed one of those above: the gate goes red")
    ] = Fault.NONE,
    element: ChosenElements = None,
    with_: ChosenEngine = Simulator.FASTSIM,
    simulator: SimulatorCommand = None,
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    versus: Annotated[
        str | None,
        typer.Option(
            help="compare it with this simulator, or build of it, without a reference; fastsim: "
            "its compiled core"
        ),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=VALUE", help="of --versus; default: those on the same mesh"),
    ] = None,
    law: AskedLaws = None,
    contact: AskedContact = None,
    integrator: AskedIntegrator = None,
    time_step: AskedTimeStep = None,
    iterations: ToldIterations = None,
    precision: GrantedPrecision = None,
    device: Device = "cpu",
    near_tool: NearTool = False,
    near_tool_edge: NearToolEdge = None,
    metamorphic: Annotated[
        bool, typer.Option(help="judge by relations that need no reference")
    ] = False,
    self_test: Annotated[
        bool, typer.Option(help="seed faults, on the named cases or all; the gate must go red")
    ] = False,
    quick: Annotated[bool, typer.Option(help="a few small cases, in seconds")] = False,
    every: Annotated[bool, typer.Option("--all", help="every built-in case")] = False,
    expected: Expected = False,
    record_expected: Annotated[
        bool, typer.Option("--record-expected", help="keep these verdicts as the expected ones")
    ] = False,
    force: Force = False,
) -> None:
    """Judge fastsim, or another simulator, on cases; the exit code is the verdict."""
    from palpate.meshes.temporaries import write_text_atomically
    from palpate.validation.candidates.candidate import candidates_for
    from palpate.validation.candidates.faults import with_fault
    from palpate.validation.case import QUICK, builtin_cases, load_cases
    from palpate.validation.judging import expectation, outputs
    from palpate.validation.judging.case_references import is_to_be_solved
    from palpate.validation.judging.judge import (
        judge_case,
        judge_cases,
        judge_or_say_why,
        suitable_cases,
    )
    from palpate.validation.judging.metamorphic import judge_relations
    from palpate.validation.judging.results import merge_candidates
    from palpate.validation.judging.self_test import run_self_test
    from palpate.validation.judging.versus import judge_versus, other_candidate, read_limits
    from palpate.validation.output_files import input_files, require_outputs

    outputs.discard_outputs(json, junit, summary, of_gates=True)  # also where this is refused
    # A device computes its steps in single precision where that is granted.
    is_single = device != "cpu" and precision is Precision.SINGLE
    given = candidates_for(
        simulator,
        time_limit,
        element,
        integrator=integrator,
        time_step=time_step,
        iterations=iterations,
        device=device,
        precision=Precision.SINGLE if is_single else Precision.DOUBLE,
        is_condensed=is_condensed(with_),
    )
    candidates = [with_fault(candidate, fault) for candidate in given]
    num_choices = quick + every + bool(names)
    is_expected = expected or record_expected
    for is_wrong, why in (
        (
            num_choices > 1 or (num_choices == 0 and not self_test),
            "name the cases, or say one of --quick, --all and --self-test",
        ),
        (
            self_test and (fault is not Fault.NONE or metamorphic or live),
            "--self-test seeds every fault by itself; it takes no --fault, --metamorphic or --live",
        ),
        (
            is_expected and (self_test or metamorphic or simulator),
            "--expected is about fastsim's verdicts on built-in cases: it takes no --simulator, "
            "--metamorphic or --self-test",
        ),
        (
            versus is None and limit,
            "--limit goes with --versus; the limits of a gate stand in its case",
        ),
        (
            versus is not None and (self_test or metamorphic or expected or live or precision),
            "--versus knows no reference: it takes no --self-test, --metamorphic, --expected, "
            "--live or --precision",
        ),
        (
            (law or contact) and (is_expected or self_test or metamorphic),
            "--law and --contact take no --expected, --self-test or --metamorphic",
        ),
        (
            is_expected and (device != "cpu" or with_ is not Simulator.FASTSIM),
            "--expected is about fastsim's core: it takes no --device or --with",
        ),
    ):
        if is_wrong:
            raise InputError(why)
    loaded = load_cases(QUICK if quick else builtin_cases() if every else names or ())
    loaded = _as_asked(
        loaded, law, contact, near_tool=near_tool, near_tool_edge=near_tool_edge,
        is_judged=versus is None,
    )  # fmt: skip
    if is_expected:
        _require_builtin(loaded)
    require_outputs(
        {"--json": json, "--junit": junit, "--summary": summary},
        inputs=input_files(loaded, command=" ".join(filter(None, (simulator, versus)))),
        force=force,
    )
    outputs.discard_outputs(json, junit, summary)
    progress = progress_lines()
    if every or quick:
        loaded = suitable_cases(loaded, candidates, progress)

    def each(judge_one: Callable[[Case], CaseResult]) -> list[CaseResult]:
        return [judge_or_say_why(judge_one, case, candidates) for case in loaded]

    if self_test:
        trials = [run_self_test(progress, cases=loaded, candidate=one) for one in candidates]
        results = [merge_candidates(trials)]
    elif metamorphic:
        results = each(
            lambda c: merge_candidates([judge_relations(c, one, progress) for one in candidates])
        )
    elif versus is not None:
        others = [other_candidate(versus, time_limit, candidate) for candidate in candidates]
        pairs, limits = list(zip(candidates, others, strict=True)), read_limits(limit or [])
        results = each(
            lambda c: merge_candidates(
                [judge_versus(c, *o, limits=limits, progress=progress) for o in pairs]
            )
        )
    elif (
        simulator is None
        and fault is Fault.NONE
        and not (live or any(is_to_be_solved(c) for c in loaded))
    ):
        results = judge_cases(loaded, candidates, precision=precision, progress=progress)
    else:
        results = each(
            lambda c: judge_case(
                c,
                live=live or is_to_be_solved(c),
                candidate=candidates,
                precision=precision,
                progress=progress,
            )
        )
    outputs.print_results(results, Console(highlight=False))  # no full disk takes the verdict away
    outputs.write_outputs(results, json=json, junit=junit, summary=summary)
    if os.environ.get("GITHUB_ACTIONS") == "true":
        print("\n".join(outputs.github_annotations(results)))
    _require_judged(results)
    if record_expected:
        known = expectation.with_results(expectation.read_expected(), results)
        write_text_atomically(expectation.FILE, expectation.expected_toml(known))
        print(expectation.FILE)
    raise typer.Exit(_exit_code(results, expected=expected))


_faults = listed("Faults:", ((fault.value, fault.meaning) for fault in Fault))
gate.__doc__ = f"{gate.__doc__}\n\n{_faults}"


def report(
    output: Folder,
    names: OptionalCases = None,
    every: Annotated[bool, typer.Option("--all", help="every built-in case, and an index")] = False,
    element: ChosenElements = None,
    with_: ChosenEngine = Simulator.FASTSIM,
    simulator: SimulatorCommand = None,
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    law: AskedLaws = None,
    contact: AskedContact = None,
    integrator: AskedIntegrator = None,
    time_step: AskedTimeStep = None,
    iterations: ToldIterations = None,
    precision: GrantedPrecision = None,
    near_tool: NearTool = False,
    near_tool_edge: NearToolEdge = None,
    expected: Expected = False,
    pdf: Annotated[bool, typer.Option(help="print the pages as PDF too; needs Chromium")] = False,
    figures: Annotated[
        FigureForm | None, typer.Option(help="each figure for a paper too, in a column's width")
    ] = None,
) -> None:
    """Solve with both, judge, and write the report with everything beside it.

    One case gives report.html; several give a page each, and index.html. Of several, one that
    cannot be judged is listed with the reason, and the exit code is then 2.
    """
    from palpate.validation.candidates.candidate import candidates_for
    from palpate.validation.case import builtin_cases, load_cases
    from palpate.validation.judging import outputs
    from palpate.validation.judging.case_references import is_truth_stored
    from palpate.validation.judging.judge import judge_case, judge_or_say_why, suitable_cases
    from palpate.validation.output_files import input_files
    from palpate.validation.report.html import write_report
    from palpate.validation.report.pdf import print_pdf, require_browser
    from palpate.validation.report.trust import trust_of
    from palpate.validation.run_folder import RESULTS, require_run_folder, run_folder

    if every == bool(names):
        raise InputError("name the cases, or say --all for every built-in one")
    if expected and (simulator or law or contact or with_ is not Simulator.FASTSIM):
        raise InputError(
            "--expected is about fastsim's verdicts: it takes no --simulator, --with, --law or "
            "--contact"
        )
    if pdf:
        require_browser()
    loaded = _as_asked(
        load_cases(names or builtin_cases()),
        law, contact, near_tool=near_tool, near_tool_edge=near_tool_edge,
    )  # fmt: skip
    if expected:
        _require_builtin(loaded)
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

    def judge_one(one: Case) -> CaseResult:
        return judge_case(
            one,
            live=one.near_tool is None or not is_truth_stored(one),
            candidate=candidates,
            precision=precision,
            progress=progress,
        )

    if len(loaded) == 1:
        results = [judge_one(loaded[0])]
    else:  # one that cannot be judged does not take the others their pages
        results = [judge_or_say_why(judge_one, one, candidates) for one in loaded]
        if not any(result.checks for result in results):
            _require_judged(results)
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
    console = Console(highlight=False)
    outputs.print_results(results, console)
    for result in results if len(results) == 1 else ():  # several: each page answers
        _print_answer(trust_of(result), console)
    print(f"{output / page.name}")
    _require_judged(results)
    raise typer.Exit(_exit_code(results, expected=expected))


def compare(
    case: OneCase,
    result: Annotated[Path, ResultFile],
    json: OptionalFile = None,
    live: Live = False,
    precision: GrantedPrecision = None,
    element: ElementOfResult = None,
    law: Annotated[
        Law | None, typer.Option(help="instead of the case's; the reference is solved here")
    ] = None,
    contact: AskedContact = None,
    integrator: AskedIntegrator = None,
    time_step: AskedTimeStep = None,
    time_limit: Annotated[
        float, typer.Option(help="of the reference by --integrator and --time-step, in seconds")
    ] = DEFAULT_TIME_LIMIT,
    force: Force = False,
) -> None:
    """Judge somebody else's result; the exit code is the verdict."""
    from palpate.validation.candidates.candidate import result_candidate
    from palpate.validation.candidates.equations import AskedSteps
    from palpate.validation.case import load_case
    from palpate.validation.exchange.result_files import read_result, room_for_result
    from palpate.validation.judging import outputs
    from palpate.validation.judging.case_references import is_to_be_solved
    from palpate.validation.judging.judge import exit_code, judge_case
    from palpate.validation.output_files import input_files, require_outputs

    outputs.discard_outputs(json, of_gates=True)
    asked = AskedSteps(integrator, time_step, time_limit)
    (loaded,) = _as_asked([load_case(case)], [law] if law else None, contact)
    require_outputs({"--json": json}, inputs=input_files([loaded], result), force=force)
    # A file that cannot be read is refused before anything is solved.
    read_result(result, most_bytes=room_for_result(loaded.problem))
    judged = judge_case(
        loaded,
        live=live or is_to_be_solved(loaded),
        candidate=result_candidate(result, element, asked),
        precision=precision,
        progress=progress_lines(),
    )
    outputs.print_results([judged], Console(highlight=False))
    outputs.write_outputs([judged], json=json)
    raise typer.Exit(exit_code([judged]))


def compare_runs(
    first: Annotated[Path, typer.Argument(help="results.json of a run")],
    second: Annotated[Path, typer.Argument(help="of another")],
    summary: Annotated[Path | None, typer.Option(help="the table as Markdown")] = None,
    force: Force = False,
) -> None:
    """Put two runs, or two versions, side by side; 1 where the second is worse in anything."""
    from palpate.meshes.own_files import write_own_text
    from palpate.validation.judging import run_comparison
    from palpate.validation.output_files import require_outputs

    require_outputs({"--summary": summary}, inputs=[first, second], force=force)
    compared = run_comparison.compare_runs(first, second)
    names = (str(first), str(second))
    table = Table()
    for title in ("case", "check", *names, "change"):
        table.add_column(Text(for_terminal(title)), overflow="fold")
    for pair in compared.changed:
        style = "red" if pair.is_worse else "green" if pair.change == "better" else ""
        table.add_row(*(Text(for_terminal(cell), style=style) for cell in pair.cells))
    console = Console(highlight=False)
    if table.row_count:
        console.print(table)
    for remark in compared.remarks:
        style = "red" if remark in compared.worse_cases else ""
        console.print(Text(for_terminal(remark), style=style))
    if summary is not None:
        write_own_text(summary, compared.markdown(*names))
    raise typer.Exit(compared.exit_code)


def _as_asked(
    cases: Sequence[Case],
    laws: Sequence[Law] | None,
    contact: ContactRule | None,
    *,
    near_tool: bool = False,
    near_tool_edge: float | None = None,
    is_judged: bool = True,
) -> list[Case]:
    """The cases under each law, with the contact and on the mesh that the caller asks for.

    Raises:
        InputError: A case that cannot be under them.
        ReferenceUnavailableError: They are judged, and their reference cannot be solved here.
    """
    from palpate.reference.availability import require_available
    from palpate.validation.judging.case_references import is_to_be_solved

    found = [case if contact is None else case.with_contact(contact) for case in cases]
    if near_tool or near_tool_edge is not None:
        edge = near_tool_metres(near_tool_edge)
        found = [case.near_tools(edge) for case in found]
    if laws:
        found = [case.under(one) for case in found for one in dict.fromkeys(laws)]
    if is_judged and any(is_to_be_solved(case) for case in found):
        require_available()
    return found


def _require_builtin(cases: Sequence[Case]) -> None:
    """Raise InputError for a case that is not built in, for which nothing is expected."""
    own = [case.name for case in cases if not case.is_builtin]
    if own:
        raise InputError(
            f"--expected is about built-in cases, and {', '.join(own)} is not one; what changed "
            "since a result that you accepted is reported by `palpate compare-runs`"
        )


def _print_answer(found: Trust, console: Console) -> None:
    """What the page begins with: what was found in a sentence each, and what to do next."""
    lines = [band.says for band in found.bands]
    for step in found.next:
        lines += [f"What to do next: {step.says}", *(f"    {line}" for line in step.commands)]
    for line in lines:
        console.print(Text(for_terminal(line)), soft_wrap=line.startswith(" "))


def _require_judged(results: Sequence[CaseResult]) -> None:
    """Raise InputError with the reason of each case that could not be judged."""
    lost = [result for result in results if result.not_judged]
    if lost and len(results) == 1:
        raise InputError(lost[0].not_judged)
    if lost:
        whys = "; ".join(f"{result.name}: {result.not_judged}" for result in lost)
        raise InputError(f"{len(lost)} of {len(results)} cases not judged: {whys}")


def _exit_code(results: list[CaseResult], *, expected: bool) -> int:
    """The exit code by the verdicts, or by differences from what is expected, which it prints."""
    from palpate.validation.judging.expectation import read_expected, unexpected
    from palpate.validation.judging.judge import exit_code

    if not expected:
        return exit_code(results)
    lines = unexpected(results, read_expected())
    print_lines(lines, "not as expected: ")
    if lines:
        return ExitCode.FAILED
    print(
        f"as expected: {len(results)} case(s). What failed above fails for the reason it gives, "
        "and is known to; exit code 0 says that nothing has changed, not that all has passed"
    )
    return ExitCode.PASSED
