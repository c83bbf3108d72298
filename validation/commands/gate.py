"""`palpate gate`: judge a simulator on cases; the exit code is the verdict."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.candidates.faults import Fault
from palpate.validation.candidates.outside import DEFAULT_TIME_LIMIT
from palpate.validation.commands.words import (
    AskedTimeStep,
    ChosenElements,
    ChosenEngine,
    Device,
    GrantedPrecision,
    OptionalCases,
    OptionalFile,
    SimulatorCommand,
    StatedIntegrator,
    TimeLimit,
    ToldIterations,
    is_condensed,
    progress_lines,
)
from palpate.validation.quoting import for_terminal
from palpate.validation.solving import Simulator
from palpate.validation.states import ExitCode, Precision

if TYPE_CHECKING:
    from palpate.validation.case import Case


def gate(
    names: OptionalCases = None,
    json: OptionalFile = None,
    junit: OptionalFile = None,
    summary: OptionalFile = None,
    live: Annotated[bool, typer.Option(help="solve the reference here")] = False,
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
            help="hold it against this simulator, or build of it, without a reference; fastsim: "
            "its compiled core"
        ),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=VALUE", help="of --versus; default: those on the same mesh"),
    ] = None,
    law: Annotated[
        list[Law] | None,
        typer.Option(help="in the place of the case's; repeatable; the reference is solved here"),
    ] = None,
    integrator: StatedIntegrator = None,
    time_step: AskedTimeStep = None,
    iterations: ToldIterations = None,
    precision: GrantedPrecision = None,
    device: Device = "cpu",
    metamorphic: Annotated[
        bool, typer.Option(help="judge by relations that need no reference")
    ] = False,
    self_test: Annotated[
        bool, typer.Option(help="seed faults, on the named cases or all; the gate must go red")
    ] = False,
    quick: Annotated[bool, typer.Option(help="a few small cases, in seconds")] = False,
    every: Annotated[bool, typer.Option("--all", help="every built-in case")] = False,
    expected: Annotated[
        bool, typer.Option(help="1 where a built-in verdict is not the one expected of fastsim")
    ] = False,
    record_expected: Annotated[
        bool, typer.Option("--record-expected", help="keep these verdicts as the expected ones")
    ] = False,
) -> None:
    """Judge fastsim, or another simulator, on cases; the exit code is the verdict."""
    from palpate.fastsim.explicit_body import Precision as StepPrecision
    from palpate.reference.availability import require_available
    from palpate.validation.candidates.candidate import candidates_for
    from palpate.validation.candidates.faults import with_fault
    from palpate.validation.case import QUICK, builtin_cases, load_cases
    from palpate.validation.judging import outputs
    from palpate.validation.judging.expectation import (
        FILE,
        expected_toml,
        read_expected,
        unexpected,
        with_results,
    )
    from palpate.validation.judging.judge import exit_code, judge_case, judge_cases, suitable_cases
    from palpate.validation.judging.metamorphic import judge_relations
    from palpate.validation.judging.outputs import github_annotations
    from palpate.validation.judging.results import merge_candidates
    from palpate.validation.judging.self_test import run_self_test
    from palpate.validation.judging.versus import judge_versus, other_candidate, read_limits
    from palpate.validation.output_files import input_files, require_outputs

    # Single precision granted to a device is what its steps are made in.
    on_device = device != "cpu"
    arithmetic = StepPrecision.DOUBLE
    if on_device and precision is Precision.SINGLE:
        arithmetic = StepPrecision.SINGLE
    given = candidates_for(
        simulator,
        time_limit,
        element,
        integrator=integrator,
        time_step=time_step,
        iterations=iterations,
        device=device,
        precision=arithmetic,
        is_condensed=is_condensed(with_),
    )
    candidates = [with_fault(candidate, fault) for candidate in given]
    if quick + every + bool(names) != 1 and not (self_test and quick + every + bool(names) == 0):
        raise InputError("name the cases, or say one of --quick, --all and --self-test")
    if self_test and (fault is not Fault.NONE or metamorphic or live):
        raise InputError(
            "--self-test seeds every fault by itself; it takes no --fault, --metamorphic or --live"
        )
    if (expected or record_expected) and (self_test or metamorphic or simulator):
        raise InputError(
            "--expected is about fastsim's verdicts on built-in cases: it takes no --simulator, "
            "--metamorphic or --self-test"
        )
    if versus is None and limit:
        raise InputError("--limit goes with --versus; the limits of a gate stand in its case")
    if versus is not None and (self_test or metamorphic or expected or live or precision):
        raise InputError(
            "--versus knows no reference: it takes no --self-test, --metamorphic, --expected, "
            "--live or --precision"
        )
    if law and (expected or record_expected or self_test or metamorphic):
        raise InputError("--law takes no --expected, --self-test or --metamorphic")
    known = read_expected() if expected else {}
    chosen = QUICK if quick else builtin_cases() if every else names or ()
    loaded = load_cases(chosen)
    if law:
        loaded = [case.under(one) for case in loaded for one in dict.fromkeys(law)]
        if versus is None and any(case.other_law for case in loaded):
            require_available()
    if (on_device or with_ is not Simulator.FASTSIM) and (expected or record_expected):
        raise InputError("--expected is about fastsim's core: it takes no --device or --with")
    if expected or record_expected:
        require_builtin(loaded)
    require_outputs(
        {"--json": json, "--junit": junit, "--summary": summary},
        inputs=input_files(loaded, command=" ".join(filter(None, (simulator, versus)))),
    )
    progress = progress_lines()
    if every or quick:
        loaded = suitable_cases(loaded, candidates, progress)
    if self_test:
        trials = [run_self_test(progress, cases=loaded, candidate=one) for one in candidates]
        results = [merge_candidates(trials)]
    elif metamorphic:
        results = [
            merge_candidates([judge_relations(case, one, progress) for one in candidates])
            for case in loaded
        ]
    elif versus is not None:
        others = [other_candidate(versus, time_limit, candidate) for candidate in candidates]
        pairs, limits = list(zip(candidates, others, strict=True)), read_limits(limit or [])
        results = [
            merge_candidates([judge_versus(c, *o, limits=limits, progress=progress) for o in pairs])
            for c in loaded
        ]
    elif simulator is None and fault is Fault.NONE and not (live or law):
        results = judge_cases(loaded, candidates, precision=precision, progress=progress)
    else:
        results = [
            judge_case(
                case,
                live=live or case.other_law is not None,
                candidate=candidates,
                precision=precision,
                progress=progress,
            )
            for case in loaded
        ]
    outputs.write_outputs(results, json=json, junit=junit, summary=summary)
    outputs.print_results(results, Console(highlight=False))
    if os.environ.get("GITHUB_ACTIONS") == "true":
        print("\n".join(github_annotations(results)))
    if record_expected:
        from palpate.meshes.atomic_write import write_text_atomically

        write_text_atomically(FILE, expected_toml(with_results(read_expected(), results)))
        print(FILE)
    if expected:
        raise typer.Exit(tell_unexpected(unexpected(results, known), len(results)))
    raise typer.Exit(exit_code(results))


def require_builtin(cases: Sequence[Case]) -> None:
    """Raise InputError for a case of which nobody expects anything."""
    own = [case.name for case in cases if not case.is_builtin]
    if own:
        raise InputError(
            f"--expected is about built-in cases, and {', '.join(own)} is not one; what changed "
            "since a result that you accepted is told by `palpate compare-runs`"
        )


def tell_unexpected(lines: Sequence[str], count: int) -> ExitCode:
    """Say what is not as expected, or that all is; the exit code."""
    for line in lines:
        print(for_terminal(f"not as expected: {line}"))
    if lines:
        return ExitCode.FAILED
    print(
        f"as expected: {count} case(s). What failed above fails for the reason it gives, and is "
        "known to; exit code 0 says that nothing has changed, not that all has passed"
    )
    return ExitCode.PASSED
