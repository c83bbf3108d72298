"""`palpate solve|audit`: solves a case; measures a result by the equations of its case."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element
from palpate.reference.result import Formulation
from palpate.validation.commands.options import (
    Device,
    ElementOfResult,
    Force,
    NearTool,
    NearToolEdge,
    OneCase,
    OptionalFile,
    ResultFile,
    StrainOfCase,
    near_tool_metres,
    print_lines,
    progress_lines,
    write_json,
)
from palpate.validation.output_files import input_files, require_outputs
from palpate.validation.solving import Simulator
from palpate.validation.solving import solve as solve_problem
from palpate.validation.states import ExitCode, Method, State

if TYPE_CHECKING:
    from palpate.reference.result import Audit
    from palpate.validation.candidates.candidate import Candidate
    from palpate.validation.case import Case

_INVERTED = "a cell is inverted"
# Quantities that have to be numbers, and their names.
_NUMBERS = {
    "residual_norm": "residual",
    "relative_residual_norm": "relative residual",
    "support_gap": "gap of the supports",
    "force_imbalance": "force out of balance",
    "moment_imbalance": "moment out of balance",
    "strain_energy": "strain energy",
    "volume": "volume",
    "smallest_det_f": "smallest det F",
    "displacement_error": "estimated error of displacement",
    "volume_error": "estimated error of volume",
}
_STABLE = {True: "yes", False: "no", None: "not asked"}


def solve(
    case: OneCase,
    output: Annotated[
        Path, typer.Option("--output", "-o", help=".vtu or .vtk; .npz holds a whole motion")
    ],
    simulator: Annotated[Simulator, typer.Option("--with")] = Simulator.FASTSIM,
    strain: StrainOfCase = None,
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
    near_tool: NearTool = False,
    near_tool_edge: NearToolEdge = None,
    multirate: Annotated[
        bool,
        typer.Option(
            "--multirate",
            help="in a motion: steps of several lengths, small cells make more of them; contact is "
            "then a penalty over facets",
        ),
    ] = False,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="another number of the case; repeatable"),
    ] = None,
    force: Force = False,
) -> None:
    """Solve a case, statics or motion; write displacement and, in mesh files, stresses of cells.

    Of a case with markers their motion is printed, with two standard uncertainties by its inputs.
    """
    from palpate.validation.case import load_case
    from palpate.validation.case.variants import read_settings, with_values
    from palpate.validation.exchange.result_files import require_written_kind, write_solution

    require_written_kind(output)
    loaded = load_case(case)
    require_outputs({"--output": output}, inputs=input_files([loaded]), force=force)
    if set_:
        loaded = with_values(loaded, read_settings(set_))
    edge = near_tool_metres(near_tool_edge)
    if near_tool or edge is not None:
        if simulator is not Simulator.FASTSIM:
            raise InputError("--near-tool is of fastsim's mesh: leave out --with")
        loaded = loaded.near_tools(edge)
    loaded.build(progress_lines())
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
        multirate=multirate,
        progress=progress_lines(),
    )
    if multirate:
        parts = (f"{count} cells by {step:.3g} s" for count, step in state.details["classes"])
        print(f"steps: {', '.join(parts)}")
    if loaded.spec.marker:
        _print_markers(loaded, state)
    print(write_solution(output, problem, state))


def _print_markers(case: Case, state: State) -> None:
    from palpate.validation.judging.measured import predict_markers

    size, unit = case.spec.units.of("length")
    for name, motion, uncertainty in predict_markers(case, state.displacement):
        parts = (
            f"{axis} {m / size:.4g} +- {2.0 * u / size:.2g}"
            for axis, m, u in zip("xyz", motion, uncertainty, strict=True)
        )
        print(f"{name} moves by [{unit}] {', '.join(parts)}")


def audit(
    case: OneCase,
    result: Annotated[Path | None, ResultFile] = None,
    with_: Annotated[
        Simulator | None,
        typer.Option("--with", help="condensed: instead, its solution by linear strain"),
    ] = None,
    strain: StrainOfCase = None,
    degree: Annotated[
        int,
        typer.Option(
            min=1, max=3, help="1 judges the solver; 2 and 3 the mesh too, and need FEniCSx"
        ),
    ] = 2,
    element: ElementOfResult = None,
    limit: Annotated[
        float | None,
        typer.Option(
            help="of the relative residual, and of the supports' gap over the largest "
            "displacement; above it the exit code is 1"
        ),
    ] = None,
    json: OptionalFile = None,
    cells: Annotated[
        Path | None,
        typer.Option(help=".vtu with each cell's part, where to refine, and by how much it turns"),
    ] = None,
    force: Force = False,
) -> None:
    """Measure a result, at the case's points, against the equations it should satisfy.

    Nothing is solved. A result on a mesh of its own is refused: `palpate compare` judges it there.
    """
    import numpy as np

    from palpate.meshes.files import MESH_SUFFIXES, write_mesh
    from palpate.validation.case import load_case
    from palpate.validation.judging.audit import audit_result
    from palpate.validation.metrics.validity import cell_rotations

    if limit is not None and not 0.0 < limit < 1.0:
        raise InputError(
            f"--limit {limit:g}: needs a value above 0 and below 1; a result in which nothing "
            "moves is wrong by 1, and so is one that misses its supports by all that it moves"
        )
    if cells is not None and cells.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"--cells {cells}: unknown kind; name a file with {MESH_SUFFIXES[-1]}")
    judged = _audited(result, with_, element)
    loaded = load_case(case)
    outputs = {"--json": json, "--cells": cells}
    require_outputs(outputs, inputs=input_files([loaded], result), force=force)
    used, progress = strain or loaded.strain, progress_lines()
    state, found = audit_result(loaded, judged, strain=used, degree=degree, progress=progress)
    wrong = failures(found, limit)
    print_lines((*describe(found), *state.remarks))
    write_json(json, as_numbers(found, wrong))
    if cells is not None:
        mesh = loaded.problem.mesh
        turned = np.degrees(cell_rotations(mesh, state.displacement))
        write_mesh(
            cells,
            mesh,
            point_data={"displacement": state.displacement},
            cell_data={"residual_norm": found.cell_errors, "rotation_degrees": turned},
        )
    print_lines(wrong, "failed: ")
    if wrong:
        raise typer.Exit(ExitCode.FAILED)


def _audited(
    result: Path | None, simulator: Simulator | None, element: Element | None
) -> Candidate:
    """The candidate to audit: a file, or the condensed model, which has linear strain."""
    from palpate.validation.candidates.candidate import linear_candidate, result_candidate

    if (result is None) == (simulator is None):
        raise InputError("name a result, or say --with condensed")
    if result is not None:
        return result_candidate(result, element)
    if simulator is not Simulator.CONDENSED:
        raise InputError(f"--with {simulator}: solve with it, and audit what it has written")
    return linear_candidate(element or Element.LINEAR)


def failures(audit: Audit, limit: float | None = None) -> list[str]:
    """Reasons why an audited result is no solution of the case, a line each; none if it may be.

    Without a limit these are values that are not finite, and inverted cells, which are impossible
    under linear strain too. A limit also applies to the residual and to the supports, whose forces
    the residual does not include; and the equilibrium has to be stable.

    Args:
        audit: The audit.
        limit: Limit of the residual over the displacement's own norm, and of the supports' gap over
            the largest displacement [-].
    """
    numbers = {name: getattr(audit, attribute) for attribute, name in _NUMBERS.items()}
    found = [
        f"the {name} is {value:g}, no finite number"
        for name, value in numbers.items()
        if value is not None and not math.isfinite(value)
    ]
    if audit.smallest_det_f <= 0.0:
        found.append(_INVERTED)
    if limit is None or found:
        return found
    if audit.relative_residual_norm > limit:
        found.append(f"relative residual {audit.relative_residual_norm:.3g} > {limit:g}")
    if audit.relative_support_gap > limit:
        found.append(
            f"supports missed by {audit.relative_support_gap:.3g} of the largest displacement "
            f"> {limit:g}"
        )
    if audit.is_stable is False:
        found.append("the equilibrium is not stable: a body does not stay in it")
    if audit.displacement_error is None:
        found.append("the tangent is singular there: no equilibrium is near")
    return found


def describe(audit: Audit) -> list[str]:
    """One line for each finding of an audit."""
    volume, displacement = audit.volume_error, audit.displacement_error
    return [
        f"audit on degree {audit.degree}, {audit.strain} strain",
        f"  residual, energy-dual norm      {audit.residual_norm:.3e} J^(1/2), "
        f"{audit.relative_residual_norm:.3e} of the displacement's",
        f"  supports missed by              {audit.support_gap:.3e} m, "
        f"{audit.relative_support_gap:.3e} of the largest displacement",
        f"  forces out of balance           {audit.force_imbalance:.3e} N",
        f"  moments out of balance          {audit.moment_imbalance:.3e} N m",
        f"  strain energy                   {audit.strain_energy:.9g} J",
        f"  volume                          {audit.volume:.9g} m3",
        f"  smallest det F                  {audit.smallest_det_f:.6g}",
        f"  stable                          {_STABLE[audit.is_stable]}",
        "  estimated error of displacement " + _estimate(displacement, "of its L2 norm"),
        "  estimated error of volume       " + _estimate(volume, "of its change"),
    ]


def as_numbers(audit: Audit, wrong: list[str]) -> dict[str, Any]:
    """An audit as plain data, without the cells, and with the reasons why it failed."""
    values = dataclasses.asdict(audit)
    values.pop("cell_errors")
    return values | {"relative_support_gap": audit.relative_support_gap, "failures": wrong}


def _estimate(value: float | None, scale: str) -> str:
    return "none: not near an equilibrium" if value is None else f"{value:+.3e} {scale}"
