"""`palpate export` and `palpate compare`: a case for other simulators, and what they answered."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from palpate.meshes.problem import Strain
from palpate.validation.commands.words import (
    ElementOfResult,
    GrantedPrecision,
    OneCase,
    progress_lines,
)


def export(
    case: OneCase,
    output: Annotated[Path, typer.Option("--output", "-o", help="folder")],
    strain: Annotated[Strain | None, typer.Option(help="default: the case's")] = None,
) -> None:
    """Write a case as a folder that other simulators can read: case.json, rest.vtu, rest.npz."""
    from palpate.validation import api

    loaded = api.load_case(case)
    used = strain or loaded.strain
    api.export(loaded, output, strain=used)
    print(f"{output}: {loaded.problem.mesh.num_points} points, {used} strain; see case.json")


def compare(
    case: OneCase,
    result: Annotated[Path, typer.Argument(help="displacement as .vtu, .npz or .csv")],
    json: Annotated[Path | None, typer.Option()] = None,
    live: Annotated[bool, typer.Option(help="solve the reference here")] = False,
    precision: GrantedPrecision = None,
    element: ElementOfResult = None,
) -> None:
    """Judge somebody else's result; the exit code is the verdict."""
    from palpate.validation.candidates.candidate import result_candidate
    from palpate.validation.case import load_case
    from palpate.validation.exchange.result_files import read_result, room_for_answer
    from palpate.validation.judging import outputs
    from palpate.validation.judging.judge import exit_code, judge_case
    from palpate.validation.output_files import input_files, require_outputs

    loaded = load_case(case)
    require_outputs({"--json": json}, inputs=input_files([loaded], result))
    # A file that cannot be read is refused before anything is solved.
    read_result(result, most_bytes=room_for_answer(loaded.problem))
    judged = judge_case(
        loaded,
        live=live,
        candidate=result_candidate(result, element),
        precision=precision,
        progress=progress_lines(),
    )
    outputs.write_outputs([judged], json=json)
    outputs.print_results([judged], Console(highlight=False))
    raise typer.Exit(exit_code([judged]))
