"""`palpate sweep CASE --vary KEY=VALUES -o DIR`: a case with many values, linear beside Green."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.validation.commands.words import Folder, OneCase, progress_lines
from palpate.validation.solving import Simulator
from palpate.validation.states import Elements


def sweep(
    case: OneCase,
    output: Folder,
    vary: Annotated[
        list[str], typer.Option(help="KEY=FIRST:LAST:COUNT or KEY=VALUE,...; load[0].factor scales")
    ],
    simulator: Annotated[
        Simulator, typer.Option("--with", help="reference: solved by it as well")
    ] = Simulator.FASTSIM,
    element: Annotated[
        Elements, typer.Option(help="of the tetrahedra; both: beside one another")
    ] = Elements.LINEAR,
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
    from palpate.validation.sweeps.sweep import sweep as run_sweep
    from palpate.validation.sweeps.variants import read_axis

    if scheduler is not None and jobs > 1:
        raise InputError("--jobs is for this machine: give it or --scheduler, not both")
    loaded = load_case(case)
    inputs = input_files([loaded])
    require_run_folder(output, inputs=inputs)
    axes = [read_axis(words, loaded) for words in vary]
    if simulator is Simulator.REFERENCE and scheduler is None:
        require_available()
    with run_folder(output, inputs=inputs) as fresh:
        code = run_sweep(
            loaded,
            axes,
            fresh,
            Console(highlight=False),
            simulators=list(dict.fromkeys((Simulator.FASTSIM, simulator))),
            elements=element.each,
            jobs=jobs,
            scheduler=scheduler,
            progress=progress_lines(),
        )
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)
