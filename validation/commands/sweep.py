"""`palpate sweep CASE --vary KEY=VALUES -o DIR`: a case with many values, linear beside Green.

With --simulator it is the simulator that is varied, by its iterations and its time step.
"""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.validation.candidates.outside import DEFAULT_TIME_LIMIT, OutsideSimulator
from palpate.validation.commands.words import (
    Device,
    Folder,
    OneCase,
    StatedIntegrator,
    TimeLimit,
    progress_lines,
)
from palpate.validation.solving import Simulator
from palpate.validation.states import Elements


def sweep(
    case: OneCase,
    output: Folder,
    vary: Annotated[
        list[str],
        typer.Option(
            help="KEY=FIRST:LAST:COUNT or KEY=VALUE,...; load[0].factor scales; with --simulator "
            "iterations and time_step"
        ),
    ],
    with_: Annotated[
        Simulator, typer.Option("--with", help="reference, or condensed: solved by it as well")
    ] = Simulator.FASTSIM,
    simulator: Annotated[
        str | None,
        typer.Option(help='instead: its error over "mysim {case} {result} {iterations}"'),
    ] = None,
    integrator: StatedIntegrator = None,
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
    from palpate.validation.output_files import input_files
    from palpate.validation.run_folder import require_run_folder, run_folder
    from palpate.validation.studies.sweep import sweep as run_sweep
    from palpate.validation.studies.sweep_variants import read_axis

    if scheduler is not None and jobs > 1:
        raise InputError("--jobs is for this machine: give it or --scheduler, not both")
    if device != "cpu" and jobs > 1:
        raise InputError("--device does one run at a time: leave out --jobs")
    loaded = load_case(case)
    inputs = input_files([loaded], command=simulator)
    require_run_folder(output, inputs=inputs)
    if simulator is not None:
        from palpate.validation.studies.sweep_iterations import read_moves, sweep_iterations

        is_fastsims = element is not Elements.LINEAR or device != "cpu" or scheduler
        if is_fastsims or with_ is not Simulator.FASTSIM:
            raise InputError("--simulator takes no --element, --device, --with or --scheduler")
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
        raise InputError("--integrator is of another simulator: give --simulator")
    axes = [read_axis(words, loaded) for words in vary]
    if with_ is Simulator.REFERENCE and scheduler is None:
        require_available()
    with run_folder(output, inputs=inputs) as fresh:
        code = run_sweep(
            loaded,
            axes,
            fresh,
            Console(highlight=False),
            simulators=list(dict.fromkeys((Simulator.FASTSIM, with_))),
            elements=element.each,
            device=device,
            jobs=jobs,
            scheduler=scheduler,
            progress=progress_lines(),
        )
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)
