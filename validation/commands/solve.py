"""`palpate solve`: a case solved by fastsim, its condensed model or the reference, and written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.meshes.problem import Element, Strain
from palpate.reference.result import Formulation
from palpate.validation.commands.words import Device, OneCase, progress_lines
from palpate.validation.solving import Simulator
from palpate.validation.solving import solve as solve_problem
from palpate.validation.states import Method


def solve(
    case: OneCase,
    output: Annotated[
        Path, typer.Option("--output", "-o", help=".vtu or .vtk; .npz holds a whole motion")
    ],
    simulator: Annotated[Simulator, typer.Option("--with")] = Simulator.FASTSIM,
    strain: Annotated[Strain | None, typer.Option(help="default: the case's")] = None,
    degree: Annotated[int, typer.Option(min=1, max=3, help="of the reference")] = 1,
    method: Annotated[
        Method, typer.Option(help="fastsim's way to equilibrium; relaxation: explicit steps")
    ] = Method.NEWTON,
    formulation: Annotated[
        Formulation | None,
        typer.Option(
            help="of the reference; default: mixed, pressure apart, from Poisson's ratios of 0.49 "
            "on with --degree 2 or 3"
        ),
    ] = None,
    element: Annotated[
        Element, typer.Option(help="smoothed: nearer the truth on the same mesh; degree 1")
    ] = Element.LINEAR,
    device: Device = "cpu",
) -> None:
    """Solve a case, statics or motion; write displacement and, in mesh files, stresses of cells."""
    from palpate.validation.case import load_case
    from palpate.validation.exchange.result_files import require_written_kind, write_solution
    from palpate.validation.output_files import input_files, require_outputs

    require_written_kind(output)
    loaded = load_case(case)
    require_outputs({"--output": output}, inputs=input_files([loaded]))
    problem, used = loaded.problem, strain or loaded.strain
    state = solve_problem(
        problem,
        with_=simulator,
        strain=used,
        degree=degree,
        method=method,
        formulation=formulation,
        element=element,
        device=device,
        progress=progress_lines(),
    )
    print(write_solution(output, problem, state))
