"""`palpate audit`: how far a result is from equilibrium, found without solving the case."""

from __future__ import annotations

import dataclasses
import json as json_format
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.validation.commands.progress_lines import progress_lines


def audit(
    case: Annotated[str, typer.Argument(help="built-in name, or path to a .toml file")],
    result: Annotated[Path, typer.Argument(help="displacement as .vtu, .npz or .csv")],
    strain: Annotated[Strain | None, typer.Option(help="default: the case's")] = None,
    degree: Annotated[
        int, typer.Option(min=1, max=3, help="1 judges the solver, 2 the mesh too")
    ] = 2,
    limit: Annotated[
        float | None, typer.Option(help="of the relative residual; above it the exit code is 1")
    ] = None,
    json: Annotated[Path | None, typer.Option()] = None,
    cells: Annotated[
        Path | None, typer.Option(help=".vtu with each cell's part: where to refine")
    ] = None,
) -> None:
    """Measure a result against the equations it should satisfy, without solving them."""
    from palpate.meshes.atomic_write import write_text_atomically
    from palpate.meshes.files import write_mesh
    from palpate.reference.child import run_task
    from palpate.reference.result import Audit
    from palpate.reference.tasks import AuditTask
    from palpate.validation.case import load_case
    from palpate.validation.simulators.answer import CandidateFailedError
    from palpate.validation.simulators.candidate import result_candidate

    loaded = load_case(case)
    used, progress = strain or loaded.strain, progress_lines()
    if loaded.problem.time is not None:
        raise InputError(f"{loaded.name} is dynamic: what moves is not in equilibrium")
    try:
        state = result_candidate(result).solve(loaded.problem, used, progress)
    except CandidateFailedError as error:
        print(f"palpate: {error}", file=sys.stderr)
        raise typer.Exit(1) from error
    found = run_task(AuditTask(state.displacement, used, degree), loaded.problem, progress=progress)
    assert isinstance(found, Audit)
    for line in describe(found):
        print(line)
    if json is not None:
        write_text_atomically(json, json_format.dumps(as_numbers(found), indent=2) + "\n")
    if cells is not None:
        write_mesh(
            cells,
            loaded.problem.mesh,
            point_data={"displacement": state.displacement},
            cell_data={"residual_norm": found.cell_errors},
        )
    if not found.smallest_det_f > 0.0 and used is Strain.GREEN:
        print("failed: a cell is inverted")
        raise typer.Exit(1)
    if limit is not None and not found.relative_residual_norm <= limit:
        print(f"failed: relative residual {found.relative_residual_norm:.3g} > {limit:g}")
        raise typer.Exit(1)


def describe(audit: Any) -> list[str]:
    """One line for each thing an audit says."""
    volume, displacement = audit.volume_error, audit.displacement_error
    return [
        f"audit on degree {audit.degree}, {audit.strain} strain",
        f"  residual, energy-dual norm      {audit.residual_norm:.3e} J^(1/2), "
        f"{audit.relative_residual_norm:.3e} of the displacement's",
        f"  supports missed by              {audit.support_gap:.3e} m",
        f"  forces out of balance           {audit.force_imbalance:.3e} N",
        f"  moments out of balance          {audit.moment_imbalance:.3e} N m",
        f"  strain energy                   {audit.strain_energy:.9g} J",
        f"  volume                          {audit.volume:.9g} m3",
        f"  smallest det F                  {audit.smallest_det_f:.6g}",
        "  estimated error of displacement " + _estimate(displacement, "of its L2 norm"),
        "  estimated error of volume       " + _estimate(volume, "of its change"),
    ]


def as_numbers(audit: Any) -> dict[str, Any]:
    """An audit as strict JSON, without the cells."""
    values = dataclasses.asdict(audit)
    values.pop("cell_errors")
    return {
        name: None if isinstance(v, float) and not math.isfinite(v) else v
        for name, v in values.items()
    }


def _estimate(value: float | None, scale: str) -> str:
    return "none: not near an equilibrium" if value is None else f"{value:+.3e} {scale}"
