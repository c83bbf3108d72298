"""`palpate fit CASE`: numbers of a case fitted to what was measured, with what is known of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element
from palpate.validation.commands.options import Folder, OneCase, progress_lines
from palpate.validation.studies.fit_case import LastStep


def fit(
    case: OneCase,
    output: Folder,
    parameter: Annotated[
        list[str], typer.Option(help="key of a number, such as material.youngs_modulus; repeatable")
    ],
    bounds: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=LOW:HIGH",
            help="what is thought possible; default: a quarter to four times the case's value",
        ),
    ] = None,
    data: Annotated[
        list[str] | None,
        typer.Option(help="measurement to fit to; repeatable; default: all that are not held out"),
    ] = None,
    hold_out: Annotated[
        list[str] | None, typer.Option(help="measurement to predict and judge; repeatable")
    ] = None,
    law: Annotated[
        list[Law] | None,
        typer.Option(help="instead of the case's; several are compared by what is held out"),
    ] = None,
    element: Annotated[Element, typer.Option(help="of the search")] = Element.SMOOTHED,
    last_step: Annotated[
        LastStep | None,
        typer.Option(
            help="by which model; default: the reference, or a finer mesh without FEniCSx"
        ),
    ] = None,
    confidence: Annotated[float, typer.Option(help="of the intervals")] = 0.95,
    by_run: Annotated[bool, typer.Option(help="fit each run alone, too")] = False,
) -> None:
    """Fit numbers of a case to its measurements, and predict what is held out.

    Leaves a page, tables, and the fitted case as CASE-fitted.toml. The exit code is the verdict on
    what was held out; without that, whether the data tell every number.
    """
    from palpate.validation.case import load_case
    from palpate.validation.output_files import input_files
    from palpate.validation.run_folder import require_run_folder, run_folder
    from palpate.validation.studies.fit_case import law_fits
    from palpate.validation.studies.fit_page import write_fits

    loaded = load_case(case)
    inputs = input_files([loaded])
    require_run_folder(output, inputs=inputs)
    laws = law or [loaded.spec.material.law]
    if len(laws) > 1 and not hold_out:
        raise InputError("several laws are compared by what is held out: give --hold-out")
    progress = progress_lines()
    found = law_fits(
        loaded,
        laws,
        parameter,
        _bounds(bounds or []),
        data=data,
        hold_out=hold_out or (),
        element=element,
        last_step=last_step,
        confidence=confidence,
        by_run=by_run,
        progress=progress,
    )
    with run_folder(output, inputs=inputs) as fresh:
        progress("drawing the page")
        code = write_fits(found, fresh, Console(highlight=False))
    print(f"{Path(output) / 'report.html'}")
    raise typer.Exit(code)


def _bounds(words: list[str]) -> dict[str, tuple[float, float]]:
    found: dict[str, tuple[float, float]] = {}
    for text in words:
        key, equals, rest = (part.strip() for part in text.partition("="))
        try:
            low, high = (float(number) for number in rest.split(":"))
        except ValueError:
            low = high = float("nan")
        if not equals or not low < high:
            raise InputError(f"--bounds {text!r}: write KEY=LOW:HIGH, with LOW below HIGH")
        if key in found:
            raise InputError(f"--bounds {key} is given twice")
        found[key] = (low, high)
    return found
